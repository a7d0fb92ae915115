/** Poses between steps: two worlds and a share become the bodies of one moment. */
import { type BodyPose, patchedPlaces, type WorldMessage } from "../feed/message.ts";

/** The bodies at a film time between two worlds of one generation; outside them, the nearer one's. */
export function between(before: WorldMessage, after: WorldMessage, filmS: number): readonly BodyPose[] {
  const span = after.filmS - before.filmS;
  if (before.generation !== after.generation || !(span > 0) || filmS >= after.filmS) return after.bodies;
  const share = Math.max(0, (filmS - before.filmS) / span);
  const old = new Map(before.bodies.map((body) => [body.id, body]));
  return after.bodies.map((body) => {
    const from = old.get(body.id);
    return from ? { ...body, position: lerp(from.position, body.position, share), rotation: turn(from.rotation, body.rotation, share) } : body;
  });
}

/**
 * Changes when a body is seen to move, by more than a fifth of a millimetre, or begins or ends to be touched; where patches
 * are drawn, also when the surface at a body moves.
 */
export function posesKey({ world, bodies }: { readonly world: WorldMessage; readonly bodies: readonly BodyPose[] }, withPatches = true): string {
  const surface = withPatches ? patchesKey(world.patches) : [...patchedPlaces(world.patches)].join();
  let key = `${world.generation}/${world.touches.length}/${surface}`;
  for (const { id, position, rotation, touching, grabbed, asleep } of bodies) {
    key += `|${id}${touching ? "t" : ""}${grabbed ? "g" : ""}${asleep ? "s" : ""}`;
    for (const n of [...position, ...rotation]) key += `,${Math.round(n * 5000)}`;
  }
  return key;
}

/** Patches are many numbers: one of them all, in steps of a millimetre (a second). */
function patchesKey(patches: Float32Array): number {
  let key = patches.length;
  for (const n of patches) key = (Math.imul(key, 31) + Math.round(n * 1000)) | 0;
  return key;
}

type V3 = readonly [number, number, number];
type V4 = readonly [number, number, number, number];

function lerp(a: V3, b: V3, share: number): [number, number, number] {
  return [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share];
}

/** The short way round, at nearly even speed: steps are small. */
function turn(a: V4, b: V4, share: number): [number, number, number, number] {
  const sign = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0 ? -1 : 1;
  const mixed = [0, 1, 2, 3].map((i) => a[i] * (1 - share) + sign * b[i] * share);
  const length = Math.hypot(...mixed) || 1;
  return [mixed[0] / length, mixed[1] / length, mixed[2] / length, mixed[3] / length];
}
