/** The view in the page's address: read when it changes, written when the view has come to rest. */
import { readHash, type ViewText, writeHash } from "../view/hash.ts";
import { FOV_DEG } from "../view/start.ts";
import type { App } from "./app.ts";

/** The address is written so long after the last change, milliseconds. */
const REST_MS = 400;

export class Address {
  private readonly app: App;
  private timer: ReturnType<typeof setTimeout> | undefined;
  /** The body that an address named and that has not come yet. */
  private toFollow: string | null = null;

  constructor(app: App) {
    this.app = app;
  }

  /** What a link to this view holds. */
  text(): ViewText {
    const { app } = this;
    const followed = app.follow === null ? null : app.stage?.bodies.text(app.follow);
    return {
      eye: app.orbit.eye(),
      target: app.orbit.now.target,
      ...(app.fovDeg !== FOV_DEG ? { fovDeg: app.fovDeg } : {}),
      mode: app.mode,
      layers: app.layers,
      ...(app.through !== null ? { camera: app.rig[app.through]?.name } : {}),
      ...(followed ? { follow: followed.name } : {}),
    };
  }

  /** Goes where an address says. */
  apply(hash: string): void {
    const { app } = this;
    const view = readHash(hash);
    if (view.mode) app.mode = view.mode;
    if (view.layers) app.layers = new Set(view.layers);
    if (view.fovDeg) app.fovDeg = view.fovDeg;
    if (view.eye && view.target) app.orbit.jump(app.orbit.viewOf(view.eye, view.target));
    if (view.camera) {
      const index = app.rig.findIndex((camera) => camera.name === view.camera);
      app.lookThrough(index < 0 ? null : index);
    }
    this.toFollow = view.follow ?? null;
    this.followNamed();
    app.changed();
  }

  /** Follows the body that an address named, as soon as it is there. */
  followNamed(): void {
    const { app } = this;
    const body = this.toFollow === null ? null : app.scene?.bodies.find(({ name }) => name === this.toFollow);
    if (!body) return;
    this.toFollow = null;
    app.followBody(body.id);
  }

  /** The view changed: the address follows when it rests. */
  changed(): void {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (this.app.hello) history.replaceState(null, "", `${location.pathname}${location.search}#${writeHash(this.text())}`);
    }, REST_MS);
  }
}
