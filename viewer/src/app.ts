/** The page's state and its loop: what came, what is shown, what is asked. Buttons and keys are in ui/. */
import { Decoder } from "./decode/decoder.ts";
import type { Box } from "./decode/hull_box.ts";
import type { Decoded } from "./decode/work.ts";
import { Stage } from "./draw/stage.ts";
import { LEVELS, Quality } from "./draw/quality.ts";
import { type Answer, Connection, type LinkState, type Want } from "./feed/connection.ts";
import { parseMessage, type WorldMessage } from "./feed/message.ts";
import type { Hello, Scene, Status, Text } from "./feed/text.ts";
import { Median, Rate } from "./time/clock.ts";
import { Playout } from "./time/playout.ts";
import { Timeline } from "./time/timeline.ts";
import { type Moment, Worlds } from "./time/worlds.ts";
import { HULL_MODES, type HullMode, type Layer, readHash, type ViewText, writeHash } from "./view/hash.ts";
import type { Camera, Vec3 } from "./view/lens.ts";
import { Orbit, type View } from "./view/orbit.ts";

const FOV_DEG = 42;
/** A moment of bodies without any hull is shown so much late, seconds: two steps at 60 a second lie in it. */
const BEHIND_S = 0.05;
/** Bodies run on by so much after the frame they belong to, seconds. */
const AHEAD_S = 0.12;
/** Pictures that take longer are slow: frames wait for them, not they for frames. */
const SLOW_PICTURE_MS = 80;
/** Sets that are neither shown nor followed by others for so long will never be, milliseconds. */
const STALLED_MS = 3000;
/** With nothing going on, one picture at full effort is drawn after so long, milliseconds. */
const IDLE_MS = 300;

/** What the panel and the status lines are told. */
export interface Observer {
  link(state: LinkState, retryInMs: number | null, why: string | null): void;
  hello(hello: Hello): void;
  scene(scene: Scene): void;
  status(status: Status): void;
  view(): void;
  thumbnail(camera: number, bitmap: ImageBitmap): void;
  fault(text: string): void;
}

export class App {
  readonly stage: Stage | null;
  readonly connection: Connection;
  readonly quality: Quality;
  /** The level at which a picture that stands is drawn: without a graphics card it must not take seconds. */
  private readonly finest: number;
  readonly timeline = new Timeline();
  readonly playout = new Playout(this.timeline);
  readonly worlds = new Worlds();
  orbit: Orbit = new Orbit([0, 1, 0], 0, { target: [0, 1, 0], azimuth: 0.6, polar: 1.3, distance: 4 });
  hello: Hello | null = null;
  scene: Scene | null = null;
  status: Status | null = null;
  mode: HullMode = "photo";
  layers = new Set<Layer>(["bodies", "cameras", "images", "grid", "shadows"]);
  through: number | null = null;
  opacity = 0.5;
  inFront = false;
  follow: number | null = null;
  fovDeg = FOV_DEG;
  colour: Want["colour"] = "full";
  moment: Moment | null = null;
  /** CSS pixels that panels cover at the right and at the bottom: the view's middle is that of the rest. */
  covered: readonly [number, number] = [0, 0];
  /** Whether somebody drags the view. */
  held = false;
  framesShown = 0;
  pictures = 0;
  readonly rates = { pictures: new Rate(), frames: new Rate(), bytes: new Rate(4000) };
  readonly decodeMs = new Median();
  readonly latencyMs = new Median();
  private readonly decoder = new Decoder();
  private readonly observer: Observer;
  private readonly canvas: HTMLCanvasElement;
  private ready: Decoded | null = null;
  private shown: { frame: number; atMs: number; seq: number } | null = null;
  private shownKept: number | null = null;
  /** The live set whose picture is being drawn. */
  private drawing: { seq: number; capturedUnixS: number } | null = null;
  private seeking = false;
  private dirty = true;
  private drawnAt = 0;
  private drawnLevel = 0;
  private lastLoop = 0;
  /** When a set last came or was shown. */
  private movedAt = 0;
  private fence: { sync: WebGLSync; began: number } | null = null;
  private poses = "";
  private receivedBefore = 0;
  private toFollow: string | null = null;
  private lookedThrough: number | null = null;
  private hashTimer: ReturnType<typeof setTimeout> | undefined;
  private startView: View | null = null;
  private met = false;

  constructor(canvas: HTMLCanvasElement, graphics: { antialias: boolean; software: boolean } | null, url: () => string, observer: Observer) {
    this.canvas = canvas;
    this.observer = observer;
    this.stage = graphics ? new Stage(canvas, graphics.antialias) : null;
    this.quality = new Quality(graphics?.software ? 3 : 0);
    this.finest = graphics?.software ? 2 : 0;
    this.connection = new Connection(url, {
      link: (state, retry, why) => this.onLink(state, retry, why),
      text: (text) => this.onText(text),
      binary: (type, buffer) => this.onBinary(type, buffer),
      complaint: (why) => observer.fault(why),
    });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.fence = null;
      this.drawn();
      this.stage?.release();
      observer.fault("The graphics card was lost; waiting for it.");
    });
    canvas.addEventListener("webglcontextrestored", () => this.onRestored());
    document.addEventListener("visibilitychange", () => {
      this.updateWant();
      this.invalidate();
    });
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  start(): void {
    this.connection.connect();
    requestAnimationFrame((now) => this.loop(now));
  }

  /** Something changed that is seen. */
  invalidate(): void {
    this.dirty = true;
  }

  get rig(): readonly Camera[] {
    return this.stage?.rig ?? [];
  }

  // What is asked of the run.

  command(command: string, fields: Record<string, unknown> = {}): Promise<Answer> {
    return this.connection.command(command, fields);
  }

  get paused(): boolean {
    return this.worlds.newest()?.paused ?? this.status?.paused ?? false;
  }

  get controller(): boolean {
    return this.hello?.controller ?? false;
  }

  // The view.

  setMode(mode: HullMode): void {
    this.mode = mode;
    this.changed();
  }

  nextMode(): void {
    this.setMode(HULL_MODES[(HULL_MODES.indexOf(this.mode) + 1) % HULL_MODES.length]);
  }

  setLayer(layer: Layer, on: boolean): void {
    if (on) this.layers.add(layer);
    else this.layers.delete(layer);
    this.changed();
  }

  /** Bodies are marked otherwise now. */
  placeAnew(): void {
    this.poses = "";
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
    const start = this.startView;
    const around = this.personView();
    const views: Record<string, View> = {
      home: start,
      front: { ...start, azimuth: 0, polar: 1.48 },
      left: { ...start, azimuth: Math.PI / 2, polar: 1.48 },
      top: { ...start, polar: 0.05, azimuth: 0 },
      person: around,
    };
    if (name === "home") this.followBody(null);
    this.orbit.fly(views[name] ?? start);
    this.changed();
  }

  private personView(): View {
    const box = this.stage?.hull?.box;
    if (!box) return this.startView!;
    const target = box.low.map((l, i) => (l + box.high[i]) / 2) as unknown as Vec3;
    const radius = 0.5 * Math.hypot(...box.low.map((l, i) => box.high[i] - l));
    return { ...this.orbit.now, target, distance: (radius / Math.sin((this.fovDeg * Math.PI) / 360)) * 1.05 };
  }

  /** Follows the body that an address named, as soon as it is there. */
  private followNamed(): void {
    const body = this.toFollow === null ? null : this.scene?.bodies.find(({ name }) => name === this.toFollow);
    if (!body) return;
    this.toFollow = null;
    this.followBody(body.id);
  }

  viewText(): ViewText {
    return {
      eye: this.orbit.eye(),
      target: this.orbit.now.target,
      ...(this.fovDeg !== FOV_DEG ? { fovDeg: this.fovDeg } : {}),
      mode: this.mode,
      layers: this.layers,
      ...(this.through !== null ? { camera: this.rig[this.through]?.name } : {}),
      ...(this.follow !== null && this.stage?.bodies.text(this.follow) ? { follow: this.stage.bodies.text(this.follow)!.name } : {}),
    };
  }

  applyHash(hash: string): void {
    const view = readHash(hash);
    if (view.mode) this.mode = view.mode;
    if (view.layers) this.layers = new Set(view.layers);
    if (view.fovDeg) this.fovDeg = view.fovDeg;
    if (view.eye && view.target) this.orbit.jump(this.orbit.viewOf(view.eye, view.target));
    if (view.camera) {
      const index = this.rig.findIndex((camera) => camera.name === view.camera);
      this.lookThrough(index < 0 ? null : index);
    }
    this.toFollow = view.follow ?? null;
    this.followNamed();
    this.changed();
  }

  /** The view or what is drawn changed: the address, the panel and the wants follow. */
  changed(): void {
    this.invalidate();
    this.observer.view();
    this.updateWant();
    clearTimeout(this.hashTimer);
    this.hashTimer = setTimeout(() => {
      if (this.hello) history.replaceState(null, "", `${location.pathname}${location.search}#${writeHash(this.viewText())}`);
    }, 400);
  }

  // Time.

  lookBack(ms: number): void {
    this.playout.seek(ms);
    this.invalidate();
  }

  goLive(): void {
    this.playout.goLive();
    this.shownKept = null;
    this.invalidate();
  }

  // What comes.

  private onLink(state: LinkState, retry: number | null, why: string | null): void {
    if (state === "lost") {
      this.drawing = null;
      if (this.ready) close(this.ready);
      this.ready = null;
      if (this.stage?.hull) this.stage.hull.fade = 1;
      this.invalidate();
    }
    this.observer.link(state, retry, why);
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
        this.poses = "";
        this.followNamed();
        this.observer.scene(text);
        this.invalidate();
        break;
      case "status":
        this.status = text;
        this.stage?.cameras?.health(new Set((text.cameras ?? []).flatMap((camera, index) => (camera.problem ? [index] : []))));
        this.observer.status(text);
        break;
      default:
        break;
    }
  }

  private async onHello(hello: Hello): Promise<void> {
    const before = this.hello;
    const first = before === null;
    this.hello = hello;
    const sameRig = before !== null && JSON.stringify([before.cameras, before.rule, before.volume, before.up]) === JSON.stringify([hello.cameras, hello.rule, hello.volume, hello.up]);
    if (before && before.session !== hello.session) {
      // Another run: its frames count from the beginning.
      this.worlds.clear();
      this.timeline.clear();
      this.playout.goLive();
      this.shown = null;
    }
    this.decoder.setup({ cameras: hello.cameras, volume: hello.volume, offImageIsOutside: hello.rule.out_of_view === "outside" });
    if (!sameRig) {
      this.through = null;
      this.orbit = new Orbit(hello.up, hello.floor_m, this.firstView(hello));
      this.orbit.reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;
      this.startView = this.orbit.now;
      this.met = false;
    }
    this.observer.hello(hello);
    // The shaders compile meanwhile; everything else is there at once.
    const compiled = sameRig ? null : this.stage?.setRig(hello);
    if (this.stage?.hull) this.stage.hull.fade = 0;
    if (first) this.applyHash(location.hash);
    await compiled;
    if (this.scene) this.stage?.setScene(this.scene);
    this.observer.view();
    this.updateWant();
    this.invalidate();
  }

  /** Three quarters from the front, with the working volume in the picture. */
  private firstView(hello: Hello, person: Box | null = null): View {
    const { low, high } = hello.volume;
    const up = hello.up;
    const around = person ?? hello.volume;
    const middle = around.low.map((l, i) => (l + around.high[i]) / 2) as unknown as [number, number, number];
    const along = (p: readonly number[]) => p[0] * up[0] + p[1] * up[1] + p[2] * up[2];
    // People stand: the middle of what is seen is about a metre above the floor.
    const floor = hello.floor_m ?? Math.min(along(low), along(high));
    const rise = floor + 0.95 - along(middle);
    const target = middle.map((m, i) => m + rise * up[i]) as unknown as Vec3;
    const reach = Math.max(...low.map((l, i) => (up[i] > 0.5 ? 0 : high[i] - l)));
    const distance = Math.max(2.9, Math.min(7, reach * 0.85));
    const views = [0.62, 0.45, 0.8, 0.3, 0.95, 1.1, -0.62, 0.1, 1.3].map((azimuth): View => ({ target, azimuth, polar: 1.36, distance }));
    return views.find((view) => !inTheWay(hello, up, view)) ?? views[0];
  }

  private onBinary(type: number, buffer: ArrayBuffer): void {
    const now = performance.now();
    if (type === 2) {
      try {
        this.worlds.add(parseMessage(buffer) as WorldMessage);
      } catch (error) {
        this.observer.fault(error instanceof Error ? error.message : String(error));
      }
      return;
    }
    const seq = new DataView(buffer).getUint32(8, true);
    if (type === 3) {
      void this.onImages(buffer);
      return;
    }
    if (type !== 1 || buffer.byteLength < 48) return;
    this.connection.credit.received(seq);
    this.movedAt = now;
    this.timeline.add({ atMs: now, frame: Number(new DataView(buffer).getBigUint64(16, true)), message: buffer });
    if (!this.playout.live || document.hidden || !this.stage) {
      this.connection.credit.dropped(seq);
      return;
    }
    void this.decodeLive(buffer, seq);
  }

  private async decodeLive(buffer: ArrayBuffer, seq: number): Promise<void> {
    const outcome = await this.decoder.decode({ message: buffer, contours: this.mode === "cones", colour: this.mode === "photo" });
    if (outcome.op !== "decoded" || !this.playout.live) {
      this.connection.credit.dropped(seq);
      if (outcome.op === "failed") this.observer.fault(outcome.why);
      if (outcome.op === "decoded") close(outcome);
      return;
    }
    this.decodeMs.add(outcome.decodeMs);
    if (this.ready) {
      this.connection.credit.dropped(this.ready.seq);
      close(this.ready);
    }
    this.ready = outcome;
  }

  private readonly imageDecoder = new Decoder();
  private imageSetup: Hello | null = null;

  private async onImages(buffer: ArrayBuffer): Promise<void> {
    if (!this.hello) return;
    if (this.imageSetup !== this.hello) {
      this.imageSetup = this.hello;
      this.imageDecoder.setup({ cameras: this.hello.cameras, volume: this.hello.volume, offImageIsOutside: true });
    }
    const outcome = await this.imageDecoder.decode({ message: buffer, contours: false, colour: true });
    if (outcome.op === "failed") this.observer.fault(outcome.why);
    if (outcome.op !== "decoded") return;
    for (const part of outcome.cameras) {
      if (!part.image) continue;
      if (outcome.thumbnails) {
        this.observer.thumbnail(part.camera, part.image);
        if (this.stage?.cameras) this.stage.cameras.thumbnail(part.camera, part.image);
        else part.image.close();
      } else if (part.camera === this.through && this.stage?.cameras) {
        this.stage.cameras.behindImage(part.image);
      } else {
        part.image.close();
      }
    }
    this.invalidate();
  }

  /** Says what this page can use now. */
  updateWant(): void {
    if (!this.hello) return;
    const hidden = document.hidden;
    const weak = this.stage !== null && this.quality.number >= 4 && this.quality.fixed === null;
    const drawn = this.stage !== null && (this.mode === "photo" || this.mode === "shaded" || this.mode === "cones");
    this.connection.want({
      colour: this.mode === "photo" && drawn ? (weak && this.colour === "full" ? "half" : this.colour) : "off",
      fps: hidden ? 1 : Math.min(60, Math.max(1, Math.round(this.hello.fps))),
      state_hz: hidden ? 1 : 60,
      touches: this.layers.has("touches"),
      thumbnails_hz: hidden ? 0 : this.stage === null ? 4 : (this.layers.has("cameras") && this.layers.has("images")) || this.wantsThumbnails ? 1 : 0,
      image_of: this.through !== null && this.opacity > 0 ? (this.rig[this.through]?.name ?? null) : null,
      silhouettes: drawn && !hidden,
    });
  }

  /** Whether the panel shows small images. */
  wantsThumbnails = true;

  // The loop.

  private loop(now: number): void {
    requestAnimationFrame((next) => this.loop(next));
    const seconds = Math.min(0.1, (now - this.lastLoop) / 1000);
    this.lastLoop = now;
    const bytes = this.connection.received - this.receivedBefore;
    if (bytes > 0) this.rates.bytes.add(now, bytes);
    this.receivedBefore = this.connection.received;
    if (this.orbit.step(now / 1000, seconds, this.held)) this.changed();
    if (!this.stage) {
      this.moment = this.worlds.live(0);
      return;
    }
    this.lookAtTimeline(now);
    if (now - this.movedAt > STALLED_MS && this.connection.credit.outstanding > 0) {
      this.movedAt = now;
      this.connection.credit.giveBack();
    }
    if (this.fence && !this.fenceDone(now)) return;
    if (this.stage.renderer.getContext().isContextLost()) return;
    const { level } = this.quality;
    const idle = !this.dirty && !this.ready && now - this.drawnAt > IDLE_MS && this.drawnLevel > this.finest && this.quality.fixed === null;
    if (!idle && now - this.drawnAt < level.everyMs) return;
    if (this.ready) this.takeReady(now);
    this.placeBodies(now);
    if (!this.dirty && !idle) return;
    this.drawNow(now, idle ? Math.min(this.finest, this.quality.number) : this.quality.number);
  }

  /** Whoever has not chosen a view begins with one of the person, wherever in the volume that is. */
  private meetPerson(box: Box | null): void {
    if (this.met || !box || !this.hello) return;
    this.met = true;
    const wide = box.low.map((l, i) => box.high[i] - l).some((side) => side > 2.6);
    if (wide || this.orbit.now !== this.startView) return;
    this.orbit.jump(this.firstView(this.hello, box));
    this.startView = this.orbit.now;
  }

  /** Takes what is decoded onto the card. */
  private takeReady(now: number): void {
    const set = this.ready!;
    this.ready = null;
    this.meetPerson(set.box);
    this.stage!.showFrame(set);
    this.stage!.hull!.fade = 0;
    this.shown = { frame: set.frame, atMs: now, seq: set.seq };
    this.framesShown++;
    this.rates.frames.add(now);
    if (this.playout.live) this.drawing = { seq: set.seq, capturedUnixS: set.capturedUnixS };
    this.dirty = true;
  }

  /** The set that was taken last is on the screen: the server may send the next. */
  private drawn(): void {
    if (!this.drawing) return;
    this.latencyMs.add(Date.now() - this.drawing.capturedUnixS * 1000);
    this.connection.credit.slow = this.quality.averageMs > SLOW_PICTURE_MS;
    this.connection.credit.shown(this.drawing.seq);
    this.movedAt = performance.now();
    this.drawing = null;
  }

  private lookAtTimeline(now: number): void {
    const kept = this.playout.step(now);
    if (!kept || this.seeking || this.shownKept === kept.atMs) return;
    this.seeking = true;
    this.shownKept = kept.atMs;
    void this.decoder.decode({ message: kept.message, contours: this.mode === "cones", colour: this.mode === "photo" }).then((outcome) => {
      this.seeking = false;
      if (outcome.op !== "decoded") {
        this.shownKept = null;
        return;
      }
      if (this.playout.live) return close(outcome);
      if (this.ready) close(this.ready);
      this.ready = outcome;
    });
  }

  private placeBodies(now: number): void {
    const elapsed = this.shown ? (now - this.shown.atMs) / 1000 : Infinity;
    const standing = !this.playout.live && !this.playout.isPlaying;
    let moment: Moment | null = null;
    const hasHull = this.mode !== "off" || !this.playout.live;
    if (this.shown && hasHull && (elapsed < 1 || standing)) {
      moment = this.worlds.atFrame(this.shown.frame, standing ? 0 : Math.min(elapsed, AHEAD_S));
    }
    moment ??= this.playout.live ? this.worlds.live(BEHIND_S) : this.moment;
    if (!moment) return;
    const newest = this.worlds.newest();
    // Worlds stand still while paused: then the newest is the moment.
    if (this.playout.live && newest?.paused) moment = { world: newest, bodies: newest.bodies };
    const key = posesKey(moment);
    if (key === this.poses) return;
    this.poses = key;
    this.moment = moment;
    this.stage!.showWorld(moment.world, moment.bodies);
    const followed = this.follow === null ? null : moment.bodies.find(({ id }) => id === this.follow);
    if (followed) this.orbit.follow(followed.position);
    this.dirty = true;
  }

  private drawNow(now: number, level: number): void {
    const stage = this.stage!;
    this.dirty = false;
    this.drawnAt = now;
    this.drawnLevel = level;
    const camera = this.through === null ? null : this.rig[this.through];
    const ratio = stage.size()[0] / Math.max(1, this.canvas.clientWidth);
    stage.draw({
      eye: this.orbit.eye(),
      target: this.orbit.now.target,
      up: this.orbit.frame[1],
      fovDeg: this.fovDeg,
      through: camera ? { camera, opacity: this.opacity, inFront: this.inFront } : null,
      mode: this.mode,
      layers: this.layers,
      level: LEVELS[level],
      covered: [this.covered[0] * ratio, this.covered[1] * ratio],
    });
    this.pictures++;
    this.rates.pictures.add(now);
    const gl = stage.renderer.getContext() as WebGL2RenderingContext;
    if (this.fence) gl.deleteSync(this.fence.sync);
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.fence = sync ? { sync, began: performance.now() } : null;
    if (!sync) this.drawn();
  }

  /** Whether the card is done with the last picture: none is begun before. */
  private fenceDone(now: number): boolean {
    const { sync, began } = this.fence!;
    const gl = this.stage!.renderer.getContext() as WebGL2RenderingContext;
    const state = gl.clientWaitSync(sync, 0, 0);
    // A lost context never signals.
    if (state === gl.TIMEOUT_EXPIRED && now - began < 5000) return false;
    gl.deleteSync(sync);
    this.fence = null;
    this.drawn();
    if (this.drawnLevel === this.quality.number) {
      const before = this.quality.number;
      this.quality.took(performance.now() - began);
      if (before !== this.quality.number) this.updateWant();
    }
    return true;
  }

  /** The frame that is on the screen. */
  get shownFrame(): number | null {
    return this.shown?.frame ?? null;
  }

  /** What is on the screen, drawn once more at full effort, as PNG. */
  async screenshot(): Promise<Blob | null> {
    if (!this.stage) return null;
    this.drawNow(performance.now(), 0);
    // Before the browser shows it and forgets it.
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }

  /** Where a point is on the canvas, CSS pixels from its corner; null behind the view. */
  onCanvas(point: Vec3): [number, number] | null {
    if (!this.stage) return null;
    const at = this.stage.toClip(point);
    if (!at) return null;
    return [(at[0] * 0.5 + 0.5) * this.canvas.clientWidth, (0.5 - at[1] * 0.5) * this.canvas.clientHeight];
  }

  private resize(): void {
    if (!this.stage) return;
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.stage.resize(clientWidth, clientHeight, Math.min(devicePixelRatio, 2));
    this.invalidate();
  }

  private onRestored(): void {
    this.shownKept = null;
    this.invalidate();
  }
}

/** Whether a camera stands between the eye and what it looks at. */
function inTheWay(hello: Hello, up: Vec3, view: View): boolean {
  const eye = new Orbit(up, null, view).eye(view);
  const ahead = view.target.map((t, i) => (t - eye[i]) / view.distance);
  return hello.cameras.some(({ rotation: r, translation: t }) => {
    const to = [0, 1, 2].map((i) => -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]) - eye[i]);
    const away = Math.hypot(...to);
    return away < view.distance && to.reduce((sum, x, i) => sum + x * ahead[i], 0) > 0.93 * away;
  });
}

function close(set: Decoded): void {
  for (const part of set.cameras) part.image?.close();
}

/** Changes when a body is seen to move. */
function posesKey(moment: Moment): string {
  let key = `${moment.world.generation}/${moment.world.touches.length}`;
  for (const { id, position, rotation, touching, grabbed } of moment.bodies) {
    key += `|${id}${touching ? "t" : ""}${grabbed ? "g" : ""}`;
    for (const n of position) key += `,${Math.round(n * 5000)}`;
    for (const n of rotation) key += `,${Math.round(n * 5000)}`;
  }
  return key;
}
