/**
 * A person made of a signed distance function: silhouettes, colours and depths are known exactly from every
 * side. Beside it the visual hull of its silhouettes, found as slowly and plainly as can be.
 */
import { decodeRuns, type Rect, type Runs } from "../../src/feed/runs.ts";
import { type Camera, type CameraText, normalised, project, type Vec3 } from "../../src/view/lens.ts";
import { encodeRuns } from "./write.ts";

interface Limb {
  readonly a: Vec3;
  readonly b: Vec3;
  readonly radius: number;
  readonly color: Vec3;
}

const [SKIN, SHIRT, TROUSERS, SHOES, HAIR]: Vec3[] = [[224, 172, 140], [190, 60, 50], [60, 80, 140], [80, 70, 65], [90, 60, 40]];

/** The person at a time, seconds: the right arm waves. */
export function limbs(timeS: number): readonly Limb[] {
  const wave = 0.35 * Math.sin(timeS * 3);
  return [
    { a: [0, 0.98, 0], b: [0, 1.38, 0], radius: 0.15, color: SHIRT },
    { a: [-0.09, 1.4, 0], b: [0.09, 1.4, 0], radius: 0.1, color: SHIRT },
    { a: [0, 1.64, 0.01], b: [0, 1.68, 0.01], radius: 0.105, color: SKIN },
    { a: [0, 1.7, -0.02], b: [0, 1.72, -0.02], radius: 0.1, color: HAIR },
    { a: [-0.2, 1.38, 0], b: [-0.42, 1.2 + wave * 0.2, 0.08], radius: 0.055, color: SHIRT },
    { a: [-0.42, 1.2 + wave * 0.2, 0.08], b: [-0.55, 1.38 + wave, 0.2], radius: 0.042, color: SKIN },
    { a: [0.2, 1.38, 0], b: [0.34, 1.12, 0.04], radius: 0.055, color: SHIRT },
    { a: [0.34, 1.12, 0.04], b: [0.36, 0.88, 0.18], radius: 0.042, color: SKIN },
    { a: [-0.1, 0.92, 0], b: [-0.13, 0.5, 0.05], radius: 0.085, color: TROUSERS },
    { a: [-0.13, 0.5, 0.05], b: [-0.14, 0.12, 0], radius: 0.06, color: TROUSERS },
    { a: [0.1, 0.92, 0], b: [0.14, 0.5, 0], radius: 0.085, color: TROUSERS },
    { a: [0.14, 0.5, 0], b: [0.16, 0.12, -0.06], radius: 0.06, color: TROUSERS },
    { a: [-0.14, 0.06, -0.02], b: [-0.15, 0.05, 0.14], radius: 0.05, color: SHOES },
    { a: [0.16, 0.06, -0.08], b: [0.18, 0.05, 0.08], radius: 0.05, color: SHOES },
  ];
}

/** Metres to the person's surface; below zero inside. Also which limb is nearest. */
export function distance(parts: readonly Limb[], x: number, y: number, z: number): [number, Limb] {
  let best = Infinity;
  let nearest = parts[0];
  for (const limb of parts) {
    const [ax, ay, az] = limb.a;
    const [dx, dy, dz] = [limb.b[0] - ax, limb.b[1] - ay, limb.b[2] - az];
    const length = dx * dx + dy * dy + dz * dz;
    const t = length > 0 ? Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / length)) : 0;
    const found = Math.hypot(x - ax - t * dx, y - ay - t * dy, z - az - t * dz) - limb.radius;
    if (found < best) {
      best = found;
      nearest = limb;
    }
  }
  return [best, nearest];
}

/** Where a ray first meets the person, metres along it, or null. */
export function meet(parts: readonly Limb[], eye: Vec3, dir: Vec3): { t: number; limb: Limb } | null {
  // The person is within 1.2 m of this point.
  const along = -(eye[0] * dir[0] + (eye[1] - 0.9) * dir[1] + eye[2] * dir[2]);
  let t = Math.max(0, along - 1.2);
  const end = along + 1.2;
  while (t < end) {
    const [d, limb] = distance(parts, eye[0] + dir[0] * t, eye[1] + dir[1] * t, eye[2] + dir[2] * t);
    if (d < 1e-4) return { t, limb };
    t += d;
  }
  return null;
}

/** Cameras evenly round the person, each of its own height and lens; every second one has more zoom. */
export function ringOfCameras(count: number, width: number, height: number, bent = false): CameraText[] {
  return Array.from({ length: count }, (_, index) => {
    const angle = 0.3 + (2 * Math.PI * (index + 0.11 * (index % 3))) / count;
    const eye: Vec3 = [3.1 * Math.sin(angle), 0.8 + 0.55 * (index % 4), 3.1 * Math.cos(angle)];
    const focal = height * (index % 2 === 0 ? 1.05 : 1.2);
    return {
      name: `cam_${index}`,
      width,
      height,
      matrix: [[focal, 0, width / 2 - 3 + index], [0, focal * 1.01, height / 2 + 2], [0, 0, 1]],
      distortions: bent ? [-0.2, 0.05, 0.0008, -0.0005, 0] : [0, 0, 0, 0, 0],
      ...looking(eye, [0, 0.95, 0]),
      max_radius: bent ? 1.29 : null,
    };
  });
}

/** World to camera, for an eye that looks at a point. */
export function looking(eye: Vec3, at: Vec3): Pick<CameraText, "rotation" | "translation"> {
  const z = unit([at[0] - eye[0], at[1] - eye[1], at[2] - eye[2]]);
  const x = unit([-z[2], 0, z[0]]);
  const y: Vec3 = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
  const turn = (r: Vec3) => -(r[0] * eye[0] + r[1] * eye[1] + r[2] * eye[2]);
  return { rotation: [x, y, z], translation: [turn(x), turn(y), turn(z)] };
}

function unit(v: Vec3): Vec3 {
  const length = Math.hypot(...v);
  return [v[0] / length, v[1] / length, v[2] / length];
}

/** A viewing ray of a pixel, world; null where the lens has none. */
export function rayOf(camera: Camera, column: number, row: number): Vec3 | null {
  const n = normalised(camera, column, row);
  if (!n) return null;
  const [r0, r1, r2] = camera.rotation;
  return unit([0, 1, 2].map((i) => r0[i] * n[0] + r1[i] * n[1] + r2[i]) as unknown as Vec3);
}

/** The true silhouette of a camera, one byte a pixel. */
export function silhouetteOf(camera: Camera, timeS: number): Uint8Array {
  return pictureOf(camera, timeS).mask;
}

/** The true picture of a camera: mask, and colours of the person on grey. */
export function pictureOf(camera: Camera, timeS: number): { mask: Uint8Array; rgb: Uint8Array } {
  const parts = limbs(timeS);
  const mask = new Uint8Array(camera.width * camera.height);
  const rgb = new Uint8Array(camera.width * camera.height * 3).fill(128);
  for (let row = 0; row < camera.height; row++) {
    for (let column = 0; column < camera.width; column++) {
      const dir = rayOf(camera, column, row);
      const hit = dir && meet(parts, camera.centre, dir);
      if (!hit) continue;
      const at = row * camera.width + column;
      mask[at] = 1;
      const y = camera.centre[1] + dir[1] * hit.t;
      const x = camera.centre[0] + dir[0] * hit.t;
      rgb.set(paint(hit.limb, x, y), at * 3);
    }
  }
  return { mask, rgb };
}

/** Broad stripes, so that colours in the wrong place are noticed. */
function paint(limb: Limb, x: number, y: number): readonly number[] {
  if (limb.color !== SHIRT) return limb.color;
  return Math.floor((y + 0.15 * x) / 0.09) % 2 === 0 ? limb.color : [225, 210, 190];
}

/** The hull of silhouettes as a camera sees it: in small steps, pixel by pixel. */
export function hullMask(view: Camera, cameras: readonly Camera[], masks: readonly Uint8Array[], minViews: number, offImageIsOutside: boolean): Uint8Array {
  const mask = new Uint8Array(view.width * view.height);
  for (let row = 0; row < view.height; row++) {
    for (let column = 0; column < view.width; column++) {
      const dir = rayOf(view, column, row);
      if (!dir) continue;
      const along = -(view.centre[0] * dir[0] + (view.centre[1] - 0.9) * dir[1] + view.centre[2] * dir[2]);
      for (let t = along - 1.1; t < along + 1.1; t += 0.004) {
        if (!inside(cameras, masks, minViews, offImageIsOutside, view.centre[0] + dir[0] * t, view.centre[1] + dir[1] * t, view.centre[2] + dir[2] * t)) continue;
        mask[row * view.width + column] = 1;
        break;
      }
    }
  }
  return mask;
}

/** The hull rule of a point, by the book. */
export function inside(cameras: readonly Camera[], masks: readonly Uint8Array[], minViews: number, offImageIsOutside: boolean, x: number, y: number, z: number): boolean {
  if (Math.abs(x) > 1.5 || Math.abs(z) > 1.5 || y < 0 || y > 2.2) return false;
  let seen = 0;
  for (const [k, camera] of cameras.entries()) {
    const at = project(camera, x, y, z);
    const [column, row] = at ? [Math.floor(at[0] + 0.5), Math.floor(at[1] + 0.5)] : [-1, -1];
    if (column < 0 || row < 0 || column >= camera.width || row >= camera.height) {
      if (offImageIsOutside) return false;
      continue;
    }
    if (camera.ignored && holds(camera.ignored, column, row)) continue;
    if (masks[k][row * camera.width + column] === 0) return false;
    seen++;
  }
  return seen >= minViews;
}

/** Whether a pixel is in a picture of runs. */
function holds(runs: Runs, column: number, row: number): boolean {
  for (let run = runs.rows[row]; run < runs.rows[row + 1]; run++) if (column >= runs.starts[run] && column < runs.ends[run]) return true;
  return false;
}

/** A camera before which something stands: its pixels in a rectangle are ignored, and show no person. */
export function occluded(text: CameraText, mask: Uint8Array, { left, top, right, bottom }: Rect): { text: CameraText; mask: Uint8Array } {
  const { width, height } = text;
  const inRect = (i: number) => i % width >= left && i % width < right && Math.floor(i / width) >= top && Math.floor(i / width) < bottom;
  const ignored = decodeRuns(encodeRuns(mask.map((_, i) => (inRect(i) ? 1 : 0)), width, height), width, height);
  return { text: { ...text, ignored }, mask: mask.map((pixel, i) => (inRect(i) ? 0 : pixel)) };
}

/** Overlap of two masks: what both have, of what either has. */
export function overlap(a: ArrayLike<number>, b: ArrayLike<number>): number {
  let [both, either] = [0, 0];
  for (let i = 0; i < a.length; i++) {
    if (a[i] && b[i]) both++;
    if (a[i] || b[i]) either++;
  }
  return either === 0 ? 1 : both / either;
}
