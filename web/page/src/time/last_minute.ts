/** What the last minute was like: figures of the run, as they came. */

/** So long is kept, milliseconds. */
export const KEPT_MS = 60_000;
/** A gap longer than this between two figures is drawn as one, milliseconds. */
export const GAP_MS = 2000;

/** A figure at a time of the page's clock, milliseconds; null where there was none. */
export interface Figure {
  readonly atMs: number;
  readonly value: number | null;
}

/** One figure over the last minute. */
export class LastMinute {
  private readonly figures: Figure[] = [];

  add(atMs: number, value: number | null): void {
    this.figures.push({ atMs, value });
    while (this.figures.length > 0 && atMs - this.figures[0].atMs > KEPT_MS) this.figures.shift();
  }

  /** The greatest of them; null if there is none. */
  most(): number | null {
    const values = this.figures.flatMap(({ value }) => (value === null ? [] : [value]));
    return values.length > 0 ? Math.max(...values) : null;
  }

  /** The pieces that are without a gap, oldest first. */
  pieces(): Figure[][] {
    const pieces: Figure[][] = [];
    let piece: Figure[] = [];
    for (const figure of this.figures) {
      const last = piece.at(-1);
      if (last && (figure.value === null || figure.atMs - last.atMs > GAP_MS)) {
        pieces.push(piece);
        piece = [];
      }
      if (figure.value !== null) piece.push(figure);
    }
    if (piece.length > 0) pieces.push(piece);
    return pieces;
  }
}

/** How much a count has grown since it was last told: nothing at first, and nothing where it began again. */
export class Growth {
  private before: number | null = null;

  of(count: number | null): number | null {
    const { before } = this;
    this.before = count;
    return count === null ? null : Math.max(0, count - (before ?? count));
  }
}
