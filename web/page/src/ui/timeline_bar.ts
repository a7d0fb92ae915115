/** The last seconds: look back, play on from there, back to live. */
import type { App } from "../app/app.ts";
import type { ButtonState } from "../app/run_state.ts";
import type { BodyPose } from "../feed/message.ts";
import { SPAN_MS } from "../time/timeline.ts";
import type { Vec3 } from "../view/lens.ts";
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
      if (app.frames.playout.live) return;
      app.goLive();
      this.update();
    });
    byId("look-back").addEventListener("click", () => {
      const { playout } = app.frames;
      if (app.describe(performance.now()).hold.state === "unavailable") return;
      if (playout.live) app.lookBack(performance.now());
      else playout.play(!playout.isPlaying);
      app.invalidate();
      this.update();
    });
  }

  /** A body that lies under the bar is seen through it. */
  seeThrough(): void {
    const bar = document.querySelector(".timeline")!;
    const { left, right, top, bottom } = bar.getBoundingClientRect();
    const isUnder = ({ id, position }: BodyPose): boolean => {
      const [at, foot] = [this.app.onCanvas(position), this.app.onCanvas(this.footOf(id, position))];
      return at !== null && foot !== null && at[0] > left && at[0] < right && Math.max(at[1], foot[1]) > top && at[1] < bottom;
    };
    bar.classList.toggle("over-body", this.app.layers.has("bodies") && (this.app.moment?.bodies ?? []).some(isUnder));
  }

  /** The lowest point that a body at a place can have. */
  private footOf(id: number, position: Vec3): Vec3 {
    const radius = this.app.stage?.bodies.mesh(id)?.geometry.boundingSphere?.radius ?? 0;
    const up = this.app.hello?.up ?? [0, 1, 0];
    return [position[0] - radius * up[0], position[1] - radius * up[1], position[2] - radius * up[2]];
  }

  update(): void {
    const { playout } = this.app.frames;
    const { timeline, live, hold } = this.app.describe(performance.now());
    const behindMs = playout.behindMs ?? 0;
    const value = String(Math.max(-1000, Math.round((-behindMs / SPAN_MS) * 1000)));
    if (this.scrub.value !== value && (playout.live || document.activeElement !== this.scrub)) this.scrub.value = value;
    setText(byId("behind"), timeline);
    this.scrub.setAttribute("aria-valuetext", playout.live ? timeline : `${(behindMs / 1000).toFixed(1)} seconds ago`);
    setButton(byId<HTMLButtonElement>("live"), live);
    const button = byId<HTMLButtonElement>("look-back");
    setButton(button, hold.state);
    const [label, icon] = HOLDING[hold.action];
    if (button.getAttribute("aria-label") !== label) {
      button.setAttribute("aria-label", label);
      button.title = label;
      button.querySelector("use")!.setAttribute("href", icon);
    }
  }
}

const HOLDING = {
  hold: ["Hold the picture", "#i-pause"],
  play: ["Play on from here", "#i-play"],
  "play from the oldest": ["This moment alone is still kept: play from the oldest picture", "#i-play"],
} as const;

/** One that is unavailable keeps the focus: it is not disabled, and does nothing. */
function setButton(button: HTMLButtonElement, state: ButtonState): void {
  button.setAttribute("aria-disabled", String(state === "unavailable"));
  if (button.hasAttribute("aria-pressed")) setPressed(button, state === "pressed");
}
