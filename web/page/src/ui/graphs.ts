/** Graphs of the last minute: how old the film is that collisions use, how long steps take, how many frames were missed. */
import type { App } from "../app/app.ts";
import type { Status } from "../feed/text.ts";
import { Growth, KEPT_MS, LastMinute } from "../time/last_minute.ts";
import { byId, setText } from "./dom.ts";

const HEIGHT_PX = 32;

/** What a graph is of. */
interface Kind {
  readonly name: string;
  /** What is said of its greatest value. */
  readonly most: (value: number) => string;
  /** The graph is at least so high: small values are a flat line. */
  readonly leastHeight: number;
  /** A count is drawn as bars, all else as a line. */
  readonly isCount: boolean;
}

const AGE: Kind = { name: "From lens to step", most: (ms) => `${ms.toFixed(1)} ms at most`, leastHeight: 50, isCount: false };
const STEP: Kind = { name: "Step with its pass, p99", most: (ms) => `${ms.toFixed(1)} ms at most`, leastHeight: 5, isCount: false };
const MISSED: Kind = { name: "Frames missed", most: (count) => (count === 0 ? "none" : `${count} at once`), leastHeight: 1, isCount: true };

class Graph {
  readonly last = new LastMinute();
  private readonly kind: Kind;
  private readonly output = document.createElement("output");
  private readonly canvas = document.createElement("canvas");

  constructor(kind: Kind) {
    this.kind = kind;
    const label = document.createElement("span");
    label.textContent = kind.name;
    this.output.setAttribute("aria-live", "off");
    this.canvas.setAttribute("role", "img");
    byId("last-minute").append(label, this.output, this.canvas);
  }

  draw(nowMs: number): void {
    const { kind, canvas } = this;
    const most = this.last.most(nowMs);
    const text = most === null ? "–" : kind.most(most);
    setText(this.output, text);
    canvas.setAttribute("aria-label", `${kind.name} in the last minute: ${most === null ? "not known" : text}`);
    const width = canvas.clientWidth;
    const context = canvas.getContext("2d");
    if (width === 0 || !context) return;
    [canvas.width, canvas.height] = [Math.round(width * devicePixelRatio), Math.round(HEIGHT_PX * devicePixelRatio)];
    context.scale(devicePixelRatio, devicePixelRatio);
    const scale = (HEIGHT_PX - 2) / Math.max(kind.leastHeight, most ?? 0);
    const across = (atMs: number) => width - ((nowMs - atMs) / KEPT_MS) * width;
    const down = (value: number) => HEIGHT_PX - 1 - value * scale;
    context.strokeStyle = getComputedStyle(canvas).getPropertyValue(kind.isCount ? "--bad" : "--accent");
    context.lineWidth = 1.5;
    context.beginPath();
    for (const piece of this.last.pieces(nowMs)) {
      for (const [index, { atMs, value }] of piece.entries()) {
        const [x, y] = [across(atMs), down(value!)];
        if (kind.isCount) {
          if (value! > 0) {
            context.moveTo(x, HEIGHT_PX);
            context.lineTo(x, y);
          }
          continue;
        }
        // A sample alone is a dot.
        if (index === 0) context.moveTo(x - 1, y);
        context.lineTo(x, y);
      }
    }
    context.stroke();
  }
}

export class Graphs {
  private readonly app: App;
  private readonly age = new Graph(AGE);
  private readonly step = new Graph(STEP);
  private readonly missed = new Graph(MISSED);
  private readonly growth = new Growth();
  private readonly part = byId("last-minute").closest("details")!;
  private session: string | null = null;

  constructor(app: App) {
    this.app = app;
    this.part.addEventListener("toggle", () => this.update());
  }

  /** A link is open, of this run or another. */
  hello(session: string): void {
    this.growth.restart();
    if (session !== this.session) for (const graph of [this.age, this.step, this.missed]) graph.last.clear();
    this.session = session;
  }

  /** The run's figures, as they come. */
  add({ progress, frames_missed }: Status): void {
    const nowMs = performance.now();
    // A recording's lenses filmed long ago, and no frame of it is missed.
    const live = <T>(value: T | undefined): T | null => (this.app.hello?.replay ? null : (value ?? null));
    this.age.last.add(nowMs, live(progress?.hull_age_ms));
    // While the world stands, no step takes any time.
    this.step.last.add(nowMs, progress?.steps_per_s ? (progress.p99_ms ?? null) : null);
    this.missed.last.add(nowMs, this.growth.increase(live(frames_missed)));
  }

  /** Draws what is there now; nothing while the graphs are folded away. */
  update(): void {
    if (!this.part.open) return;
    const nowMs = performance.now();
    for (const graph of [this.age, this.step, this.missed]) graph.draw(nowMs);
  }
}
