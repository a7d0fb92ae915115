/** The page's loop: once a screen refresh, what came is taken, bodies are placed, and a picture is drawn if any changed. */
import type { Picture } from "../draw/stage.ts";
import { posesKey } from "../time/bodies.ts";
import { Rate } from "../time/clock.ts";
import type { Moment } from "../time/worlds.ts";
import type { App } from "./app.ts";
import { TouchEffects } from "./touch_effects.ts";

/** A moment of bodies without any hull is shown so much late, seconds: two steps at 60 a second lie in it. */
const BEHIND_S = 0.05;
/** Bodies run on by so much after the frame they belong to, seconds. */
const AHEAD_S = 0.12;
/** A person whose frame is older is gone: bodies go on without, seconds. */
const GONE_S = 1;

export class Loop {
  /** Bytes that came. */
  readonly received = new Rate(4000);
  private readonly app: App;
  private readonly touchEffects: TouchEffects;
  private last = 0;
  private receivedBefore = 0;
  private poses = "";
  /** The bodies of the frame that is looked back at: they stay as it does, though the worlds around it are forgotten. */
  private held: { readonly frame: number; readonly moment: Moment } | null = null;

  constructor(app: App) {
    this.app = app;
    this.touchEffects = new TouchEffects(app);
  }

  start(): void {
    requestAnimationFrame((now) => this.round(now));
  }

  private round(now: number): void {
    requestAnimationFrame((next) => this.round(next));
    const { app } = this;
    const seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    this.countBytes(now);
    if (app.orbit.step(now / 1000, seconds, app.held)) app.changed();
    if (!app.drawing) {
      app.moment = app.worlds.live(0);
      return;
    }
    app.frames.look(now);
    app.frames.unstall(now);
    if (!app.drawing.isFree(now, app.frames.isReady)) return;
    this.showFrame(now);
    this.placeBodies(now);
    this.touchEffects.update(now);
    app.drawing.drawIfOld(now, () => this.picture(), app.isStanding);
  }

  private countBytes(now: number): void {
    const { received } = this.app.connection;
    if (received > this.receivedBefore) this.received.add(now, received - this.receivedBefore);
    this.receivedBefore = received;
  }

  /** Takes what is decoded onto the card. */
  private showFrame(now: number): void {
    const { app } = this;
    const set = app.frames.take(now, app.run.isPaused);
    if (!set) return;
    app.meetPerson(set.box);
    app.stage!.showFrame(set);
    app.invalidate();
  }

  private placeBodies(now: number): void {
    const { app } = this;
    const moment = this.momentOf(now);
    const key = moment && posesKey(moment, app.layers.has("touches"));
    if (!moment || (key === this.poses && !app.isOutdated)) return;
    this.poses = key!;
    app.isOutdated = false;
    app.moment = moment;
    app.stage!.showWorld(moment.world, moment.bodies, app.layers.has("touches"));
    const followed = app.follow === null ? null : moment.bodies.find(({ id }) => id === app.follow);
    if (followed) app.orbit.follow(followed.position);
    app.invalidate();
  }

  /** Where bodies are at the moment of the frame that is shown; without one, now. */
  private momentOf(now: number): Moment | null {
    const { frames, worlds, mode, moment } = this.app;
    const { shown, playout } = frames;
    const newest = worlds.newest();
    // Worlds stand still while paused: then the newest is the moment.
    if (playout.live && newest?.paused) return { world: newest, bodies: newest.bodies };
    const elapsed = shown ? (now - shown.atMs) / 1000 : Infinity;
    if (shown && !playout.live && !playout.isPlaying) return this.heldAt(shown.frame) ?? moment;
    this.held = null;
    const hasHull = mode !== "off" || !playout.live;
    const ofFrame = shown && hasHull && elapsed < GONE_S ? worlds.atFrame(shown.frame, Math.min(elapsed, AHEAD_S)) : null;
    return ofFrame ?? (playout.live ? worlds.live(BEHIND_S) : moment);
  }

  private heldAt(frame: number): Moment | null {
    if (this.held?.frame === frame) return this.held.moment;
    const moment = this.app.worlds.atFrame(frame, 0);
    this.held = moment && { frame, moment };
    return moment;
  }

  /** What is on the screen as PNG, drawn once more, at full effort if it is not refined. */
  async screenshot(): Promise<Blob | null> {
    const { drawing, canvas } = this.app;
    if (!drawing || drawing.isLost) return null;
    if (!drawing.drawRefined()) drawing.draw(performance.now(), 0, this.picture());
    // Before the browser shows it and forgets it.
    return new Promise((done) => canvas.toBlob(done, "image/png"));
  }

  /** What is to be drawn. */
  private picture(): Omit<Picture, "level"> {
    const { app } = this;
    const camera = app.through === null ? null : app.rig[app.through];
    const ratio = app.stage!.size()[0] / Math.max(1, app.canvas.clientWidth);
    return {
      eye: app.orbit.eye(),
      target: app.orbit.now.target,
      up: app.orbit.frame[1],
      fovDeg: app.fovDeg,
      through: camera ? { camera, opacity: app.opacity, inFront: app.inFront } : null,
      mode: app.mode,
      isGrey: app.isGrey,
      layers: app.layers,
      covered: [app.covered[0] * ratio, app.covered[1] * ratio],
    };
  }
}
