/** What the last minute was like: figures of the run, as they came. */

/** Samples are kept for so long, milliseconds. */
export const KEPT_MS = 60_000;
/** Two samples are not joined if more time passed between them, milliseconds. */
const GAP_MS = 2000;
/** A frame that is late counts as missed until it is used: a count has settled once so many samples in a row agree. */
const SETTLED = 3;
/** The first status of a page may be older than the page. */
const STALE = 1;

/** A figure at a time of the page's clock, milliseconds; null where there was none. */
export interface Sample {
  readonly atMs: number;
  readonly value: number | null;
}

/** One figure over the last minute. */
export class LastMinute {
  private samples: Sample[] = [];

  add(atMs: number, value: number | null): void {
    this.samples.push({ atMs, value });
    this.forget(atMs);
  }

  clear(): void {
    this.samples = [];
  }

  /** The greatest of them; null if there is none. */
  most(nowMs: number): number | null {
    this.forget(nowMs);
    return this.samples.reduce<number | null>((most, { value }) => (value === null ? most : Math.max(most ?? value, value)), null);
  }

  /** The pieces that are without a gap, oldest first. */
  pieces(nowMs: number): Sample[][] {
    this.forget(nowMs);
    const pieces: Sample[][] = [];
    let piece: Sample[] = [];
    for (const sample of this.samples) {
      const last = piece.at(-1);
      if (last && (sample.value === null || sample.atMs - last.atMs > GAP_MS)) {
        pieces.push(piece);
        piece = [];
      }
      if (sample.value !== null) piece.push(sample);
    }
    if (piece.length > 0) pieces.push(piece);
    return pieces;
  }

  private forget(nowMs: number): void {
    while (this.samples.length > 0 && nowMs - this.samples[0].atMs > KEPT_MS) this.samples.shift();
  }
}

/** How much a count of missed frames grows from sample to sample. */
export class Growth {
  private counts: number[] = [];
  private stale = STALE;
  private settled: number | null = null;

  /** By how much it has grown since the sample before; null if that is not known yet. */
  increase(count: number | null): number | null {
    if (count === null || this.stale > 0) {
      this.counts = [];
      this.settled = null;
      if (count !== null) this.stale--;
      return null;
    }
    this.counts = [...this.counts, count].slice(-SETTLED);
    const { settled } = this;
    if (this.counts.length < SETTLED) return null;
    this.settled = Math.min(...this.counts);
    return settled === null ? 0 : Math.max(0, this.settled - settled);
  }

  /** Another run, or the same after a gap: what was counted meanwhile is not of one moment. */
  restart(): void {
    this.counts = [];
    this.settled = null;
    this.stale = STALE;
  }
}
