/**
 * A silhouette's runs: row by row the number of runs, and for each run the gap before it (less one after the
 * first, since runs do not touch) and its length less one, as LEB128 numbers.
 */

/** Why bytes are no runs: one line. */
export class RunsError extends Error {}

/** Runs as they lie in rows: run i of row r is columns `starts[i]` to `ends[i]` (exclusive). */
export interface Runs {
  readonly width: number;
  readonly height: number;
  /** The first run of each row, and one more: where the last row's runs end. */
  readonly rows: Uint32Array;
  readonly starts: Uint16Array;
  readonly ends: Uint16Array;
  /** Foreground pixels. */
  readonly area: number;
  /** The box around all runs, right and bottom exclusive; null if there are none. */
  readonly bounds: Rect | null;
}

/** A rectangle of pixels; right and bottom are exclusive. */
export interface Rect {
  readonly left: number;
  readonly top: number;
  readonly right: number;
  readonly bottom: number;
}

/** Reads the runs of an image of that size, or throws a {@link RunsError}. */
export function decodeRuns(bytes: Uint8Array, width: number, height: number): Runs {
  const reader = new Reader(bytes);
  const rows = new Uint32Array(height + 1);
  // A run takes two bytes or more, so these bounds hold whatever the bytes claim.
  const most = Math.min(bytes.length >> 1, ((width >> 1) + 1) * height);
  const starts = new Uint16Array(most);
  const ends = new Uint16Array(most);
  let [run, area] = [0, 0];
  let [left, top, right, bottom] = [width, height, 0, 0];
  for (let row = 0; row < height; row++) {
    rows[row] = run;
    const count = reader.number();
    if (count > (width >> 1) + 1 || run + count > most) throw new RunsError(`row ${row} claims ${count} runs of ${width} pixels`);
    let after = 0;
    for (let index = 0; index < count; index++) {
      const start = after + reader.number() + (index > 0 ? 1 : 0);
      const end = start + reader.number() + 1;
      if (end > width) throw new RunsError(`row ${row}: a run ends at ${end}, the image at ${width}`);
      starts[run] = start;
      ends[run] = end;
      run++;
      area += end - start;
      if (start < left) left = start;
      if (end > right) right = end;
      after = end;
    }
    if (count > 0) {
      if (row < top) top = row;
      bottom = row + 1;
    }
  }
  rows[height] = run;
  if (!reader.atEnd()) throw new RunsError(`${reader.left()} bytes are left after the last row`);
  const bounds = run > 0 ? { left, top, right, bottom } : null;
  return { width, height, rows, starts: starts.subarray(0, run), ends: ends.subarray(0, run), area, bounds };
}

/** What is in either of two pictures of one size. */
export function union(a: Runs, b: Runs): Runs {
  const rows = new Uint32Array(a.height + 1);
  const starts = new Uint16Array(a.starts.length + b.starts.length);
  const ends = new Uint16Array(starts.length);
  let [run, area] = [0, 0];
  for (let row = 0; row < a.height; row++) {
    rows[row] = run;
    let [i, j] = [a.rows[row], b.rows[row]];
    const [lastOfA, lastOfB] = [a.rows[row + 1], b.rows[row + 1]];
    while (i < lastOfA || j < lastOfB) {
      const isOfA = j >= lastOfB || (i < lastOfA && a.starts[i] <= b.starts[j]);
      const [start, end] = isOfA ? [a.starts[i], a.ends[i++]] : [b.starts[j], b.ends[j++]];
      if (run > rows[row] && start <= ends[run - 1]) {
        area += Math.max(0, end - ends[run - 1]);
        ends[run - 1] = Math.max(ends[run - 1], end);
        continue;
      }
      starts[run] = start;
      ends[run++] = end;
      area += end - start;
    }
  }
  rows[a.height] = run;
  return { width: a.width, height: a.height, rows, starts: starts.subarray(0, run), ends: ends.subarray(0, run), area, bounds: around(a.bounds, b.bounds) };
}

function around(a: Rect | null, b: Rect | null): Rect | null {
  if (!a || !b) return a ?? b;
  return { left: Math.min(a.left, b.left), top: Math.min(a.top, b.top), right: Math.max(a.right, b.right), bottom: Math.max(a.bottom, b.bottom) };
}

class Reader {
  private at = 0;
  private readonly bytes: Uint8Array;

  constructor(bytes: Uint8Array) {
    this.bytes = bytes;
  }

  /** A number below 2^21: three bytes hold any column. */
  number(): number {
    let value = 0;
    for (let shift = 0; shift < 21; shift += 7) {
      if (this.at >= this.bytes.length) throw new RunsError(`runs end after ${this.bytes.length} bytes, expected more`);
      const byte = this.bytes[this.at++];
      value |= (byte & 0x7f) << shift;
      if (byte < 0x80) return value;
    }
    throw new RunsError(`a number at byte ${this.at} is larger than any column`);
  }

  atEnd(): boolean {
    return this.at === this.bytes.length;
  }

  left(): number {
    return this.bytes.length - this.at;
  }
}
