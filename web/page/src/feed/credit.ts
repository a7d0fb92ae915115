/**
 * Flow control: a frame set is acknowledged once it was shown, so that the server sends no more than this
 * page can show. Sets that are passed over are acknowledged with the one that is shown instead of them.
 */
export class Credit {
  private readonly pending: number[] = [];
  private readonly withheld: number[] = [];
  private readonly acknowledge: (seq: number) => void;
  private isSlow = false;

  constructor(acknowledge: (seq: number) => void) {
    this.acknowledge = acknowledge;
  }

  /**
   * A page that draws slowly withholds one acknowledgement: what it shows next then leaves the server when
   * the last was shown, instead of growing old here.
   */
  set slow(isSlow: boolean) {
    this.isSlow = isSlow;
    this.settle();
  }

  /** A set came. */
  received(seq: number): void {
    this.pending.push(seq);
  }

  /** A set is on the screen: it and all before it are done with. */
  shown(seq: number): void {
    const at = this.pending.indexOf(seq);
    if (at < 0) return;
    this.withheld.push(...this.pending.splice(0, at + 1));
    this.settle();
  }

  /** A set will never be shown: it was broken, or the page is hidden. */
  dropped(seq: number): void {
    const at = this.pending.indexOf(seq);
    if (at < 0) return;
    this.pending.splice(at, 1);
    this.acknowledge(seq);
  }

  /** Nothing moves any more, for whatever reason: gives everything back, so that the server goes on. */
  giveBack(): void {
    for (const seq of [...this.withheld.splice(0), ...this.pending.splice(0)]) this.acknowledge(seq);
  }

  /** Sets that came and were not acknowledged. */
  get outstanding(): number {
    return this.pending.length + this.withheld.length;
  }

  /** A new connection owes nothing. */
  reset(): void {
    this.pending.length = 0;
    this.withheld.length = 0;
  }

  private settle(): void {
    while (this.withheld.length > (this.isSlow ? 1 : 0)) this.acknowledge(this.withheld.shift()!);
  }
}
