/** The list of cameras: a small image, a mark of health with its word, and the figures. */
import type { App } from "../app/app.ts";
import { type CameraStatus, type Hello, isGone } from "../feed/text.ts";
import { announce, byId, bytesText, setPressed, setText } from "./dom.ts";
import { plain } from "../feed/plain.ts";

/** Older images are marked late, milliseconds. */
const OLD_MS = 250;
/** A camera for which all others wait longer is named. */
const COSTLY_MS = 5;
/** A camera that was gone is there again after so long, milliseconds. */
const BACK_AFTER_MS = 2000;
/** Cameras farther from the others' time are marked out of step, or whose time is less certain, as a share of a frame. */
const UNSYNCED = 0.25;

interface Row {
  readonly button: HTMLButtonElement;
  readonly dot: HTMLElement;
  readonly health: HTMLElement;
  readonly canvas: HTMLCanvasElement;
}

export class CamerasList {
  private rows: Row[] = [];
  /** The place of the first camera that is gone; −1 if none is. */
  private gone = -1;
  /** When each camera was last gone. */
  private readonly goneAtMs = new Map<number, number>();
  private readonly app: App;
  /** From frame to frame, milliseconds. */
  private frameMs = Infinity;

  constructor(app: App) {
    this.app = app;
  }

  build(hello: Hello): void {
    this.frameMs = 1000 / hello.fps;
    this.goneAtMs.clear();
    const list = byId("cameras");
    list.replaceChildren();
    this.rows = hello.cameras.map((camera, index) => {
      const button = document.createElement("button");
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [120, Math.round((120 * camera.height) / camera.width)];
      canvas.setAttribute("aria-hidden", "true");
      const text = document.createElement("span");
      const name = document.createElement("span");
      name.className = "name";
      const dot = document.createElement("span");
      dot.className = "dot";
      dot.setAttribute("aria-hidden", "true");
      const label = document.createElement("span");
      label.textContent = camera.name;
      name.append(dot, label);
      const health = document.createElement("span");
      health.className = "health";
      text.append(name, health);
      button.append(canvas, text);
      button.title = `Look through ${camera.name}`;
      button.addEventListener("click", () => this.app.lookThrough(this.app.through === index ? null : index));
      const item = document.createElement("li");
      item.append(button);
      list.append(item);
      return { button, dot, health, canvas };
    });
    this.buildPlain(hello);
  }

  /** A small image came. It is drawn here too; the caller keeps the bitmap. */
  thumbnail(index: number, bitmap: ImageBitmap): void {
    const row = this.rows[index];
    if (!row) return;
    row.canvas.getContext("2d")?.drawImage(bitmap, 0, 0, row.canvas.width, row.canvas.height);
    const plain = this.plain[index];
    if (!plain) return;
    if (plain.width !== bitmap.width) [plain.width, plain.height] = [bitmap.width, bitmap.height];
    plain.getContext("2d")?.drawImage(bitmap, 0, 0);
  }

  update(cameras: readonly CameraStatus[]): void {
    this.alarm(cameras);
    let well = 0;
    this.rows.forEach((row, index) => {
      // Film of a recording has no age.
      const status = cameras[index] && this.app.hello?.replay ? { ...cameras[index], age_ms: undefined } : cameras[index];
      const [state, text] = status ? health(status, this.frameMs) : (["warn", "no figures yet"] as const);
      if (state === "good") well++;
      row.dot.className = `dot ${state}`;
      row.health.classList.toggle("bad", state === "bad");
      setText(row.health, text);
    });
    setText(byId("cameras-health"), cameras.length > 0 ? `${well} of ${this.rows.length} good` : "");
  }

  /** Leads to the first camera that is gone; `takesFocus`: for those who go on by key. */
  showGone(takesFocus: boolean): void {
    const row = this.rows[this.gone];
    byId<HTMLDetailsElement>("cameras-part").open = true;
    row?.button.scrollIntoView({ block: "center" });
    if (takesFocus) row?.button.focus();
  }

  /** Over the picture, wherever the list is: how many cameras are left. */
  private alarm(cameras: readonly CameraStatus[]): void {
    // A camera that comes and goes with every frame is gone.
    const now = performance.now();
    cameras.forEach((status, index) => isGone(status) && this.goneAtMs.set(index, now));
    const isMissing = (_: CameraStatus, index: number) => now - (this.goneAtMs.get(index) ?? -Infinity) < BACK_AFTER_MS;
    const left = cameras.length - cameras.filter(isMissing).length;
    this.gone = cameras.findIndex(isMissing);
    const pill = byId("cameras-gone");
    pill.hidden = left === cameras.length;
    const text = pill.hidden ? "" : `${left} of ${cameras.length} cameras`;
    if (pill.textContent === text) return;
    pill.textContent = text;
    announce(text === "" ? "All cameras are there." : `${text} are left.`);
  }

  pressed(through: number | null): void {
    this.rows.forEach((row, index) => setPressed(row.button, through === index));
  }

  private plain: HTMLCanvasElement[] = [];

  private buildPlain(hello: Hello): void {
    if (this.app.stage) return;
    const images = byId("plain-images");
    images.replaceChildren();
    this.plain = hello.cameras.map((camera) => {
      const figure = document.createElement("figure");
      const canvas = document.createElement("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `What ${camera.name} sees`);
      const caption = document.createElement("figcaption");
      caption.textContent = camera.name;
      figure.append(canvas, caption);
      images.append(figure);
      return canvas;
    });
  }
}

function health(status: CameraStatus, frameMs: number): readonly ["good" | "warn" | "bad", string] {
  if (status.problem) return ["bad", `gone: ${plain(status.problem)}\nIs its computer on, and does the node run there? Run hulltouch doctor to see why.`];
  if (status.left_out) return ["bad", "left out: it films nothing, or late\nIs the camera plugged in? Run hulltouch doctor to see why."];
  const time: string[] = [];
  const sight: string[] = [];
  let state: "good" | "warn" = "good";
  if (status.age_ms !== undefined) {
    if (status.age_ms > OLD_MS) state = "warn";
    time.push(status.age_ms > OLD_MS ? `late ${Math.round(status.age_ms)} ms` : `${Math.round(status.age_ms)} ms`);
  }
  if (status.sync_ms !== undefined) {
    const boundMs = status.clock_bound_ms ?? 0;
    const isOff = Math.abs(status.sync_ms) + boundMs > UNSYNCED * frameMs;
    if (isOff) state = "warn";
    time.push(`${isOff ? "out of step " : "sync "}${status.sync_ms.toFixed(1)} ± ${boundMs.toFixed(1)} ms`);
  }
  if ((status.costs_ms ?? 0) > COSTLY_MS) time.push(`others wait ${Math.round(status.costs_ms ?? 0)} ms for it`);
  if (status.stamps !== undefined && status.stamps !== "index") time.push(`by ${status.stamps}`);
  if (status.foreground !== undefined) sight.push(`${(status.foreground * 100).toFixed(1)} % foreground`);
  if (status.silhouette_bytes !== undefined) sight.push(bytesText(status.silhouette_bytes));
  return [state, [time, sight].map((line) => line.join(" · ")).join("\n")];
}
