/** What shows that bodies are touched: a ripple where a touch is new, and rims that come and go. */
import { LIFE_MS } from "../draw/ripples.ts";
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import { NewTouches, type Touch } from "../time/touches.ts";
import type { Vec3 } from "../view/lens.ts";
import type { App } from "./app.ts";

export class TouchEffects {
  private readonly app: App;
  private readonly newTouches = new NewTouches();
  private readonly reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
  /** The newest world whose touches are known. */
  private last: WorldMessage | null = null;

  constructor(app: App) {
    this.app = app;
  }

  /** Once for each picture, after bodies were placed: begins ripples, and lets all that fades go on. */
  update(nowMs: number): void {
    const { stage, worlds, moment, frames } = this.app;
    if (!stage) return;
    const isLive = frames.playout.live;
    // Touches of the time that is looked back from are not new afterwards.
    const upTo = isLive ? moment?.world : worlds.newest();
    // No world between two pictures is left out: a blow may last for one.
    for (const world of upTo ? worlds.after(this.last, upTo) : []) {
      this.last = world;
      const touches = this.newTouches.add(world);
      const isSeen = isLive && !world.paused && upTo!.filmS - world.filmS < LIFE_MS / 1000;
      if (isSeen && !this.reducedMotion.matches) for (const touch of touches) this.ripple(touch, world.bodies[touch.place], nowMs);
    }
    if (stage.advance(nowMs)) this.app.invalidate();
  }

  private ripple({ point, normal }: Touch, body: BodyPose, nowMs: number): void {
    const stage = this.app.stage!;
    const at = point ?? stage.bodies.surfaceTowards(body, normal ? [-normal[0], -normal[1], -normal[2]] : this.towardsPerson(body));
    if (at) stage.ripples.add(at, normal, nowMs);
  }

  /** From a body to the middle of the person; nothing without a person. */
  private towardsPerson({ position }: BodyPose): Vec3 {
    const box = this.app.stage?.hull?.box;
    const along = (i: number) => (box ? (box.low[i] + box.high[i]) / 2 - position[i] : 0);
    return [along(0), along(1), along(2)];
  }
}
