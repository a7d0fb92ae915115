/** Views that have names: where one begins, and the presets. */
import type { Box } from "../decode/hull_box.ts";
import type { Hello } from "../feed/text.ts";
import type { CameraText, Vec3 } from "./lens.ts";
import { Orbit, type View } from "./orbit.ts";

/** A box with a longer side is no person, metres: few cameras see it, or it is several people. */
const PERSON_M = 2.6;

/** The field of view, from top to bottom, by default. */
export const FOV_DEG = 42;
/** The start view is never nearer, metres. */
const NEAREST_M = 2.9;
/** From so far there is room for bodies around a person, metres: the floor is seen to 1.4 m before the person. */
const ROOM_M = 3.9;
/** One looks at a point so high above the floor, metres: persons stand, and bodies lie before them. */
const TARGET_HEIGHT_M = 0.75;
/** How far the start view turns away from the first camera, the best first: a person looks best near a camera. */
const ASIDE = [0.36, 0.19, 0.54, 0.04, 0.69, 0.84, -0.88, -0.16, 1.04];

/**
 * Beside the first camera, which those who set up a room put before the person, with the working volume in the
 * picture, or the person, wherever in it.
 */
export function startView(hello: Hello, person: Box | null = null): View {
  const { low, high } = hello.volume;
  const up = hello.up;
  const around = person ?? hello.volume;
  const middle = around.low.map((l, i) => (l + around.high[i]) / 2) as unknown as [number, number, number];
  const along = (p: readonly number[]) => p[0] * up[0] + p[1] * up[1] + p[2] * up[2];
  const floor = hello.floor_m ?? Math.min(along(low), along(high));
  const rise = floor + TARGET_HEIGHT_M - along(middle);
  const target = middle.map((m, i) => m + rise * up[i]) as unknown as Vec3;
  const reach = Math.max(...low.map((l, i) => (up[i] > 0.5 ? 0 : high[i] - l)));
  const far = Math.max(NEAREST_M, Math.min(7, reach * 0.85));
  const distance = person ? Math.max(ROOM_M, Math.min(far, distanceTo(person, FOV_DEG))) : far;
  const ahead = hello.cameras.length > 0 ? new Orbit(up, null, { target, azimuth: 0, polar: 1, distance }).viewOf(centreOf(hello.cameras[0]), target).azimuth : 0;
  const views = ASIDE.map((aside): View => ({ target, azimuth: ahead + aside, polar: 1.36, distance }));
  return views.find((view) => !inTheWay(hello, up, view)) ?? views[0];
}

/** Whether a hull's box can be one person's. */
export function isPerson(box: Box): boolean {
  return box.low.every((l, i) => box.high[i] - l <= PERSON_M);
}

/** The same direction, with all of a box in the picture. */
export function viewOf(box: Box, now: View, fovDeg: number): View {
  const target = box.low.map((l, i) => (l + box.high[i]) / 2) as unknown as Vec3;
  return { ...now, target, distance: distanceTo(box, fovDeg) };
}

/** From where all of a box is in the picture. */
function distanceTo(box: Box, fovDeg: number): number {
  const radius = 0.5 * Math.hypot(...box.low.map((l, i) => box.high[i] - l));
  return (radius / Math.sin((fovDeg * Math.PI) / 360)) * 1.05;
}

/** One of the presets beside the start view and the person's. */
export function presetView(name: string, start: View): View {
  const views: Record<string, Partial<View>> = {
    front: { azimuth: 0, polar: 1.48 },
    left: { azimuth: Math.PI / 2, polar: 1.48 },
    top: { azimuth: 0, polar: 0.05 },
  };
  return { ...start, ...views[name] };
}

function centreOf({ rotation: r, translation: t }: CameraText): Vec3 {
  return [0, 1, 2].map((i) => -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2])) as unknown as Vec3;
}

/** Whether a camera stands between the eye and what it looks at. */
function inTheWay(hello: Hello, up: Vec3, view: View): boolean {
  const eye = new Orbit(up, null, view).eye(view);
  const ahead = view.target.map((t, i) => (t - eye[i]) / view.distance);
  return hello.cameras.some((camera) => {
    const to = centreOf(camera).map((c, i) => c - eye[i]);
    const away = Math.hypot(...to);
    return away < view.distance && to.reduce((sum, x, i) => sum + x * ahead[i], 0) > 0.93 * away;
  });
}
