/** What a newcomer is told: what this is while the person is being prepared, and then how to look round, until that was tried. */
import type { App } from "../app/app.ts";
import { byId, setText } from "./dom.ts";

export class FirstSeconds {
  private readonly app: App;
  private readonly line = byId("first");
  private hasDragged = false;

  constructor(app: App, canvas: HTMLCanvasElement) {
    this.app = app;
    canvas.addEventListener("pointermove", ({ buttons }) => {
      if (buttons === 0 || app.frames.count === 0) return;
      this.hasDragged = true;
      this.update();
    });
  }

  update(): void {
    const { app } = this;
    const isUseless = this.hasDragged || !app.stage || app.run.link !== "open" || !byId("hint").hidden;
    this.line.hidden = isUseless;
    if (!isUseless) setText(this.line, app.frames.count > 0 ? this.howToLook() : this.whatComes());
  }

  private howToLook(): string {
    return this.app.steers ? "Drag to look from any side; drag a body to throw it." : "Drag to look from any side.";
  }

  private whatComes(): string {
    const cameras = this.app.status?.cameras ?? [];
    const filming = cameras.filter(({ newest_frame }) => newest_frame !== null && newest_frame !== undefined).length;
    const progress = cameras.length > 0 ? ` (${filming} of ${cameras.length} cameras film)` : "";
    return `Virtual bodies that a person on film can push, from any side. Preparing the person…${progress}`;
  }
}
