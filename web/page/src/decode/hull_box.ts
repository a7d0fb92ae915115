/**
 * The box around the visual hull: cells of the working volume that no camera rejects, split a few times. It
 * may be a little large, and is never too small.
 */
import type { DistanceField } from "../feed/distance.ts";
import { NEAR_PIXELS } from "../feed/distance.ts";
import { type Camera, project } from "../view/lens.ts";

/** Low and high corner, world, metres. */
export interface Box {
  readonly low: readonly [number, number, number];
  readonly high: readonly [number, number, number];
}

/** One camera's silhouette, with what it ignores: their field, or null if both are empty. */
export interface CameraSilhouette {
  readonly camera: Camera;
  readonly field: DistanceField | null;
}

const SPLITS = 4;
const FIRST_CELLS = 6;

/** The box around the hull within the volume, or null if nothing is left. */
export function hullBox(volume: Box, seen: readonly CameraSilhouette[], offImageIsOutside: boolean): Box | null {
  if (offImageIsOutside && seen.some(({ field }) => field === null)) return null;
  let half = [0, 1, 2].map((i) => (volume.high[i] - volume.low[i]) / FIRST_CELLS / 2);
  let cells: number[] = [];
  for (let i = 0; i < FIRST_CELLS; i++) {
    for (let j = 0; j < FIRST_CELLS; j++) {
      for (let k = 0; k < FIRST_CELLS; k++) {
        cells.push(
          volume.low[0] + (2 * i + 1) * half[0],
          volume.low[1] + (2 * j + 1) * half[1],
          volume.low[2] + (2 * k + 1) * half[2],
        );
      }
    }
  }
  for (let split = 0; ; split++) {
    const radius = Math.hypot(half[0], half[1], half[2]);
    const kept: number[] = [];
    for (let at = 0; at < cells.length; at += 3) {
      if (!rejected(cells[at], cells[at + 1], cells[at + 2], radius, seen, offImageIsOutside)) {
        kept.push(cells[at], cells[at + 1], cells[at + 2]);
      }
    }
    if (kept.length === 0) return null;
    // Enough cells to know the box by; more would cost without telling more.
    if (split === SPLITS || kept.length > 3 * 4000) return around(kept, half);
    half = half.map((h) => h / 2);
    cells = split8(kept, half);
  }
}

function split8(cells: number[], half: number[]): number[] {
  const parts: number[] = [];
  for (let at = 0; at < cells.length; at += 3) {
    for (let corner = 0; corner < 8; corner++) {
      parts.push(
        cells[at] + ((corner & 1) !== 0 ? half[0] : -half[0]),
        cells[at + 1] + ((corner & 2) !== 0 ? half[1] : -half[1]),
        cells[at + 2] + ((corner & 4) !== 0 ? half[2] : -half[2]),
      );
    }
  }
  return parts;
}

function around(cells: number[], half: number[]): Box {
  const low: [number, number, number] = [Infinity, Infinity, Infinity];
  const high: [number, number, number] = [-Infinity, -Infinity, -Infinity];
  for (let at = 0; at < cells.length; at += 3) {
    for (let i = 0; i < 3; i++) {
      low[i] = Math.min(low[i], cells[at + i] - half[i]);
      high[i] = Math.max(high[i], cells[at + i] + half[i]);
    }
  }
  return { low, high };
}

/** Whether the whole ball around a point is outside for some camera. */
function rejected(x: number, y: number, z: number, radius: number, seen: readonly CameraSilhouette[], offImageIsOutside: boolean): boolean {
  for (const { camera, field } of seen) {
    const at = project(camera, x, y, z);
    if (!at) {
      // Behind the camera or beyond its lens: near the border the ball may still reach into view.
      if (offImageIsOutside && farOff(camera, x, y, z, radius)) return true;
      continue;
    }
    const [u, v, depth] = at;
    if (depth <= radius * 1.5) continue;
    const reach = (camera.pixelsPerUnit * radius * Math.hypot(1, (u - camera.matrix[0][2]) / camera.matrix[0][0], (v - camera.matrix[1][2]) / camera.matrix[1][1]) * 1.3) / (depth - radius);
    if (!offImageIsOutside) {
      const inward = Math.min(u + 0.5, camera.width - 0.5 - u, v + 0.5, camera.height - 0.5 - v);
      if (inward <= reach) continue;
    }
    if (!field || away(field, u, v) > reach) return true;
  }
  return false;
}

/** Whether a ball is wholly behind the camera or beyond its lens. */
function farOff(camera: Camera, x: number, y: number, z: number, radius: number): boolean {
  const [r0, r1, r2] = camera.rotation;
  const t = camera.translation;
  const depth = r2[0] * x + r2[1] * y + r2[2] * z + t[2];
  if (depth <= radius) return depth < -radius;
  const across = Math.hypot(r0[0] * x + r0[1] * y + r0[2] * z + t[0], r1[0] * x + r1[1] * y + r1[2] * z + t[1]) / depth;
  const beyond = across - camera.radiusLimit;
  return beyond > 0 && (beyond * depth) / (Math.hypot(1, across) + beyond) > radius;
}

/** At least how many pixels an image point is away from the silhouette; below zero inside. */
function away(field: DistanceField, u: number, v: number): number {
  const { rect, step, columns, rows, bytes } = field;
  const column = Math.floor((u + 0.5 - rect.left) / step);
  const row = Math.floor((v + 0.5 - rect.top) / step);
  if (column >= 0 && row >= 0 && column < columns && row < rows) {
    return ((bytes[row * columns + column] / 2 - NEAR_PIXELS) * 0.92 - 1) * step;
  }
  const dx = Math.max(rect.left - u - 0.5, u + 0.5 - rect.right, 0);
  const dy = Math.max(rect.top - v - 0.5, v + 0.5 - rect.bottom, 0);
  return Math.hypot(dx, dy);
}
