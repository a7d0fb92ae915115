/** Frame sets on their way from the feed to the screen: decoded, shown in turn, and acknowledged. */
import { Decoder } from "../decode/decoder.ts";
import { closeImages, type Decoded, type Job } from "../decode/work.ts";
import type { Credit } from "../feed/credit.ts";
import type { Hello } from "../feed/text.ts";
import { Latency, Median, Rate } from "../time/clock.ts";
import { Playout } from "../time/playout.ts";
import { Timeline } from "../time/timeline.ts";
import { WholeSets } from "../time/whole.ts";

/** Sets that are neither shown nor followed by others for so long will never be, milliseconds. */
const STALLED_MS = 3000;

/** What is to be decoded of a set. */
export type Wanted = Pick<Job, "contours" | "colour">;

/** The set that is on the screen. */
export interface ShownFrame {
  readonly frame: number;
  readonly atMs: number;
  /** How many cameras it is of. */
  readonly cameras: number;
}

export class Frames {
  readonly timeline = new Timeline();
  readonly playout = new Playout(this.timeline);
  readonly rate = new Rate();
  readonly decodeMs = new Median();
  readonly latency = new Latency();
  /** Sets that were put on the screen so far. */
  count = 0;
  /** How often credit hung and was given back. */
  stalls = 0;
  /** Screen refreshes so far. */
  looks = 0;
  shown: ShownFrame | null = null;
  private readonly decoder = new Decoder();
  private readonly credit: Credit;
  private readonly wanted: () => Wanted;
  private readonly fault: (text: string) => void;
  /** Decoded, and not on the card yet. */
  private ready: Decoded | null = null;
  /** The live set whose picture is being drawn. */
  private drawing: { seq: number; capturedUnixS: number | null } | null = null;
  private takenSeq: number | null = null;
  private shownKept: number | null = null;
  private seeking = false;
  /** When a set last came or was shown. */
  private movedAt = 0;
  private readonly whole = new WholeSets();

  constructor(credit: Credit, wanted: () => Wanted, fault: (text: string) => void) {
    this.credit = credit;
    this.wanted = wanted;
    this.fault = fault;
  }

  /** A connection: how its sets are to be understood. */
  setup(hello: Hello): void {
    this.whole.setup(hello.cameras.length);
    // Of the connection before.
    if (this.ready) closeImages(this.ready);
    this.ready = null;
    this.decoder.setup({ cameras: hello.cameras, volume: hello.volume, offImageIsOutside: hello.rule.out_of_view === "outside" });
  }

  /** Another run: its frames count from the beginning. */
  forget(): void {
    this.timeline.clear();
    this.playout.goLive();
    this.shown = null;
  }

  /** The connection went: nothing is owed any more. What it brought last is still shown: no other set follows it. */
  disconnected(): void {
    this.drawing = null;
    if (this.playout.live && !this.ready) this.showNewest();
  }

  /** A set came. One that cannot be drawn now is only kept. */
  came(buffer: ArrayBuffer, canDraw: boolean): void {
    if (buffer.byteLength < 48) return;
    const header = new DataView(buffer);
    const seq = header.getUint32(8, true);
    this.credit.received(seq);
    this.movedAt = performance.now();
    if (!this.whole.accepts(header.getUint16(6, true), this.movedAt)) return this.credit.dropped(seq);
    this.timeline.add({ atMs: this.movedAt, frame: Number(header.getBigUint64(16, true)), message: buffer });
    if (this.playout.live && canDraw) void this.decodeLive(buffer, seq);
    else this.credit.dropped(seq);
  }

  private async decodeLive(message: ArrayBuffer, seq: number): Promise<void> {
    const outcome = await this.decoder.decode({ message, ...this.wanted() });
    if (outcome.op !== "decoded" || !this.playout.live) {
      this.credit.dropped(seq);
      if (outcome.op === "failed") this.fault(outcome.why);
      if (outcome.op === "decoded") closeImages(outcome);
      return;
    }
    this.decodeMs.add(outcome.decodeMs);
    if (this.ready) {
      this.credit.dropped(this.ready.seq);
      closeImages(this.ready);
    }
    this.ready = outcome;
  }

  lookBack(ms: number): void {
    this.playout.seek(ms);
  }

  goLive(): void {
    this.playout.goLive();
    this.showNewest();
  }

  /** Decodes what the timeline shows now, if that is another set than before. */
  look(now: number): void {
    this.looks++;
    const wasLive = this.playout.live;
    const kept = this.playout.step(now);
    if (!wasLive && this.playout.live) this.showNewest();
    if (!kept || this.seeking || this.shownKept === kept.atMs) return;
    this.seeking = true;
    this.shownKept = kept.atMs;
    void this.decoder.decode({ message: kept.message, ...this.wanted() }).then((outcome) => {
      this.seeking = false;
      if (outcome.op !== "decoded") {
        this.shownKept = null;
        return;
      }
      if (this.playout.live) return closeImages(outcome);
      if (this.ready) closeImages(this.ready);
      this.ready = outcome;
    });
  }

  /** The set that is on the screen is needed once more: the card lost it, or other things of it are wanted. */
  again(): void {
    this.shownKept = null;
    if (this.playout.live && this.timeline.newest()?.frame === this.shown?.frame) this.decodeNewest();
  }

  /** Live again: a run that is paused or over sends no other set than it has sent. */
  private showNewest(): void {
    this.shownKept = null;
    if (this.timeline.newest()?.frame !== this.shown?.frame) this.decodeNewest();
  }

  /** Decodes the newest set that is kept, unless a newer one comes meanwhile. */
  private decodeNewest(): void {
    const kept = this.timeline.newest();
    const { shown } = this;
    if (!kept || this.ready) return;
    void this.decoder.decode({ message: kept.message, ...this.wanted() }).then((outcome) => {
      if (outcome.op !== "decoded") return;
      if (this.playout.live && !this.ready && this.shown === shown) this.ready = outcome;
      else closeImages(outcome);
    });
  }

  /** Whether a set is being decoded. */
  get isDecoding(): boolean {
    return this.decoder.isBusy;
  }

  get isReady(): boolean {
    return this.ready !== null;
  }

  /** The decoded set; it counts as being drawn from now on. A set of a paused run was not captured just now. */
  take(now: number, isPaused: boolean): Decoded | null {
    const set = this.ready;
    if (!set) return null;
    this.ready = null;
    this.shown = { frame: set.frame, atMs: now, cameras: set.cameras.length };
    this.count++;
    this.rate.add(now);
    if (this.playout.live) this.drawing = { seq: set.seq, capturedUnixS: isPaused || set.seq === this.takenSeq ? null : set.capturedUnixS };
    this.takenSeq = set.seq;
    return set;
  }

  /** The set that was taken last is on the screen: the server may send the next. */
  drawn(isSlow: boolean): void {
    if (!this.drawing) return;
    // A set that is drawn once more tells nothing of how long it took to come.
    if (this.drawing.capturedUnixS !== null) this.latency.add(this.drawing.capturedUnixS, Date.now());
    this.credit.slow = isSlow;
    this.credit.shown(this.drawing.seq);
    this.movedAt = performance.now();
    this.drawing = null;
  }

  /** Gives credit back that hangs, for whatever reason: else the server would wait for ever. */
  unstall(now: number): void {
    if (now - this.movedAt <= STALLED_MS || this.credit.outstanding === 0) return;
    this.movedAt = now;
    this.stalls++;
    this.credit.giveBack();
  }
}
