/**
 * How a picture that stands is refined: it is the mean of pictures whose pixels are shifted by less than a pixel, and each
 * of these is drawn in short parts. Pure: no clock, no graphics card.
 */

/** The mean is of so many pictures. */
export const SAMPLES = 16;
/** A picture that has stood for so long is refined, milliseconds after the graphics card was done with it. */
export const REST_MS = 300;
/** Input waits for the part that is being drawn: a part should take no longer, milliseconds. */
const PART_MS = 60;
/** Shares of the person's rows that a part draws: at first, and at least. */
const FIRST_SHARE = 0.25;
const LEAST_SHARE = 1 / 16;

/** How far the pixels of each picture are shifted, right and down, pixels: Halton's points in bases 2 and 3, their mean moved to zero. */
export const SHIFTS: readonly (readonly [number, number])[] = shifts();

/** What is drawn in one go. */
export interface Part {
  /** Which of the pictures this is a part of, from 0. */
  readonly sample: number;
  /** Shares of the person's rows from the bottom, from and to; null: the scene around the person, which completes the picture. */
  readonly rows: readonly [number, number] | null;
}

/** Which part comes next, and how large it is. */
export class Refinement {
  private samples = 0;
  private rows = 0;
  private share = FIRST_SHARE;

  /** Complete pictures so far, 0 to {@link SAMPLES}. */
  get count(): number {
    return this.samples;
  }

  get isComplete(): boolean {
    return this.samples === SAMPLES;
  }

  /** The part to draw now; null if the picture is as fine as it becomes. */
  next(): Part | null {
    const sample = this.samples;
    if (this.isComplete) return null;
    if (this.rows === 1) {
      this.rows = 0;
      this.samples++;
      return { sample, rows: null };
    }
    const from = this.rows;
    // A rest that is smaller than half a part is drawn with it.
    this.rows = from + 1.5 * this.share >= 1 ? 1 : from + this.share;
    return { sample, rows: [from, this.rows] };
  }

  /** A part of the person took so long: the next ones are larger or smaller. */
  took(part: Part, ms: number): void {
    if (part.rows === null) return;
    const factor = Math.max(0.5, Math.min(2, PART_MS / Math.max(1, ms)));
    this.share = Math.max(LEAST_SHARE, Math.min(1, this.share * factor));
  }

  /** Something changed: the next part is the first one of the first picture. */
  drop(): void {
    this.samples = 0;
    this.rows = 0;
  }
}

function shifts(): [number, number][] {
  const points = Array.from({ length: SAMPLES }, (_, index): [number, number] => [halton(index + 1, 2), halton(index + 1, 3)]);
  const mean = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / SAMPLES);
  return points.map(([x, y]) => [x - mean[0], y - mean[1]]);
}

/** An index's digits in a base, mirrored behind the point: 0 to 1. */
function halton(index: number, base: number): number {
  let [sum, digit] = [0, 1];
  for (let rest = index; rest > 0; rest = Math.floor(rest / base)) {
    digit /= base;
    sum += digit * (rest % base);
  }
  return sum;
}
