/**
 * Where one looks from: an eye that goes round a target. Pure state; pointers and keys call it, time is an
 * argument. Angles are about the world's up, whichever way that points.
 */
import type { Vec3 } from "./lens.ts";

export const MIN_DISTANCE_M = 0.3;
export const MAX_DISTANCE_M = 25;
const MIN_POLAR = 0.02;
const MAX_POLAR = Math.PI - 0.02;
/** A movement that is let go of goes on for about so long, seconds. */
const COAST_S = 0.09;
/** Once round a frozen moment takes so long, seconds. */
const ROUND_S = 40;
/** How long it takes to fly to another view, seconds. */
const FLIGHT_S = 0.55;
/** The eye stays so far above the floor, metres. */
const ABOVE_FLOOR_M = 0.05;

/** A view one can fly to. */
export interface View {
  readonly target: Vec3;
  readonly azimuth: number;
  readonly polar: number;
  readonly distance: number;
}

export class Orbit {
  private view: View;
  private flight: { from: View; to: View; began: number | null } | null = null;
  private coast: { azimuth: number; polar: number; zoom: number } = { azimuth: 0, polar: 0, zoom: 0 };
  private circling = false;
  private readonly axes: readonly [Vec3, Vec3, Vec3];
  private readonly floor: number | null;
  /** Nothing moves by itself: no coasting, no flights, no circling. */
  reduced = false;

  constructor(up: Vec3, floorM: number | null, start: View) {
    this.axes = axesOf(up);
    this.floor = floorM;
    this.view = this.allowed(start);
  }

  get now(): View {
    return this.view;
  }

  /** The up vector and the two beside it: right-handed, the second one up. */
  get frame(): readonly [Vec3, Vec3, Vec3] {
    return this.axes;
  }

  eye(view: View = this.view): Vec3 {
    const [x, up, z] = this.axes;
    const [s, c] = [Math.sin(view.polar), Math.cos(view.polar)];
    const [a, b] = [s * Math.sin(view.azimuth), s * Math.cos(view.azimuth)];
    return [0, 1, 2].map((i) => view.target[i] + view.distance * (x[i] * a + up[i] * c + z[i] * b)) as unknown as Vec3;
  }

  /** The view from a point to another. */
  viewOf(eye: Vec3, target: Vec3): View {
    const [x, up, z] = this.axes;
    const d = [0, 1, 2].map((i) => eye[i] - target[i]);
    const distance = Math.hypot(d[0], d[1], d[2]) || 1;
    const along = (axis: Vec3) => d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2];
    return { target, azimuth: Math.atan2(along(x), along(z)), polar: Math.acos(Math.max(-1, Math.min(1, along(up) / distance))), distance };
  }

  /** Goes slowly round the target, until anything else is asked. */
  circle(): void {
    this.hold();
    this.circling = !this.reduced;
  }

  turn(azimuth: number, polar: number, coasting: boolean): void {
    this.rest();
    this.change({ azimuth: this.view.azimuth + azimuth, polar: this.view.polar + polar });
    if (coasting && !this.reduced) this.coast = { ...this.coast, azimuth, polar };
  }

  /** The target moves across the picture, by shares of its height. */
  pan(right: number, up: number, fovRad: number): void {
    this.rest();
    const span = 2 * this.view.distance * Math.tan(fovRad / 2);
    const [r, u] = this.screenAxes();
    this.change({ target: [0, 1, 2].map((i) => this.view.target[i] + (r[i] * right + u[i] * up) * span) as unknown as Vec3 });
  }

  /** Nearer by a factor below one, farther above; towards `to` if that is given. */
  zoom(factor: number, to: Vec3 | null = null): void {
    this.rest();
    const distance = Math.max(MIN_DISTANCE_M, Math.min(MAX_DISTANCE_M, this.view.distance * factor));
    const share = 1 - distance / this.view.distance;
    const target = to ? (this.view.target.map((t, i) => t + (to[i] - t) * share) as unknown as Vec3) : this.view.target;
    this.change({ distance, target });
  }

  /** Moves the target with what is followed. */
  follow(target: Vec3): void {
    if (this.flight) this.flight = { ...this.flight, to: { ...this.flight.to, target } };
    else this.change({ target });
  }

  /** Eases to another view. */
  fly(to: View): void {
    const target = this.allowed(to);
    this.circling = false;
    if (this.reduced) {
      this.view = target;
      return;
    }
    // The short way round.
    const turns = Math.round((this.view.azimuth - target.azimuth) / (2 * Math.PI));
    this.flight = { from: this.view, to: { ...target, azimuth: target.azimuth + turns * 2 * Math.PI }, began: null };
    this.coast = { azimuth: 0, polar: 0, zoom: 0 };
  }

  jump(to: View): void {
    this.rest();
    this.view = this.allowed(to);
  }

  /** The viewer takes hold of the view: nothing coasts or circles. */
  hold(): void {
    this.coast = { azimuth: 0, polar: 0, zoom: 0 };
    this.circling = false;
  }

  private rest(): void {
    this.flight = null;
    this.circling = false;
  }

  /** Moves on by some seconds; true while something moves. */
  step(nowS: number, seconds: number, held: boolean): boolean {
    if (this.flight) {
      this.flight.began ??= nowS;
      const share = Math.min(1, (nowS - this.flight.began) / FLIGHT_S);
      const eased = 1 - (1 - share) ** 3;
      this.view = this.allowed(blend(this.flight.from, this.flight.to, eased));
      if (share === 1) this.flight = null;
      return true;
    }
    if (held) return false;
    if (this.circling) {
      this.change({ azimuth: this.view.azimuth + (seconds * 2 * Math.PI) / ROUND_S });
      return true;
    }
    const { azimuth, polar } = this.coast;
    if (Math.abs(azimuth) + Math.abs(polar) < 1e-4) {
      this.hold();
      return false;
    }
    const kept = Math.exp(-seconds / COAST_S);
    this.coast = { azimuth: azimuth * kept, polar: polar * kept, zoom: 0 };
    this.change({ azimuth: this.view.azimuth + this.coast.azimuth, polar: this.view.polar + this.coast.polar });
    return true;
  }

  /** Right and up of the picture, world. */
  screenAxes(): readonly [Vec3, Vec3] {
    const [x, up, z] = this.axes;
    const { azimuth, polar } = this.view;
    const right = [0, 1, 2].map((i) => x[i] * Math.cos(azimuth) - z[i] * Math.sin(azimuth)) as unknown as Vec3;
    const [s, c] = [Math.sin(polar), Math.cos(polar)];
    const above = [0, 1, 2].map((i) => up[i] * s - c * (x[i] * Math.sin(azimuth) + z[i] * Math.cos(azimuth))) as unknown as Vec3;
    return [right, above];
  }

  private change(part: Partial<View>): void {
    this.view = this.allowed({ ...this.view, ...part });
  }

  private allowed(view: View): View {
    const distance = Math.max(MIN_DISTANCE_M, Math.min(MAX_DISTANCE_M, view.distance));
    let polar = Math.max(MIN_POLAR, Math.min(MAX_POLAR, view.polar));
    if (this.floor !== null) {
      const up = this.axes[1];
      const height = view.target[0] * up[0] + view.target[1] * up[1] + view.target[2] * up[2] - this.floor;
      const lowest = Math.max(-1, Math.min(1, (ABOVE_FLOOR_M - height) / distance));
      polar = Math.max(MIN_POLAR, Math.min(polar, Math.acos(lowest)));
    }
    return { ...view, distance, polar };
  }
}

function blend(a: View, b: View, share: number): View {
  const mix = (x: number, y: number) => x + (y - x) * share;
  return {
    target: a.target.map((t, i) => mix(t, b.target[i])) as unknown as Vec3,
    azimuth: mix(a.azimuth, b.azimuth),
    polar: mix(a.polar, b.polar),
    distance: Math.exp(mix(Math.log(a.distance), Math.log(b.distance))),
  };
}

function axesOf(up: Vec3): readonly [Vec3, Vec3, Vec3] {
  const length = Math.hypot(...up) || 1;
  const u = up.map((x) => x / length) as unknown as Vec3;
  // The world's own z if up allows: the studio's person faces it.
  const hint: Vec3 = Math.abs(u[2]) < 0.9 ? [0, 0, 1] : [0, -1, 0];
  const along = hint[0] * u[0] + hint[1] * u[1] + hint[2] * u[2];
  const flat = hint.map((h, i) => h - along * u[i]);
  const flatLength = Math.hypot(...flat);
  const z = flat.map((x) => x / flatLength) as unknown as Vec3;
  const x: Vec3 = [u[1] * z[2] - u[2] * z[1], u[2] * z[0] - u[0] * z[2], u[0] * z[1] - u[1] * z[0]];
  return [x, u, z];
}
