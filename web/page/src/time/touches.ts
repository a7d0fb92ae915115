/** Where bodies touch the person, and which of these touches are new. Times are film times. */
import { type BodyPose, PATCH_NUMBERS, patchedPlaces, type WorldMessage } from "../feed/message.ts";
import type { Vec3 } from "../view/lens.ts";

/** A touch is new on a body that touched nothing for so long, seconds. */
export const MEMORY_S = 0.3;
/** A touch is new too if it is farther than this from those of that time, metres. */
export const APART_M = 0.1;
/** Numbers of a sample in {@link WorldMessage.touches}. */
const SAMPLE_NUMBERS = 7;

export interface Touch {
  /** The body's place in its world. */
  readonly place: number;
  /** World, metres; null if the world does not say where. */
  readonly point: Vec3 | null;
  /** Out of the person's surface, unit, world; null if unknown. */
  readonly normal: Vec3 | null;
}

/** A world's touches: its patches, else groups of its samples, else one touch for each body that is marked as touching. */
export function touchesOf(world: WorldMessage): Touch[] {
  const { patches, touches: samples } = world;
  const touches: Touch[] = [];
  for (let at = 0; at < patches.length; at += PATCH_NUMBERS) {
    touches.push({ place: patches[at], point: vectorAt(patches, at + 2), normal: vectorAt(patches, at + 5) });
  }
  const hasPatch = patchedPlaces(patches);
  const groups = groupSamples(samples);
  world.bodies.forEach(({ touching, response }, place) => {
    if (!touching || hasPatch.has(place)) return;
    touches.push(...(groups.get(place) ?? [{ place, point: null, normal: unit(response) }]));
  });
  return touches;
}

/** Finds new touches in worlds that come in order. */
export class NewTouches {
  private readonly recent = new Map<number, Recent>();
  private generation: number | null = null;
  /** From here on, no gap between worlds is longer than {@link MEMORY_S}. */
  private sinceS = 0;
  private lastS = -Infinity;

  /**
   * Takes the next world and returns its new touches: none until the worlds of {@link MEMORY_S} before it are known, for
   * what touches then may have touched before.
   */
  add(world: WorldMessage): readonly Touch[] {
    const { filmS, generation, blind } = world;
    // Without a hull nothing touches, and nothing has let go.
    if (blind) return [];
    const gapS = filmS - this.lastS;
    if (generation !== this.generation || !(gapS >= 0 && gapS <= MEMORY_S)) {
      this.recent.clear();
      this.generation = generation;
      this.sinceS = filmS;
    }
    this.lastS = filmS;
    for (const [id, { lastS }] of this.recent) if (filmS - lastS > MEMORY_S) this.recent.delete(id);
    const found = touchesOf(world).filter((touch) => this.remember(touch, world.bodies[touch.place], filmS));
    return filmS - this.sinceS >= MEMORY_S ? found : [];
  }

  /** Remembers a touch; returns whether it is new. */
  private remember({ point }: Touch, body: BodyPose, filmS: number): boolean {
    let recent = this.recent.get(body.id);
    const isFirst = !recent || filmS - recent.lastS > MEMORY_S;
    if (!recent || isFirst) this.recent.set(body.id, (recent = { lastS: filmS, points: [] }));
    recent.lastS = filmS;
    const { points } = recent;
    while (points.length > 0 && filmS - points[0].atS > MEMORY_S) points.shift();
    if (!point) return isFirst;
    // A body in a hand takes its touches along, and a ball rolls over a touch that stays where it is: near is near in either frame.
    const onBody = toBody(body, point);
    const isApart = points.length > 0 && points.every(({ inWorld, onBody: other }) => distance(inWorld, point) > APART_M && distance(other, onBody) > APART_M);
    points.push({ atS: filmS, inWorld: point, onBody });
    return isFirst || isApart;
  }
}

/** The touches of a body in the last {@link MEMORY_S}, oldest first. */
interface Recent {
  lastS: number;
  readonly points: { readonly atS: number; readonly inWorld: Vec3; readonly onBody: Vec3 }[];
}

/** The samples of each body in groups no wider than new touches are apart: their mean place and their mean way out. */
function groupSamples(samples: Float32Array): Map<number, Touch[]> {
  const groups = new Map<number, { readonly first: Vec3; count: number; readonly sum: number[] }[]>();
  for (let at = 0; at < samples.length; at += SAMPLE_NUMBERS) {
    const own = groups.get(samples[at]) ?? [];
    groups.set(samples[at], own);
    const point = vectorAt(samples, at + 1);
    let group = own.find(({ first }) => distance(first, point) <= APART_M);
    if (!group) own.push((group = { first: point, count: 0, sum: [0, 0, 0, 0, 0, 0] }));
    group.count++;
    for (let i = 0; i < 6; i++) group.sum[i] += samples[at + 1 + i];
  }
  const touchOf = (place: number, count: number, sum: readonly number[]): Touch => ({
    place,
    point: [sum[0] / count, sum[1] / count, sum[2] / count],
    normal: unit([sum[3], sum[4], sum[5]]),
  });
  return new Map([...groups].map(([place, own]) => [place, own.map(({ count, sum }) => touchOf(place, count, sum))]));
}

function vectorAt(numbers: Float32Array, at: number): Vec3 {
  return [numbers[at], numbers[at + 1], numbers[at + 2]];
}

function unit([x, y, z]: Vec3): Vec3 | null {
  const length = Math.hypot(x, y, z);
  return length > 0 ? [x / length, y / length, z / length] : null;
}

function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** A point of the world in a body's frame. */
function toBody({ position, rotation: [x, y, z, w] }: BodyPose, point: Vec3): Vec3 {
  const [px, py, pz] = [point[0] - position[0], point[1] - position[1], point[2] - position[2]];
  // p + 2 q × (q × p − w p): the inverse of the rotation.
  const [cx, cy, cz] = [y * pz - z * py - w * px, z * px - x * pz - w * py, x * py - y * px - w * pz];
  return [px + 2 * (y * cz - z * cy), py + 2 * (z * cx - x * cz), pz + 2 * (x * cy - y * cx)];
}
