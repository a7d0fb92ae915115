/**
 * When pictures are drawn, and how finely: only what changed, one at a time, as fast as the card is done with them. What
 * stands is refined, and then nothing is drawn until something changes.
 */
import { LEVELS, type Quality } from "../draw/quality.ts";
import { type Part, Refinement, REST_MS } from "../draw/refinement.ts";
import type { Picture, Stage } from "../draw/stage.ts";
import { Rate } from "../time/clock.ts";

/** With nothing going on, one picture at full effort is drawn after so long, milliseconds. */
const IDLE_MS = 300;
/** The card is not waited for longer than this, milliseconds: a lost context never signals. */
const FENCE_TIMEOUT_MS = 5000;

/** What drawing reports. */
export interface DrawingListener {
  /** The card is done with the last picture. */
  drawn(): void;
  /** Pictures are drawn more or less finely from now on. */
  levelChanged(): void;
}

export class Drawing {
  /** Pictures so far. */
  count = 0;
  readonly rate = new Rate();
  private readonly stage: Stage;
  private readonly quality: Quality;
  /** The level at which a picture that stands is drawn: without a graphics card it must not take seconds. */
  private readonly finest: number;
  private readonly listener: DrawingListener;
  private isOld = true;
  private drawnAt = 0;
  private drawnLevel = 0;
  /** When the card was done with the last picture of something new. */
  private doneAt = Infinity;
  private readonly refinement = new Refinement();
  /** What the card draws now; part: of a picture that is refined. */
  private fence: { sync: WebGLSync; began: number; part: Part | null } | null = null;

  constructor(stage: Stage, quality: Quality, finest: number, listener: DrawingListener) {
    this.stage = stage;
    this.quality = quality;
    this.finest = finest;
    this.listener = listener;
  }

  /** Something changed that is seen. */
  invalidate(): void {
    this.isOld = true;
  }

  /** Pictures whose mean is on the screen; 0: one picture as it was drawn. */
  get refined(): number {
    return this.refinement.count;
  }

  /** Whether the card has lost everything, and is not back. */
  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  /** The card lost everything, and what was being drawn. */
  lost(): void {
    this.fence = null;
    this.doneAt = Infinity;
    this.refinement.drop();
    this.listener.drawn();
  }

  /** Whether a picture may be begun: the card is there, done with the last one, and it is time. */
  isFree(now: number, isNew: boolean): boolean {
    if (this.fence && !this.isDone(now, this.fence)) return false;
    if (this.isLost) return false;
    return this.isIdle(now, isNew) || now - this.drawnAt >= this.quality.level.everyMs;
  }

  /** Draws if anything changed, or if it has stood long enough for a better picture; standing: nothing changes by itself. */
  drawIfOld(now: number, picture: () => Omit<Picture, "level">, isStanding: boolean): void {
    if (this.isOld) this.draw(now, this.quality.number, picture());
    else if (isStanding) this.refine(now, picture);
    else if (this.isIdle(now, false)) this.draw(now, Math.min(this.finest, this.quality.number), picture());
  }

  /** Draws now. */
  draw(now: number, level: number, picture: Omit<Picture, "level">): void {
    this.isOld = false;
    this.refinement.drop();
    this.drawnLevel = level;
    this.doneAt = Infinity;
    this.stage.draw({ ...picture, level: LEVELS[level] });
    this.drawn(now, null);
  }

  /** Draws the refined picture once more, if there is one and nothing has changed since; returns whether it did. */
  drawRefined(): boolean {
    if (this.isOld || !this.refinement.isComplete) return false;
    this.stage.showRefined();
    return true;
  }

  /** Draws the next part of a finer picture, if what is seen has stood long enough. */
  private refine(now: number, picture: () => Omit<Picture, "level">): void {
    if (now - this.doneAt < REST_MS) return;
    const part = this.refinement.next();
    if (!part) return;
    const { finest, quality } = this;
    const level = quality.fixed ?? Math.min(finest, quality.number);
    this.stage.refine({ ...picture(), level: { ...LEVELS[level], scale: 1 } }, part);
    // When the world goes on without a change, there is nothing finer to draw.
    if (part.rows === null) this.drawnLevel = level;
    this.drawn(now, part);
  }

  /** A picture, or a part of one, is on its way. */
  private drawn(now: number, part: Part | null): void {
    this.drawnAt = now;
    if (!part || part.rows === null) {
      this.count++;
      this.rate.add(now);
    }
    const { gl } = this;
    if (this.fence) gl.deleteSync(this.fence.sync);
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.fence = sync && { sync, began: performance.now(), part };
    if (sync) return;
    if (!part) this.doneAt = now;
    this.listener.drawn();
  }

  private get gl(): WebGL2RenderingContext {
    return this.stage.renderer.getContext() as WebGL2RenderingContext;
  }

  private isIdle(now: number, isNew: boolean): boolean {
    return !this.isOld && !isNew && now - this.drawnAt > IDLE_MS && this.drawnLevel > this.finest && this.quality.fixed === null;
  }

  private isDone(now: number, { sync, began, part }: { sync: WebGLSync; began: number; part: Part | null }): boolean {
    const { gl } = this;
    const state = gl.clientWaitSync(sync, 0, 0);
    if (state === gl.TIMEOUT_EXPIRED && now - began < FENCE_TIMEOUT_MS) return false;
    gl.deleteSync(sync);
    this.fence = null;
    const tookMs = performance.now() - began;
    if (part) {
      this.refinement.took(part, tookMs);
      return true;
    }
    this.doneAt = now;
    this.listener.drawn();
    if (this.drawnLevel === this.quality.number) {
      const before = this.quality.number;
      this.quality.took(tookMs);
      if (before !== this.quality.number) this.listener.levelChanged();
    }
    return true;
  }
}
