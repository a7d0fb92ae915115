/** Rates of what happens now and then: pictures, frames, bytes a second over the last seconds. */
export class Rate {
  private readonly events: { at: number; amount: number }[] = [];
  private readonly windowMs: number;

  constructor(windowMs = 2000) {
    this.windowMs = windowMs;
  }

  add(nowMs: number, amount = 1): void {
    this.events.push({ at: nowMs, amount });
    this.forget(nowMs);
  }

  perSecond(nowMs: number): number {
    this.forget(nowMs);
    if (this.events.length === 0) return 0;
    const sum = this.events.reduce((total, event) => total + event.amount, 0);
    return (sum * 1000) / this.windowMs;
  }

  private forget(nowMs: number): void {
    while (this.events.length > 0 && nowMs - this.events[0].at > this.windowMs) this.events.shift();
  }
}

/** The middle of the last figures. */
export class Median {
  private readonly figures: number[] = [];

  add(figure: number): void {
    this.figures.push(figure);
    if (this.figures.length > 31) this.figures.shift();
  }

  clear(): void {
    this.figures.length = 0;
  }

  get(): number | null {
    if (this.figures.length === 0) return null;
    return [...this.figures].sort((a, b) => a - b)[this.figures.length >> 1];
  }
}

/** From capture to screen: the median of the last frame sets. */
export class Latency {
  private readonly median = new Median();

  /**
   * A set is on the screen for the first time. `capturedUnixS` is 0 if nothing was asked of the cameras: then
   * there is nothing to measure, and what was measured before no longer holds.
   */
  add(capturedUnixS: number, nowUnixMs: number): void {
    if (capturedUnixS > 0) this.median.add(nowUnixMs - capturedUnixS * 1000);
    else this.median.clear();
  }

  /** Milliseconds; null if nothing was measured. */
  get(): number | null {
    return this.median.get();
  }
}
