/** Keys. Those on the canvas move the view; single letters can be turned off, and never act while typing. */
import type { App } from "../app/app.ts";
import type { Layer } from "../view/hash.ts";
import { toast } from "./dom.ts";

export interface Actions {
  screenshot(): void;
  share(): void;
  help(): void;
  pause(): void;
  step(): void;
  /** A frame of a recording back or on; false if there is none to seek in. */
  seekBeside(direction: 1 | -1): boolean;
  reset(): void;
  escape(): void;
}

const TURN = 0.12;
const FINE = 0.2;
/** What Space presses, opens or follows while it has the focus. */
const PRESSED_BY_SPACE = "button, summary, input, select, a";
const LAYER_KEYS: Record<string, Layer> = { b: "bodies", c: "cameras", n: "images", k: "touches", g: "grid", s: "shadows" };

export function bindKeys(canvas: HTMLCanvasElement, app: App, actions: Actions, enabled: () => boolean): void {
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey) return;
    const share = event.shiftKey ? FINE : 1;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const arrow = arrows[event.key];
    if (arrow) {
      event.preventDefault();
      if (app.through !== null) app.lookThrough(null);
      if (event.altKey) app.orbit.pan(arrow[0] * 0.05 * share, -arrow[1] * 0.05 * share, (app.fovDeg * Math.PI) / 180);
      else app.orbit.turn(arrow[0] * TURN * share, arrow[1] * TURN * share, false);
      app.changed();
    } else if (event.key === "+" || event.key === "=" || event.key === "-" || event.key === "_") {
      event.preventDefault();
      if (app.through !== null) app.lookThrough(null);
      const nearer = event.key === "+" || event.key === "=";
      app.orbit.zoom((nearer ? 0.87 : 1.15) ** share);
      app.changed();
    }
  });

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || typing(document.activeElement)) return;
    if (event.key === "Escape") return actions.escape();
    if (!enabled() || document.querySelector("dialog[open]")) return;
    // Space presses a focused button; elsewhere it pauses.
    if (event.key === " " && document.activeElement?.closest(PRESSED_BY_SPACE)) return;
    if (act(event)) event.preventDefault();
  });

  // What was pressed by pointer loses the focus at once, also if the pointer is released beside it: Space would press it again.
  let byPointer = false;
  document.addEventListener("pointerdown", () => (byPointer = true), true);
  document.addEventListener(
    "mouseup",
    () => {
      const focused = document.activeElement;
      if (focused?.closest(PRESSED_BY_SPACE) && !typing(focused)) (focused as HTMLElement).blur();
    },
    true,
  );
  // A label would focus its control after that.
  document.addEventListener("click", (event) => {
    const pressed = event.target instanceof Element ? event.target.closest("button, select, input, label") : null;
    if (event.detail === 0 || !(pressed instanceof HTMLLabelElement) || !pressed.control || typing(pressed.control)) return;
    event.preventDefault();
    pressed.control.click();
  });
  // So does a list that was opened by pointer, with the first key after it is closed.
  document.addEventListener(
    "keydown",
    (event) => {
      const list = event.target;
      if (list instanceof HTMLSelectElement && event.key !== "Tab" && !isOpen(list)) {
        if (byPointer || (list.id === "scene" && choosesAtOnce(event))) event.preventDefault();
        if (byPointer) list.blur();
      }
      byPointer = false;
    },
    true,
  );

  function act(event: KeyboardEvent): boolean {
    const key = event.key.toLowerCase();
    const layer = LAYER_KEYS[key];
    if (layer) {
      app.setLayer(layer, !app.layers.has(layer));
      return true;
    }
    if (/^[1-9]$/.test(key)) {
      const count = app.hello?.cameras.length ?? 0;
      if (Number(key) <= count) app.lookThrough(Number(key) - 1);
      else if (count > 0) toast(`There is no camera ${key}: the rig has ${count}.`);
      return true;
    }
    const doings: Record<string, () => void> = {
      "0": () => app.preset("home"),
      f: () => app.preset("person"),
      t: () => app.preset("top"),
      m: () => app.nextMode(),
      h: () => app.setMode(app.mode === "off" ? "photo" : "off"),
      "[": () => besides(-1),
      "]": () => besides(1),
      l: () => app.goLive(),
      p: actions.screenshot,
      v: actions.share,
      "?": actions.help,
      " ": actions.pause,
      ".": actions.step,
      r: actions.reset,
    };
    const doing = doings[key];
    if (!doing) return false;
    doing();
    return true;
  }

  function besides(direction: 1 | -1): void {
    if (actions.seekBeside(direction)) return;
    app.frames.playout.beside(direction);
    app.invalidate();
    app.changed();
  }
}

/** Whether a list is open; taken to be where the browser cannot tell. */
function isOpen(list: HTMLSelectElement): boolean {
  return !CSS.supports("selector(:open)") || list.matches(":open");
}

/** Whether a key would choose another entry of a closed list: the scene of a show must not change so. */
function choosesAtOnce({ key, altKey, ctrlKey, metaKey }: KeyboardEvent): boolean {
  if (ctrlKey || metaKey || altKey) return false;
  return (key.length === 1 && key !== " ") || ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "Home", "End", "PageUp", "PageDown"].includes(key);
}

function typing(target: Element | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) return true;
  return target instanceof HTMLInputElement && target.type !== "checkbox" && target.type !== "range";
}
