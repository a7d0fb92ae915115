/** The panel beside the view, or over it on a phone, and how much of the view is covered. */
import type { App } from "../app/app.ts";
import { byId } from "./dom.ts";

export class Layout {
  private readonly app: App;

  constructor(app: App) {
    this.app = app;
    byId("panel-toggle").addEventListener("click", () => this.openPanel(document.body.classList.contains("panel-closed")));
    window.addEventListener("resize", () => this.measure());
    // The bar of a recording is higher on a phone.
    new ResizeObserver(() => this.measure()).observe(document.querySelector(".timeline")!);
    // On a phone the picture comes first.
    this.openPanel(matchMedia("(min-width: 721px)").matches);
  }

  openPanel(open: boolean): void {
    document.body.classList.toggle("panel-closed", !open);
    byId("panel-toggle").setAttribute("aria-expanded", String(open));
    this.app.wantsThumbnails = open && !document.body.classList.contains("clean");
    this.app.updateWant();
    this.measure();
  }

  private measure(): void {
    const sheet = byId("panel").getBoundingClientRect();
    const strip = document.querySelector(".timeline")!.getBoundingClientRect();
    const isBeside = sheet.width > 0 && sheet.width < innerWidth * 0.6;
    const isBelow = sheet.width > 0 && !isBeside;
    this.app.covered = [isBeside ? innerWidth - sheet.left : 0, isBelow ? innerHeight - sheet.top : strip.height > 0 ? innerHeight - strip.top : 0];
    this.app.invalidate();
  }
}
