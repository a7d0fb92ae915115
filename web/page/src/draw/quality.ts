/** How much is drawn, by how long it takes: a page on a weak machine shows less, and never stands still. */

/** What one level means. */
export interface Level {
  /** Of the person's picture, to the screen. */
  readonly scale: number;
  readonly photoTests: number;
  /** Depth maps are made at so many halvings of their size. */
  readonly coarseMaps: number;
  /** Texels across the shadow map. */
  readonly shadowSize: number;
  /** Least time between drawings, milliseconds. */
  readonly everyMs: number;
}

export const LEVELS: readonly Level[] = [
  { scale: 1, photoTests: 8, coarseMaps: 0, shadowSize: 1024, everyMs: 0 },
  { scale: 0.75, photoTests: 8, coarseMaps: 0, shadowSize: 1024, everyMs: 0 },
  { scale: 0.75, photoTests: 4, coarseMaps: 0, shadowSize: 512, everyMs: 0 },
  { scale: 0.5, photoTests: 2, coarseMaps: 1, shadowSize: 512, everyMs: 0 },
  { scale: 0.5, photoTests: 0, coarseMaps: 1, shadowSize: 256, everyMs: 0 },
  { scale: 0.35, photoTests: 0, coarseMaps: 1, shadowSize: 256, everyMs: 66 },
];

/** Longer than this is too long, shorter than that has room, milliseconds a drawing. */
const SLOW_MS = 42;
const FAST_MS = 15;
/** Drawings in a row before a level changes: down soon, up late. */
const DOWN_AFTER = 6;
const UP_AFTER = 90;

export class Quality {
  private index: number;
  private slow = 0;
  private fast = 0;
  private average = 0;
  /** Null adapts; a number stays. */
  fixed: number | null = null;

  constructor(start = 0) {
    this.index = start;
  }

  get level(): Level {
    return LEVELS[this.fixed ?? this.index];
  }

  get number(): number {
    return this.fixed ?? this.index;
  }

  get averageMs(): number {
    return this.average;
  }

  /** A drawing took so long, until the graphics card was done with it. */
  took(ms: number): void {
    this.average = this.average === 0 ? ms : this.average * 0.9 + ms * 0.1;
    this.slow = ms > SLOW_MS ? this.slow + 1 : Math.max(0, this.slow - 1);
    this.fast = ms < FAST_MS ? this.fast + 1 : 0;
    if (this.slow >= DOWN_AFTER && this.index < LEVELS.length - 1) this.set(this.index + 1);
    else if (this.fast >= UP_AFTER && this.index > 0) this.set(this.index - 1);
  }

  private set(index: number): void {
    this.index = index;
    this.slow = 0;
    this.fast = 0;
  }
}
