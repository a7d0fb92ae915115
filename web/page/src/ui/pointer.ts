/** Pointers and the wheel on the canvas: turning, moving across, zooming, and what {@link BodyTools} do. */
import type { App } from "../app/app.ts";
import type { BodyTools } from "./body_tools.ts";

/** A full turn takes so many heights of the canvas. */
const TURN_PER_HEIGHT = Math.PI * 1.25;
/** A press that moves no farther is a click, CSS pixels. */
const CLICK_PIXELS = 5;
const DOUBLE_MS = 350;

interface Finger {
  x: number;
  y: number;
  readonly startX: number;
  readonly startY: number;
  readonly button: number;
}

export function bindPointer(canvas: HTMLCanvasElement, app: App, tools: BodyTools, onPlaced: () => void): void {
  const fingers = new Map<number, Finger>();
  let moved = false;
  /** Whether the first finger reached for a body: also where that is refused, it does not turn the view. */
  let reaches = false;
  let lastClick = { at: -Infinity, x: 0, y: 0 };
  const at = (event: MouseEvent): [number, number] => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener("pointerdown", (event) => {
    const [x, y] = at(event);
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x, y, startX: x, startY: y, button: event.button });
    moved = fingers.size > 1;
    if (fingers.size === 1) reaches = false;
    app.orbit.hold();
    app.held = true;
    // Fingers do not hover.
    if (tools.placing) tools.preview(x, y);
    if (fingers.size === 1 && event.button === 0 && !tools.placing && app.steers) {
      const hit = tools.hit(x, y, false);
      if (hit?.body !== null && hit && tools.grab(hit)) {
        reaches = true;
        tools.chosen = hit.body;
        app.changed();
      }
    } else if (fingers.size > 1 && tools.carrying) {
      void tools.release();
    }
  });

  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = at(event);
    const finger = fingers.get(event.pointerId);
    if (!finger) {
      hover(x, y);
      return;
    }
    const [dx, dy] = [x - finger.x, y - finger.y];
    if (!moved && Math.hypot(x - finger.startX, y - finger.startY) < CLICK_PIXELS) return;
    if (!moved) moved = true;
    const before = pinch(fingers);
    finger.x = x;
    finger.y = y;
    if (tools.carrying) {
      tools.carry(x, y);
      app.invalidate();
      return;
    }
    if (reaches && fingers.size === 1) return;
    leaveCamera();
    if (fingers.size === 1) {
      if (finger.button === 2 || finger.button === 1 || event.shiftKey) pan(dx, dy);
      else turn(dx, dy);
    } else if (fingers.size === 2) {
      const after = pinch(fingers);
      pan(after.x - before.x, after.y - before.y);
      if (before.span > 0 && after.span > 0) app.orbit.zoom(before.span / after.span);
      app.changed();
    }
  });

  const up = (event: PointerEvent) => {
    const finger = fingers.get(event.pointerId);
    fingers.delete(event.pointerId);
    if (fingers.size === 0) app.held = false;
    if (!finger) return;
    const wasCarrying = tools.carrying;
    if (wasCarrying) void tools.release();
    if (event.type === "pointercancel" || moved || finger.button !== 0) return;
    click(finger.startX, finger.startY);
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", () => tools.endPreview());
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 18 : event.deltaMode === 2 ? 400 : 1;
      const factor = Math.exp(Math.max(-240, Math.min(240, event.deltaY * lines)) * 0.0016);
      if (tools.carrying) {
        tools.reach(1 / factor);
        return;
      }
      leaveCamera();
      app.orbit.zoom(factor);
      app.changed();
    },
    { passive: false },
  );

  function click(x: number, y: number): void {
    if (tools.placing) {
      void tools.place(x, y).then(onPlaced);
      return;
    }
    const now = performance.now();
    const double = now - lastClick.at < DOUBLE_MS && Math.hypot(x - lastClick.x, y - lastClick.y) < 12;
    lastClick = { at: double ? -Infinity : now, x, y };
    if (double) focusOn(x, y);
    else choose(x, y);
  }

  function choose(x: number, y: number): void {
    const hit = tools.hit(x, y, false);
    tools.chosen = hit?.body ?? null;
    if (!hit) {
      const camera = app.through === null ? tools.cameraAt(x, y) : null;
      if (camera !== null) app.lookThrough(camera);
    }
    app.changed();
  }

  function focusOn(x: number, y: number): void {
    const hit = tools.hit(x, y);
    if (!hit) {
      app.preset("home");
    } else if (hit.body !== null) {
      app.followBody(hit.body);
    } else {
      app.followBody(null);
      app.orbit.fly({ ...app.orbit.now, target: [hit.point.x, hit.point.y, hit.point.z], distance: Math.max(0.8, app.orbit.now.distance * 0.7) });
    }
    app.changed();
  }

  function leaveCamera(): void {
    if (app.through === null) return;
    const camera = app.rig[app.through];
    // From the camera's own place, looking at what it looks at.
    const depth = Math.max(0.5, app.orbit.now.distance);
    const r = camera.rotation[2];
    app.orbit.jump(app.orbit.viewOf(camera.centre, [0, 1, 2].map((i) => camera.centre[i] + r[i] * depth) as unknown as [number, number, number]));
    app.lookThrough(null);
  }

  function turn(dx: number, dy: number): void {
    const share = TURN_PER_HEIGHT / Math.max(1, canvas.clientHeight);
    app.orbit.turn(-dx * share, -dy * share, true);
    app.changed();
  }

  function pan(dx: number, dy: number): void {
    if (app.follow !== null) app.followBody(null);
    const height = Math.max(1, canvas.clientHeight);
    app.orbit.pan(-dx / height, dy / height, (app.fovDeg * Math.PI) / 180);
    app.changed();
  }

  let hovered = 0;
  function hover(x: number, y: number): void {
    const now = performance.now();
    if (now - hovered < 60) return;
    hovered = now;
    canvas.classList.toggle("placing", tools.placing);
    const body = tools.placing ? null : tools.bodyAt(x, y);
    canvas.classList.toggle("over-body", body !== null);
    canvas.classList.toggle("held-elsewhere", body !== null && app.steers && app.stage!.bodies.isHeldElsewhere(body));
    if (tools.placing) tools.preview(x, y);
  }
}

function pinch(fingers: Map<number, Finger>): { x: number; y: number; span: number } {
  const [a, b] = [...fingers.values()];
  if (!a || !b) return { x: a?.x ?? 0, y: a?.y ?? 0, span: 0 };
  return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, span: Math.hypot(a.x - b.x, a.y - b.y) };
}
