/** Views that have names: where one begins, and the presets. */
import type { Box } from "../decode/hull_box.ts";
import type { Hello } from "../feed/text.ts";
import type { Vec3 } from "./lens.ts";
import { Orbit, type View } from "./orbit.ts";

/** A box with a longer side is no person, metres: few cameras see it, or it is several people. */
const PERSON_M = 2.6;

/** Three quarters from the front, with the working volume in the picture, or the person, wherever in it. */
export function startView(hello: Hello, person: Box | null = null): View {
  const { low, high } = hello.volume;
  const up = hello.up;
  const around = person ?? hello.volume;
  const middle = around.low.map((l, i) => (l + around.high[i]) / 2) as unknown as [number, number, number];
  const along = (p: readonly number[]) => p[0] * up[0] + p[1] * up[1] + p[2] * up[2];
  // People stand: the middle of what is seen is about a metre above the floor.
  const floor = hello.floor_m ?? Math.min(along(low), along(high));
  const rise = floor + 0.95 - along(middle);
  const target = middle.map((m, i) => m + rise * up[i]) as unknown as Vec3;
  const reach = Math.max(...low.map((l, i) => (up[i] > 0.5 ? 0 : high[i] - l)));
  const distance = Math.max(2.9, Math.min(7, reach * 0.85));
  const views = [0.62, 0.45, 0.8, 0.3, 0.95, 1.1, -0.62, 0.1, 1.3].map((azimuth): View => ({ target, azimuth, polar: 1.36, distance }));
  return views.find((view) => !inTheWay(hello, up, view)) ?? views[0];
}

/** Whether a hull's box can be one person's. */
export function isPerson(box: Box): boolean {
  return box.low.every((l, i) => box.high[i] - l <= PERSON_M);
}

/** The same direction, with all of a box in the picture. */
export function viewOf(box: Box, now: View, fovDeg: number): View {
  const target = box.low.map((l, i) => (l + box.high[i]) / 2) as unknown as Vec3;
  const radius = 0.5 * Math.hypot(...box.low.map((l, i) => box.high[i] - l));
  return { ...now, target, distance: (radius / Math.sin((fovDeg * Math.PI) / 360)) * 1.05 };
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

/** Whether a camera stands between the eye and what it looks at. */
function inTheWay(hello: Hello, up: Vec3, view: View): boolean {
  const eye = new Orbit(up, null, view).eye(view);
  const ahead = view.target.map((t, i) => (t - eye[i]) / view.distance);
  return hello.cameras.some(({ rotation: r, translation: t }) => {
    const to = [0, 1, 2].map((i) => -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]) - eye[i]);
    const away = Math.hypot(...to);
    return away < view.distance && to.reduce((sum, x, i) => sum + x * ahead[i], 0) > 0.93 * away;
  });
}
