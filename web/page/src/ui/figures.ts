/** The figures: of the page, the link and the run. */
import type { App } from "../app/app.ts";
import type { Rate } from "../time/clock.ts";
import { byId, bytesText } from "./dom.ts";

export class Figures {
  private readonly app: App;
  private readonly rows = new Map<string, HTMLElement>();
  private readonly received: Rate;
  private readonly renderer: string;

  /** `received`: bytes that came. `renderer`: what draws. */
  constructor(app: App, received: Rate, renderer: string) {
    this.app = app;
    this.received = received;
    this.renderer = renderer;
  }

  update(): void {
    const { app } = this;
    const now = performance.now();
    const { progress, feed } = app.status ?? {};
    const status = app.status;
    const ms = (value: number | null | undefined, digits = 1) => (value === null || value === undefined ? null : `${value.toFixed(digits)} ms`);
    // A recording's lenses filmed long ago, and its steps wait for its frames.
    const live = <T>(value: T): T | null => (app.hello?.replay ? null : value);
    this.show("From lens to screen", live(ms(app.frames.latency.get(), 0)));
    this.show("From lens to step", live(ms(progress?.hull_age_ms, 0)));
    this.show("Latency", live(ms(progress?.latency_ms, 0)));
    this.show("Pictures drawn", `${(app.drawing?.rate.perSecond(now) ?? 0).toFixed(0)} /s`);
    this.show("Frames shown", `${app.frames.rate.perSecond(now).toFixed(1)} /s`);
    this.show("Link", `${((this.received.perSecond(now) * 8) / 1e6).toFixed(1)} Mbit/s`);
    this.show("Decoding", ms(app.frames.decodeMs.get()));
    this.show("Drawing", ms(app.quality.averageMs || null));
    this.show("Person drawn at", app.stage ? `${Math.round(app.quality.level.scale * 100)} %` : null);
    this.show("Colour sent", feed?.tier ?? null);
    this.show("Frames not sent", feed?.dropped?.toString() ?? null);
    this.show("Pages", feed?.pages?.toString() ?? null);
    this.show("Step with its pass, p50", ms(progress?.p50_ms, 2));
    this.show("p99", ms(progress?.p99_ms, 2));
    this.show("Steps", progress?.steps_per_s === undefined ? null : `${progress.steps_per_s.toFixed(0)} /s`);
    this.show("Passes", progress?.passes_per_s === undefined ? null : `${progress.passes_per_s.toFixed(0)} /s`);
    this.show("Samples", progress?.samples?.toLocaleString("en") ?? null);
    this.show("Bodies touched", progress?.contacts?.toString() ?? null);
    this.show("Nodes' traffic", progress?.bytes_per_s === undefined ? null : `${bytesText(progress.bytes_per_s)}/s`);
    this.show("Frames missed", status?.frames_missed === undefined ? null : live(`${status.frames_missed} of ${status.frames_expected ?? "?"}`));
    this.show("Late steps", live(status?.late_steps?.toString() ?? null));
    this.show("Steps without hull", status?.blind_steps?.toString() ?? null);
    this.show("Steps without a camera", status?.reduced_steps?.toString() ?? null);
    this.show("Film", progress?.film_s === undefined ? null : `${progress.film_s.toFixed(1)} s`);
    this.show("Looking back", `${app.frames.timeline.length} frames, ${bytesText(app.frames.timeline.byteLength)}`);
    this.show("Graphics", this.renderer);
  }

  /** Shows a figure, `null` as a dash: each has its place from the start. */
  private show(name: string, value: string | null): void {
    let row = this.rows.get(name);
    if (!row) {
      const term = document.createElement("dt");
      term.textContent = name;
      row = document.createElement("dd");
      byId("figures").append(term, row);
      this.rows.set(name, row);
    }
    const text = value ?? "–";
    if (row.textContent !== text) row.textContent = text;
  }
}
