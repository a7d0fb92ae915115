/** The page's state: what came of the run, what is looked at, what is asked. Buttons and keys are in ui/. */
import type { Background } from "../audience.ts";
import type { Box } from "../decode/hull_box.ts";
import { Quality } from "../draw/quality.ts";
import { Stage } from "../draw/stage.ts";
import { type Answer, Connection, type Endpoint, type LinkState, type Want } from "../feed/connection.ts";
import { parseMessage, type WorldMessage } from "../feed/message.ts";
import { type Hello, isGone, type Scene, type Status, type Text } from "../feed/text.ts";
import { type Moment, Worlds } from "../time/worlds.ts";
import { HULL_MODES, type HullMode, type Layer } from "../view/hash.ts";
import type { Camera, Vec3 } from "../view/lens.ts";
import { Orbit, type View } from "../view/orbit.ts";
import { FOV_DEG, isPerson, presetView, startView, viewOf } from "../view/start.ts";
import { Drawing } from "./drawing.ts";
import { Frames } from "./frames.ts";
import { Images } from "./images.ts";
import type { Observer } from "./observer.ts";
import { describe, INITIAL, isStale, reduce, type RunEvent, type RunState, type RunText } from "./run_state.ts";
import { wantOf } from "./want.ts";

/** Pictures that take longer are slow: frames wait for them, not they for frames. */
const SLOW_PICTURE_MS = 80;

export class App {
  readonly stage: Stage | null;
  readonly connection: Connection;
  readonly quality: Quality;
  readonly frames: Frames;
  readonly drawing: Drawing | null;
  readonly worlds = new Worlds();
  orbit: Orbit = new Orbit([0, 1, 0], 0, { target: [0, 1, 0], azimuth: 0.6, polar: 1.3, distance: 4 });
  hello: Hello | null = null;
  scene: Scene | null = null;
  status: Status | null = null;
  run: RunState = INITIAL;
  mode: HullMode = "photo";
  layers = new Set<Layer>(["bodies", "cameras", "images", "grid", "shadows"]);
  /** The camera that is looked through. */
  through: number | null = null;
  opacity = 0.5;
  inFront = false;
  /** The body that is followed. */
  follow: number | null = null;
  fovDeg = FOV_DEG;
  colour: Want["colour"] = "full";
  moment: Moment | null = null;
  /** Whether bodies or touches are to be drawn again though they did not move. */
  isOutdated = false;
  /** CSS pixels that panels cover at the right and at the bottom: the view's middle is that of the rest. */
  covered: readonly [number, number] = [0, 0];
  /** Whether the view is being dragged. */
  held = false;
  /** Whether the panel shows small images. */
  wantsThumbnails = true;
  private readonly images: Images;
  private readonly observer: Observer;
  readonly canvas: HTMLCanvasElement;
  private lookedThrough: number | null = null;
  private startView: View | null = null;
  private met = false;

  constructor(canvas: HTMLCanvasElement, graphics: { antialias: boolean; software: boolean } | null, background: Background, endpoint: Endpoint, observer: Observer) {
    this.canvas = canvas;
    this.observer = observer;
    this.stage = graphics ? new Stage(canvas, graphics, background) : null;
    this.quality = new Quality(graphics?.software ? 3 : 0);
    this.connection = new Connection(endpoint, {
      link: (state, retry, why) => this.onLink(state, retry, why),
      text: (text) => this.onText(text),
      binary: (type, buffer) => this.onBinary(type, buffer),
      invalid: (why) => observer.fault(why),
    });
    const wanted = () => ({ contours: this.mode === "cones", colour: this.mode === "photo" });
    this.frames = new Frames(this.connection.credit, wanted, (text) => observer.fault(text));
    const listener = { drawn: () => this.frames.drawn(this.quality.averageMs > SLOW_PICTURE_MS), levelChanged: () => this.updateWant() };
    this.drawing = this.stage && new Drawing(this.stage, this.quality, graphics?.software ? 2 : 0, listener);
    this.images = new Images({
      cameras: () => this.stage?.cameras ?? null,
      through: () => this.through,
      areSeen: () => this.layers.has("cameras") && this.layers.has("images"),
      areHeld: () => !this.frames.playout.live,
      thumbnail: (camera, bitmap) => observer.thumbnail(camera, bitmap),
      fault: (text) => observer.fault(text),
    });
    this.listen();
    this.resize();
  }

  /** Something changed that is seen. */
  invalidate(): void {
    this.drawing?.invalidate();
  }

  /** Where a point of the world is on the canvas, CSS pixels; null behind the view. */
  onCanvas(point: Vec3): [number, number] | null {
    const at = this.stage?.toClip(point);
    return at ? [(at[0] * 0.5 + 0.5) * this.canvas.clientWidth, (0.5 - at[1] * 0.5) * this.canvas.clientHeight] : null;
  }

  get rig(): readonly Camera[] {
    return this.stage?.rig ?? [];
  }

  // What is asked of the run.

  command(command: string, fields: Record<string, unknown> = {}): Promise<Answer> {
    return this.connection.command(command, fields);
  }

  /** Whether the person is drawn grey: it is not that of now. What is looked back at was so then. */
  get isGrey(): boolean {
    return this.frames.playout.live && isStale(this.run);
  }

  /** Whether what is seen changes by nothing but the viewer: the world is paused or over, or a moment is looked back at. */
  get isStanding(): boolean {
    const { playout } = this.frames;
    if (!playout.live) return !playout.isPlaying;
    return this.run.isPaused || this.run.lost !== null || this.run.ended !== null;
  }

  /** The words for link and run as they are now. */
  describe(nowMs: number): RunText {
    const framesPerS = this.frames.rate.perSecond(nowMs);
    const { behindMs, isForgotten, isPlaying } = this.frames.playout;
    return describe(this.run, { nowMs, framesPerS, canDraw: this.stage !== null, behindMs, isForgotten, isPlaying });
  }

  get controller(): boolean {
    return this.hello?.controller ?? false;
  }

  /** Whether bodies can be moved and added: what is recorded stays as it is. */
  get steers(): boolean {
    return this.controller && !this.hello?.replay;
  }

  /** The length of the recording in which this page can seek, seconds; null if there is none. */
  get seekableS(): number | null {
    return this.controller && this.run.isGreeted ? (this.hello?.length_s ?? null) : null;
  }

  // The view.

  setMode(mode: HullMode): void {
    this.mode = mode;
    this.frames.again();
    this.changed();
  }

  nextMode(): void {
    this.setMode(HULL_MODES[(HULL_MODES.indexOf(this.mode) + 1) % HULL_MODES.length]);
  }

  setLayer(layer: Layer, on: boolean): void {
    if (on) this.layers.add(layer);
    else this.layers.delete(layer);
    this.isOutdated = true;
    this.changed();
  }

  /** Looks through a camera; null: back to the free view. */
  lookThrough(index: number | null): void {
    if (index !== null && !this.rig[index]) return;
    this.through = index;
    if (index !== null) this.follow = null;
    if (this.lookedThrough !== index) this.stage?.cameras?.clearBehind();
    this.lookedThrough = index;
    this.changed();
  }

  /** Follows a body; null: stays. */
  followBody(id: number | null): void {
    this.follow = id;
    if (id !== null) this.through = null;
    this.changed();
  }

  /** Flies to one of the views that have names. */
  preset(name: string): void {
    if (!this.startView) return;
    this.through = null;
    if (name === "home") this.followBody(null);
    const box = this.stage?.hull?.box;
    this.orbit.fly(name === "person" && box ? viewOf(box, this.orbit.now, this.fovDeg) : presetView(name, this.startView));
    this.changed();
  }

  /** The view or what is drawn changed: the address, the panel and the wants follow. */
  changed(): void {
    this.invalidate();
    this.observer.view();
    this.updateWant();
  }

  /** Says what this page can use now. */
  updateWant(): void {
    const { quality, mode, colour, layers, through, opacity, wantsThumbnails } = this;
    const view = { canDraw: this.stage !== null, isHidden: document.hidden, quality, mode, colour, layers, through, opacity, wantsThumbnails };
    if (this.hello) this.connection.want(wantOf(view, this.hello));
  }

  // Time.

  lookBack(ms: number): void {
    this.frames.lookBack(ms);
    this.invalidate();
  }

  goLive(): void {
    this.frames.goLive();
    this.invalidate();
  }

  // What comes.

  private apply(event: RunEvent): void {
    const before = this.run;
    this.run = reduce(before, event);
    if (this.run === before) return;
    this.observer.run(before, this.run);
    // An ended run is looked for again and again: its last picture stands meanwhile.
    if (isStale(before) !== isStale(this.run)) this.invalidate();
  }

  private onLink(state: LinkState, retryInMs: number | null, why: string | null): void {
    if (state === "lost") {
      this.frames.disconnected();
      this.apply({ type: "lost", why, retryAtMs: performance.now() + (retryInMs ?? 0) });
    } else {
      this.apply({ type: state === "open" ? "opened" : "connecting" });
    }
  }

  private onText(text: Text): void {
    switch (text.op) {
      case "hello":
        void this.onHello(text);
        break;
      case "scene":
        this.scene = text;
        this.stage?.setScene(text);
        if (this.follow !== null && !text.bodies.some(({ id }) => id === this.follow)) this.followBody(null);
        this.isOutdated = true;
        this.observer.scene(text);
        this.invalidate();
        break;
      case "status":
        this.status = text;
        if (this.stage?.cameras?.health(new Set((text.cameras ?? []).flatMap((camera, index) => (isGone(camera) ? [index] : []))))) this.invalidate();
        // Worlds tell it sooner, but none comes before the first step.
        if (this.worlds.newest() === null) this.apply({ type: "paused", isPaused: text.paused ?? false });
        this.apply({ type: "end", isAtEnd: text.replay?.ended ?? false });
        this.apply({ type: "blind", why: text.blind ?? text.progress?.blind ?? null });
        this.observer.status(text);
        break;
      default:
        break;
    }
  }

  private async onHello(hello: Hello): Promise<void> {
    const before = this.hello;
    this.hello = hello;
    const sameRig = before !== null && JSON.stringify([before.cameras, before.rule, before.volume, before.up]) === JSON.stringify([hello.cameras, hello.rule, hello.volume, hello.up]);
    if (before && before.session !== hello.session) {
      this.worlds.clear();
      this.frames.forget();
    }
    this.frames.setup(hello);
    if (!sameRig) {
      this.through = null;
      this.orbit = new Orbit(hello.up, hello.floor_m, startView(hello));
      this.orbit.reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;
      this.startView = this.orbit.now;
      this.met = false;
    }
    // The shaders compile meanwhile; everything else is there at once.
    const compiled = sameRig ? null : this.stage?.setRig(hello);
    this.apply({ type: "hello", isReplay: hello.replay });
    this.observer.hello(hello, before === null);
    await compiled;
    if (this.scene) this.stage?.setScene(this.scene);
    this.observer.view();
    this.updateWant();
    this.invalidate();
  }

  private onBinary(type: number, buffer: ArrayBuffer): void {
    if (type === 1) {
      this.frames.came(buffer, !document.hidden && this.stage !== null);
    } else if (type === 2) {
      try {
        const world = parseMessage(buffer) as WorldMessage;
        this.worlds.add(world);
        this.apply({ type: "paused", isPaused: world.paused });
      } catch (error) {
        this.observer.fault(error instanceof Error ? error.message : String(error));
      }
    } else if (type === 3 && this.hello) {
      void this.images.came(buffer, this.hello).then((isSeen) => isSeen && this.invalidate());
    }
  }

  /** Unless a view was chosen, the first is of the person, wherever in the volume that is. */
  meetPerson(box: Box | null): void {
    if (this.met || !box || !this.hello) return;
    this.met = true;
    if (!isPerson(box) || this.orbit.now !== this.startView) return;
    this.orbit.jump(startView(this.hello, box));
    this.startView = this.orbit.now;
  }

  private listen(): void {
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.drawing?.lost();
      this.stage?.release();
      this.apply({ type: "card", isLost: true });
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.apply({ type: "card", isLost: false });
      this.frames.again();
      this.invalidate();
    });
    document.addEventListener("visibilitychange", () => {
      this.updateWant();
      this.invalidate();
    });
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (!this.stage || clientWidth === 0 || clientHeight === 0) return;
    this.stage.resize(clientWidth, clientHeight, Math.min(devicePixelRatio, 2));
    this.invalidate();
  }
}
