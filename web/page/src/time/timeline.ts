/** The frame sets of the last seconds as they came, for looking back while the world goes on. */

/** How far back one can look, milliseconds. */
export const SPAN_MS = 10_000;
/** Ten seconds of eight VGA cameras are 20 MB. */
export const MAX_BYTES = 64 * 1024 * 1024;

/** One encoded frame set and when it came. */
export interface KeptSet {
  readonly atMs: number;
  readonly frame: number;
  readonly message: ArrayBuffer;
}

export class Timeline {
  private readonly kept: KeptSet[] = [];
  private bytes = 0;

  /** Keeps a set; forgets those too old, or too much. */
  add(entry: KeptSet): void {
    this.kept.push(entry);
    this.bytes += entry.message.byteLength;
    while (this.kept.length > 1 && (this.bytes > MAX_BYTES || entry.atMs - this.kept[0].atMs > SPAN_MS)) {
      this.bytes -= this.kept.shift()!.message.byteLength;
    }
  }

  clear(): void {
    this.kept.length = 0;
    this.bytes = 0;
  }

  get byteLength(): number {
    return this.bytes;
  }

  get length(): number {
    return this.kept.length;
  }

  /** The set that came last. */
  newest(): KeptSet | null {
    return this.kept.at(-1) ?? null;
  }

  /** The first and the last moment that are kept; null if nothing is. */
  span(): readonly [number, number] | null {
    return this.kept.length > 0 ? [this.kept[0].atMs, this.kept[this.kept.length - 1].atMs] : null;
  }

  /** The set that was on at a moment: the last that came at or before it, or the first. */
  at(ms: number): KeptSet | null {
    if (this.kept.length === 0) return null;
    let [low, high] = [0, this.kept.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.kept[middle].atMs <= ms) low = middle;
      else high = middle - 1;
    }
    return this.kept[low];
  }

  /** The set before (−1) or after (+1) the one that was on at a moment. */
  beside(ms: number, direction: 1 | -1): KeptSet | null {
    const now = this.at(ms);
    if (!now) return null;
    const index = this.kept.indexOf(now) + direction;
    return this.kept[Math.max(0, Math.min(this.kept.length - 1, index))];
  }
}
