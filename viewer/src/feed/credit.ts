/**
 * Flow control: a frame set is acknowledged once it was shown, so that the server sends no more than this
 * page can show. Sets that are passed over are acknowledged with the one that is shown instead of them.
 */
export class Credit {
  private readonly pending: number[] = [];
  private readonly acknowledge: (seq: number) => void;

  constructor(acknowledge: (seq: number) => void) {
    this.acknowledge = acknowledge;
  }

  /** A set came. */
  received(seq: number): void {
    this.pending.push(seq);
  }

  /** A set is on the screen: it and all before it are done with. */
  shown(seq: number): void {
    const at = this.pending.indexOf(seq);
    if (at < 0) return;
    for (const done of this.pending.splice(0, at + 1)) this.acknowledge(done);
  }

  /** A set will never be shown: it was broken, or the page is hidden. */
  dropped(seq: number): void {
    const at = this.pending.indexOf(seq);
    if (at < 0) return;
    this.pending.splice(at, 1);
    this.acknowledge(seq);
  }

  /** Sets that came and were not acknowledged. */
  get outstanding(): number {
    return this.pending.length;
  }

  /** A new connection owes nothing. */
  reset(): void {
    this.pending.length = 0;
  }
}
