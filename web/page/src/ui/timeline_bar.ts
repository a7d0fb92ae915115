/**
 * The bar below the view. Of a replay, for a page that steers it: the whole recording. Else the last seconds: look back, play
 * on from there, back to live.
 */
import type { App } from "../app/app.ts";
import type { ButtonState } from "../app/run_state.ts";
import type { BodyPose } from "../feed/message.ts";
import type { ReplayStatus } from "../feed/text.ts";
import { besideFrame, FilmSlider, lengthText, placeByKey, placeText } from "../time/film.ts";
import { SPAN_MS } from "../time/timeline.ts";
import type { Vec3 } from "../view/lens.ts";
import { byId, option, setPressed, setText, toast } from "./dom.ts";

/** A recording that is played is shown so often, milliseconds. */
const UPDATE_MS = 100;

export class TimelineBar {
  private readonly app: App;
  private readonly bar = document.querySelector<HTMLElement>(".timeline")!;
  private readonly scrub = byId<HTMLInputElement>("scrub");
  private readonly speed = byId<HTMLSelectElement>("speed");
  private readonly film = new FilmSlider();
  /** The length of the recording that the bar shows, seconds; null: it shows the last seconds. */
  private lengthS: number | null = null;

  constructor(app: App) {
    this.app = app;
    this.bindLastSeconds();
    this.bindRecording();
    setInterval(() => this.lengthS !== null && this.update(), UPDATE_MS);
  }

  private bindLastSeconds(): void {
    const { app } = this;
    this.scrub.addEventListener("input", () => {
      const span = app.frames.timeline.span();
      if (this.lengthS !== null || !span) return;
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
      if (this.lengthS !== null) return void this.ask(app.run.isPaused ? "resume" : "pause");
      const { playout } = app.frames;
      if (app.describe(performance.now()).hold.state === "unavailable") return;
      if (playout.live) app.lookBack(performance.now());
      else playout.play(!playout.isPlaying);
      app.invalidate();
      this.update();
    });
  }

  private bindRecording(): void {
    const { scrub, speed, film } = this;
    scrub.addEventListener("input", () => this.lengthS !== null && this.moveTo(Number(scrub.value)));
    scrub.addEventListener("pointerdown", () => this.lengthS !== null && film.hold());
    for (const end of ["change", "pointerup", "pointercancel", "blur"]) scrub.addEventListener(end, () => this.seek(film.release(performance.now())));
    scrub.addEventListener("keydown", (event) => {
      if (this.lengthS === null || event.ctrlKey || event.metaKey || event.altKey) return;
      const place = placeByKey(event.key, Number(scrub.value), this.lengthS);
      if (place === null) return;
      event.preventDefault();
      this.moveTo(place);
    });
    byId("loop").addEventListener("click", () => {
      const loop = !this.app.status?.replay?.loop;
      void this.ask("loop", { on: loop }, { loop });
    });
    speed.addEventListener("change", () => {
      const factor = Number(speed.value);
      void this.ask("speed", { factor }, { speed: factor });
    });
  }

  /** Seeks the frame before (−1) or after (+1) the one where a recording stands; false: the bar shows none. */
  seekBeside(direction: 1 | -1): boolean {
    const { lengthS, app } = this;
    if (lengthS === null || !app.hello) return false;
    this.moveTo(besideFrame(this.place(), direction, app.hello.fps, lengthS));
    return true;
  }

  private moveTo(place: number): void {
    this.seek(this.film.move(place, performance.now()));
    this.update();
  }

  private seek(place: number | null): void {
    if (place !== null && this.lengthS !== null) void this.ask("seek", { film_s: place });
  }

  /** Gives a command; what it changes is shown before the program's next status. */
  private async ask(command: string, fields: Record<string, unknown> = {}, change: Partial<ReplayStatus> = {}): Promise<void> {
    const { app } = this;
    const answer = await app.command(command, fields);
    if ("refused" in answer) return toast(answer.refused);
    if (app.status?.replay) app.status = { ...app.status, replay: { ...app.status.replay, ...change } };
    this.update();
  }

  /** A body that lies under the bar is seen through it. */
  seeThrough(): void {
    const { left, right, top, bottom } = this.bar.getBoundingClientRect();
    const isUnder = ({ id, position }: BodyPose): boolean => {
      const [at, foot] = [this.app.onCanvas(position), this.app.onCanvas(this.footOf(id, position))];
      return at !== null && foot !== null && at[0] > left && at[0] < right && Math.max(at[1], foot[1]) > top && at[1] < bottom;
    };
    this.bar.classList.toggle("over-body", this.app.layers.has("bodies") && (this.app.moment?.bodies ?? []).some(isUnder));
  }

  /** The lowest point that a body at a place can have. */
  private footOf(id: number, position: Vec3): Vec3 {
    const radius = this.app.stage?.bodies.mesh(id)?.geometry.boundingSphere?.radius ?? 0;
    const up = this.app.hello?.up ?? [0, 1, 0];
    return [position[0] - radius * up[0], position[1] - radius * up[1], position[2] - radius * up[2]];
  }

  update(): void {
    const lengthS = this.app.seekableS;
    if (lengthS !== this.lengthS) this.show(lengthS);
    if (lengthS === null) this.showLastSeconds();
    else this.showRecording(lengthS);
  }

  /** Shows a whole recording of that length, or the last seconds. */
  private show(lengthS: number | null): void {
    const { scrub } = this;
    const isRecording = lengthS !== null;
    this.lengthS = lengthS;
    this.bar.classList.toggle("recording", isRecording);
    this.bar.setAttribute("aria-label", isRecording ? "The recording" : "The last seconds");
    scrub.setAttribute("aria-label", isRecording ? "Place in the recording" : "Seconds before now");
    [scrub.min, scrub.max, scrub.step] = isRecording ? ["0", String(lengthS), "any"] : ["-1000", "0", "1"];
    byId("live").hidden = isRecording;
    for (const part of [byId("loop"), this.speed]) part.hidden = !isRecording;
    this.film.release(performance.now());
    if (isRecording && !this.app.frames.playout.live) this.app.goLive();
  }

  private place(): number {
    const isSeeking = (this.app.status?.replay?.seeking_s ?? null) !== null;
    return this.film.place({ filmS: this.app.worlds.newest()?.filmS ?? 0, isSeeking }, performance.now());
  }

  private showRecording(lengthS: number): void {
    const { scrub, speed, film, app } = this;
    this.seek(film.due(performance.now()));
    const place = this.place();
    if (!film.isHeld) scrub.value = String(place);
    setText(byId("behind"), `${placeText(place)} / ${lengthText(lengthS)}`);
    scrub.setAttribute("aria-valuetext", `${placeText(place)} of ${lengthText(lengthS)}`);
    const replay = app.status?.replay;
    setPressed(byId("loop"), replay?.loop ?? false);
    const factor = String(replay?.speed ?? 1);
    // A program may have chosen another speed.
    if (![...speed.options].some(({ value }) => value === factor)) speed.append(option(factor, `${factor}×`));
    if (speed.value !== factor && document.activeElement !== speed) speed.value = factor;
    setIcon(...(app.run.isPaused ? PLAYING.play : PLAYING.hold));
    setButton(byId<HTMLButtonElement>("look-back"), "free");
  }

  private showLastSeconds(): void {
    const { playout } = this.app.frames;
    const { timeline, live, hold } = this.app.describe(performance.now());
    const behindMs = playout.behindMs ?? 0;
    const value = String(Math.max(-1000, Math.round((-behindMs / SPAN_MS) * 1000)));
    if (this.scrub.value !== value && (playout.live || document.activeElement !== this.scrub)) this.scrub.value = value;
    setText(byId("behind"), timeline);
    this.scrub.setAttribute("aria-valuetext", playout.live ? timeline : `${(behindMs / 1000).toFixed(1)} seconds ago`);
    setButton(byId<HTMLButtonElement>("live"), live);
    setButton(byId<HTMLButtonElement>("look-back"), hold.state);
    setIcon(...HOLDING[hold.action]);
  }
}

/** What the button at the left of the bar is called, and its picture. */
type LabelAndIcon = readonly [label: string, icon: string];

const HOLDING: Record<"hold" | "play" | "play from the oldest", LabelAndIcon> = {
  hold: ["Hold the picture", "#i-pause"],
  play: ["Play on from here", "#i-play"],
  "play from the oldest": ["This moment alone is still kept: play from the oldest picture", "#i-play"],
};

const PLAYING: Record<"hold" | "play", LabelAndIcon> = {
  hold: ["Hold the recording", "#i-pause"],
  play: ["Play the recording", "#i-play"],
};

function setIcon(label: string, icon: string): void {
  const button = byId("look-back");
  if (button.getAttribute("aria-label") === label) return;
  button.setAttribute("aria-label", label);
  button.title = label;
  button.querySelector("use")!.setAttribute("href", icon);
}

/** One that is unavailable keeps the focus: it is not disabled, and does nothing. */
function setButton(button: HTMLButtonElement, state: ButtonState): void {
  button.setAttribute("aria-disabled", String(state === "unavailable"));
  if (button.hasAttribute("aria-pressed")) setPressed(button, state === "pressed");
}
