/**
 * Which frame sets are shown. A node that was too busy for its part leaves its cameras out, and of fewer cameras a
 * person is far too large: such sets are refused, unless for some seconds no other has come.
 */

/** So long after a set of all cameras, or after the first set of a connection, sets that lack some are refused. */
export const REFUSAL_MS = 5000;

export class WholeSets {
  private cameras = 0;
  private sinceMs: number | null = null;

  /** A connection to a run of so many cameras. */
  setup(cameras: number): void {
    this.cameras = cameras;
    this.sinceMs = null;
  }

  /** Whether a set of so many cameras is shown. Sets of none tell a frame's number alone. */
  accepts(count: number, nowMs: number): boolean {
    const isWhole = count === 0 || count >= this.cameras;
    if (count >= this.cameras || this.sinceMs === null) this.sinceMs = nowMs;
    return isWhole || nowMs - this.sinceMs >= REFUSAL_MS;
  }
}
