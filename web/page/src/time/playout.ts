/**
 * What is on the screen, and when: live, each frame set as it is decoded; looking back, the sets of the
 * timeline, standing or going on. Bodies follow the frame that is shown, so that both are of one moment.
 */
import type { KeptSet, Timeline } from "./timeline.ts";

/** Looking back never goes on faster than it came. */
const RATE = 1;

export class Playout {
  private readonly timeline: Timeline;
  /** Null: live. Else the moment looked at, in the timeline's milliseconds. */
  private at: number | null = null;
  private playing = false;
  private lastMs: number | null = null;
  /** What stands on the screen while looking back: it stays though the timeline forgets it. */
  private held: KeptSet | null = null;

  constructor(timeline: Timeline) {
    this.timeline = timeline;
  }

  get live(): boolean {
    return this.at === null;
  }

  get isPlaying(): boolean {
    return this.playing;
  }

  /** The moment that is looked at, if one is. */
  get moment(): number | null {
    return this.at;
  }

  /** How far before the newest set one looks, milliseconds; null while live. */
  get behindMs(): number | null {
    const span = this.timeline.span();
    return this.at === null ? null : span ? Math.max(0, span[1] - this.at) : 0;
  }

  /** Whether the timeline has forgotten the moment that is looked at. */
  get isForgotten(): boolean {
    const span = this.timeline.span();
    return this.at !== null && span !== null && this.at < span[0];
  }

  goLive(): void {
    this.at = null;
    this.held = null;
    this.playing = false;
    this.lastMs = null;
  }

  /** Looks at a moment; the picture stands. */
  seek(ms: number): void {
    const span = this.timeline.span();
    if (!span) return;
    this.at = Math.max(span[0], Math.min(span[1], ms));
    this.held = null;
    this.playing = false;
  }

  /** A picture back or on. */
  beside(direction: 1 | -1): void {
    const span = this.timeline.span();
    // Nothing before a moment that is forgotten is kept.
    if (!span || (direction < 0 && this.isForgotten)) return;
    const there = this.isForgotten ? span[0] : this.timeline.beside(this.at ?? span[1], direction)?.atMs;
    if (there !== undefined) this.seek(there);
  }

  play(playing: boolean): void {
    if (this.at === null && playing) return;
    if (this.at === null) {
      const span = this.timeline.span();
      if (!span) return;
      this.at = span[1];
    }
    this.playing = playing;
    this.lastMs = null;
    this.held = null;
  }

  /** Moves on; the set that is to be shown then, or null while live. */
  step(nowMs: number): KeptSet | null {
    const span = this.timeline.span();
    if (this.at === null || !span) return null;
    if (!this.playing) {
      this.held ??= this.timeline.at(this.at);
      return this.held;
    }
    // What is forgotten cannot be played.
    this.at = Math.max(span[0], this.at + (nowMs - (this.lastMs ?? nowMs)) * RATE);
    this.lastMs = nowMs;
    if (this.at >= span[1]) this.goLive();
    return this.at === null ? null : this.timeline.at(this.at);
  }
}
