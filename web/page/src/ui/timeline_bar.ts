/** The last seconds: look back, play on from there, back to live. */
import type { App } from "../app/app.ts";
import { SPAN_MS } from "../time/timeline.ts";
import { byId, setPressed, setText } from "./dom.ts";

export class TimelineBar {
  private readonly app: App;
  private readonly scrub = byId<HTMLInputElement>("scrub");

  constructor(app: App) {
    this.app = app;
    this.scrub.addEventListener("input", () => {
      const span = app.frames.timeline.span();
      if (!span) return;
      const behind = (-Number(this.scrub.value) / 1000) * SPAN_MS;
      if (behind <= 0) app.goLive();
      else app.lookBack(span[1] - behind);
      this.update();
    });
    byId("live").addEventListener("click", () => {
      app.goLive();
      this.update();
    });
    byId("look-back").addEventListener("click", () => {
      const { playout } = app.frames;
      if (playout.live) app.lookBack(performance.now());
      else playout.play(!playout.isPlaying);
      app.invalidate();
      this.update();
    });
  }

  update(): void {
    const { playout } = this.app.frames;
    const { timeline, isLive } = this.app.describe(performance.now());
    const behindMs = playout.behindMs ?? 0;
    const value = String(Math.round((-behindMs / SPAN_MS) * 1000));
    if (this.scrub.value !== value && (playout.live || document.activeElement !== this.scrub)) this.scrub.value = value;
    setText(byId("behind"), timeline);
    this.scrub.setAttribute("aria-valuetext", playout.live ? timeline : `${(behindMs / 1000).toFixed(1)} seconds ago`);
    setPressed(byId("live"), isLive);
    const button = byId("look-back");
    const stands = !playout.live && !playout.isPlaying;
    const label = playout.live ? "Hold the picture" : stands ? "Play on from here" : "Hold the picture";
    if (button.getAttribute("aria-label") !== label) {
      button.setAttribute("aria-label", label);
      button.title = label;
      button.querySelector("use")!.setAttribute("href", stands ? "#i-play" : "#i-pause");
    }
  }
}
