/** Parameters of the world as sliders: each shows what the run has, and sets it once it is let go. */
import type { App } from "../app/app.ts";
import type { Scene } from "../feed/text.ts";
import type { Vec3 } from "../view/lens.ts";
import { byId, setText } from "./dom.ts";

type Parameters = Scene["parameters"];

interface Slider {
  readonly id: string;
  /** What the slider stands at, in its own unit; undefined if the run does not say. */
  readonly of: (parameters: Parameters, up: Vec3) => number | null | undefined;
  readonly text: (value: number) => string;
  /** The fields of `set`. */
  readonly set: (value: number, up: Vec3) => Record<string, unknown>;
}

const percent = (share: number | null | undefined) => (share === null || share === undefined ? share : Math.round(share * 100));

const SLIDERS: readonly Slider[] = [
  { id: "restitution", of: ({ hull_restitution }) => percent(hull_restitution), text: (value) => `${value} %`, set: (value) => ({ hull_restitution: value / 100 }) },
  { id: "friction", of: ({ hull_friction }) => percent(hull_friction), text: (value) => (value / 100).toFixed(2), set: (value) => ({ hull_friction: value / 100 }) },
  {
    id: "gravity",
    of: ({ gravity_m_s2: gravity }, up) => (gravity ? -up.reduce((sum, part, axis) => sum + part * gravity[axis], 0) : gravity),
    text: (value) => `${value.toFixed(1)} m/s²`,
    set: (value, up) => ({ gravity: up.map((part) => -part * value) }),
  },
];

export class ParameterSliders {
  private readonly app: App;

  /** `ask` sets parameters of the run. */
  constructor(app: App, ask: (fields: Record<string, unknown>) => void) {
    this.app = app;
    for (const { id, text, set } of SLIDERS) {
      const slider = byId<HTMLInputElement>(id);
      slider.addEventListener("input", () => setText(byId(`${id}-text`), text(Number(slider.value))));
      slider.addEventListener("change", () => ask(set(Number(slider.value), this.up)));
    }
  }

  /** Shows the run's; a slider in the hand stays there. */
  show(parameters: Parameters): void {
    for (const { id, of, text } of SLIDERS) {
      const value = of(parameters, this.up);
      if (value === null || value === undefined || document.activeElement?.id === id) continue;
      byId<HTMLInputElement>(id).value = String(value);
      setText(byId(`${id}-text`), text(value));
    }
  }

  private get up(): Vec3 {
    return this.app.hello?.up ?? [0, 1, 0];
  }
}
