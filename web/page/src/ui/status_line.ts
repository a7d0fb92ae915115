/** The state of link and run in the title, and the banner over the picture when something is wrong. */
import type { App } from "../app/app.ts";
import { announcement, type RunState } from "../app/run_state.ts";
import { announce, byId, setText } from "./dom.ts";

export class StatusLine {
  private readonly app: App;

  constructor(app: App) {
    this.app = app;
    byId("retry").addEventListener("click", () => app.connection.retryNow());
  }

  /** Link or run changed: announced to screen readers, too. */
  changed(before: RunState, after: RunState): void {
    const spoken = announcement(before, after);
    if (spoken) announce(spoken);
    this.update();
  }

  /** Shows the state now; countdowns go on without a change. */
  update(): void {
    const { status, banner } = this.app.describe(performance.now());
    byId("link").dataset.state = this.app.run.link;
    setText(byId("link-text"), status);
    const element = byId("banner");
    if (banner) {
      setText(byId("banner-text"), banner.text);
      element.classList.toggle("calm", banner.isCalm);
      byId("retry").hidden = !banner.canRetry;
    }
    element.hidden = banner === null;
  }
}
