/** Graphs of the last minute: how old the film is that bodies meet, how long steps take, and which frames were missed. */
import type { App } from "../app/app.ts";
import type { Status } from "../feed/text.ts";
import { Growth, KEPT_MS, LastMinute } from "../time/last_minute.ts";
import { byId, setText } from "./dom.ts";

const HEIGHT_PX = 32;
/** Figures are drawn against this at least: a quiet run is a flat line. Milliseconds, milliseconds, frames. */
const LEAST_MOST = { age: 50, step: 5, missed: 1 };

/** One figure's name, its graph, and what is said of it. */
class Graph {
  readonly last = new LastMinute();
  private readonly leastMost: number;
  private readonly unit: string;
  private readonly name: string;
  private readonly said = document.createElement("output");
  private readonly canvas = document.createElement("canvas");
  private readonly isOfCounts: boolean;

  constructor(name: string, unit: string, leastMost: number, isOfCounts = false) {
    this.name = name;
    this.unit = unit;
    this.leastMost = leastMost;
    this.isOfCounts = isOfCounts;
    const label = document.createElement("span");
    label.textContent = name;
    this.said.setAttribute("aria-live", "off");
    this.canvas.setAttribute("role", "img");
    byId("last-minute").append(label, this.said, this.canvas);
  }

  draw(nowMs: number): void {
    const most = this.last.most();
    const digits = this.isOfCounts ? 0 : 1;
    const text = most === null ? "–" : `${most.toFixed(digits)} ${this.unit} at most`;
    setText(this.said, text);
    this.canvas.setAttribute("aria-label", `${this.name} in the last minute: ${most === null ? "not known" : text}`);
    const width = this.canvas.clientWidth;
    const context = this.canvas.getContext("2d");
    // Folded away, it is drawn once it is seen.
    if (width === 0 || !context) return;
    const ratio = devicePixelRatio;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(HEIGHT_PX * ratio)];
    context.scale(ratio, ratio);
    const style = getComputedStyle(this.canvas);
    const scale = (HEIGHT_PX - 2) / Math.max(this.leastMost, most ?? 0);
    const across = (atMs: number) => width - ((nowMs - atMs) / KEPT_MS) * width;
    const down = (value: number) => HEIGHT_PX - 1 - value * scale;
    context.strokeStyle = style.getPropertyValue(this.isOfCounts ? "--bad" : "--accent");
    context.lineWidth = 1.5;
    context.beginPath();
    for (const piece of this.last.pieces()) {
      for (const [index, { atMs, value }] of piece.entries()) {
        const [x, y] = [across(atMs), down(value!)];
        if (this.isOfCounts || index === 0) context.moveTo(x, this.isOfCounts ? HEIGHT_PX : y);
        if (!this.isOfCounts || value! > 0) context.lineTo(x, y);
      }
    }
    context.stroke();
  }
}

export class Graphs {
  private readonly app: App;
  private readonly age = new Graph("From lens to step", "ms", LEAST_MOST.age);
  private readonly step = new Graph("Step with its pass, p99", "ms", LEAST_MOST.step);
  private readonly missed = new Graph("Frames missed at once", "frames", LEAST_MOST.missed, true);
  private readonly growth = new Growth();

  constructor(app: App) {
    this.app = app;
    byId("last-minute").closest("details")!.addEventListener("toggle", () => this.draw());
  }

  /** The run's figures, as they come. */
  add({ progress, frames_missed }: Status): void {
    const nowMs = performance.now();
    // A recording's lenses filmed long ago, and no frame of it is missed.
    const live = <T>(value: T | undefined): T | null => (this.app.hello?.replay ? null : (value ?? null));
    this.age.last.add(nowMs, live(progress?.hull_age_ms));
    this.step.last.add(nowMs, progress?.p99_ms ?? null);
    this.missed.last.add(nowMs, this.growth.of(live(frames_missed)));
    this.draw();
  }

  private draw(): void {
    const nowMs = performance.now();
    for (const graph of [this.age, this.step, this.missed]) graph.draw(nowMs);
  }
}
