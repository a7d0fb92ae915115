/**
 * Calibrated cameras as the shader and the decoder need them. Camera frame: x right, y down, z forward; a
 * pixel's centre has integer coordinates; OpenCV's plumb-bob lens k1 k2 p1 p2 k3.
 */

import type { Runs } from "../feed/runs.ts";

export type Vec3 = readonly [number, number, number];
export type Mat3 = readonly [Vec3, Vec3, Vec3];

/** A camera as the feed's hello gives it. */
export interface CameraText {
  readonly name: string;
  readonly width: number;
  readonly height: number;
  readonly matrix: Mat3;
  readonly distortions: readonly [number, number, number, number, number];
  /** World to camera. */
  readonly rotation: Mat3;
  readonly translation: Vec3;
  /** The lens folds back beyond this normalised radius; null if it never does. */
  readonly max_radius: number | null;
  /** Pixels where the camera is silent: what stands there stands always. Null or absent: none. */
  readonly ignored?: Runs | null;
}

/** A camera, and what follows from its numbers. */
export interface Camera extends CameraText {
  readonly index: number;
  /** World, metres. */
  readonly centre: Vec3;
  /** Points beyond this normalised radius are certainly off the image. */
  readonly radiusLimit: number;
  /** Pixels per unit of normalised coordinates at most, within the limit: bounds how fast an image moves. */
  readonly pixelsPerUnit: number;
  readonly straight: boolean;
}

/** Normalised coordinates after the lens. */
export function distort(camera: CameraText, x: number, y: number): [number, number] {
  const [k1, k2, p1, p2, k3] = camera.distortions;
  const r2 = x * x + y * y;
  const c = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const xy = x * y;
  return [c * x + 2 * p1 * xy + p2 * (r2 + 2 * x * x), c * y + p1 * (r2 + 2 * y * y) + 2 * p2 * xy];
}

/** Normalised coordinates before the lens, by Newton's method; null where no point is seen. */
export function undistort(camera: CameraText, xd: number, yd: number): [number, number] | null {
  if (camera.distortions.every((k) => k === 0)) return [xd, yd];
  const limit = camera.max_radius ?? Infinity;
  let [x, y] = [xd, yd];
  // A start within the fold, along the same direction.
  const start = Math.hypot(x, y);
  if (start > 0.9 * limit) [x, y] = [(x / start) * 0.9 * limit, (y / start) * 0.9 * limit];
  for (let round = 0; round < 60; round++) {
    const [u, v] = distort(camera, x, y);
    const [ex, ey] = [xd - u, yd - v];
    if (Math.max(Math.abs(ex), Math.abs(ey)) < 1e-10) return Math.hypot(x, y) < limit ? [x, y] : null;
    const [a, b, c, d] = lensJacobian(camera, x, y);
    const over = 1 / (a * d - b * c);
    let [sx, sy] = [(d * ex - b * ey) * over, (a * ey - c * ex) * over];
    const length = Math.hypot(sx, sy);
    if (!Number.isFinite(length)) return null;
    const most = 0.5 * (0.1 + Math.hypot(x, y));
    if (length > most) [sx, sy] = [(sx * most) / length, (sy * most) / length];
    x += sx;
    y += sy;
  }
  return null;
}

function lensJacobian(camera: CameraText, x: number, y: number): [number, number, number, number] {
  const [k1, k2, p1, p2, k3] = camera.distortions;
  const r2 = x * x + y * y;
  const c = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const dc = k1 + r2 * (2 * k2 + r2 * 3 * k3);
  const off = 2 * (x * y * dc + p1 * x + p2 * y);
  return [c + 2 * (x * x * dc + p1 * y + 3 * p2 * x), off, off, c + 2 * (y * y * dc + 3 * p1 * y + p2 * x)];
}

/** World point to image coordinates and depth; null behind the camera or beyond the lens's fold. */
export function project(camera: Camera, x: number, y: number, z: number): [number, number, number] | null {
  const [r0, r1, r2] = camera.rotation;
  const t = camera.translation;
  const depth = r2[0] * x + r2[1] * y + r2[2] * z + t[2];
  if (depth <= 1e-9) return null;
  const nx = (r0[0] * x + r0[1] * y + r0[2] * z + t[0]) / depth;
  const ny = (r1[0] * x + r1[1] * y + r1[2] * z + t[1]) / depth;
  if (nx * nx + ny * ny > camera.radiusLimit * camera.radiusLimit) return null;
  const [dx, dy] = camera.straight ? [nx, ny] : distort(camera, nx, ny);
  const [m0, m1] = camera.matrix;
  return [m0[0] * dx + m0[1] * dy + m0[2], m1[1] * dy + m1[2], depth];
}

/** Image coordinates to undistorted normalised ones; null where no point is seen. */
export function normalised(camera: CameraText, u: number, v: number): [number, number] | null {
  const [m0, m1] = camera.matrix;
  const yd = (v - m1[2]) / m1[1];
  const xd = (u - m0[2] - m0[1] * yd) / m0[0];
  return undistort(camera, xd, yd);
}

/** The world point at a depth along the camera's z axis, seen at undistorted normalised coordinates. */
export function pointAt(camera: Camera, nx: number, ny: number, depth: number): Vec3 {
  const [r0, r1, r2] = camera.rotation;
  const c = camera.centre;
  const at = (i: 0 | 1 | 2) => c[i] + (r0[i] * nx + r1[i] * ny + r2[i]) * depth;
  return [at(0), at(1), at(2)];
}

/** A camera and what follows from its numbers. */
export function camera(text: CameraText, index: number): Camera {
  const [r0, r1, r2] = text.rotation;
  const t = text.translation;
  const centre = ([0, 1, 2] as const).map((i) => -(r0[i] * t[0] + r1[i] * t[1] + r2[i] * t[2])) as unknown as Vec3;
  const straight = text.distortions.every((k) => k === 0);
  const radiusLimit = limitOf(text);
  return { ...text, index, centre, straight, radiusLimit, pixelsPerUnit: steepest(text, radiusLimit) };
}

function limitOf(text: CameraText): number {
  const most = text.max_radius ?? 1e3;
  let farthest = 0;
  for (const [u, v] of border(text, 24)) {
    const seen = normalised(text, u, v);
    if (!seen) return most;
    farthest = Math.max(farthest, Math.hypot(seen[0], seen[1]));
  }
  return Math.min(most, farthest * 1.01 + 1e-6);
}

/** Image coordinates along the image's edge, so many a side. */
export function border(text: CameraText, side: number): [number, number][] {
  const points: [number, number][] = [];
  for (let i = 0; i < side; i++) {
    const s = i / side;
    const [w, h] = [text.width, text.height];
    points.push([s * w - 0.5, -0.5], [w - 0.5, s * h - 0.5], [(1 - s) * w - 0.5, h - 0.5], [-0.5, (1 - s) * h - 0.5]);
  }
  return points;
}

/** The largest stretch of normalised coordinates to pixels, over a polar grid within the limit. */
function steepest(text: CameraText, limit: number): number {
  const [m0, m1] = text.matrix;
  let most = 0;
  const rings = text.distortions.every((k) => k === 0) ? 0 : 24;
  for (let ring = 0; ring <= rings; ring++) {
    const radius = rings === 0 ? 0 : (limit * ring) / rings;
    for (let spoke = 0; spoke < 24; spoke++) {
      const angle = (spoke / 24) * 2 * Math.PI;
      const [a, b, c, d] = lensJacobian(text, radius * Math.cos(angle), radius * Math.sin(angle));
      most = Math.max(most, norm(m0[0] * a + m0[1] * c, m0[0] * b + m0[1] * d, m1[1] * c, m1[1] * d));
    }
  }
  return most * (rings === 0 ? 1 : 1.02);
}

/** The largest singular value of a 2 × 2 matrix. */
function norm(a: number, b: number, c: number, d: number): number {
  const s = a * a + b * b + c * c + d * d;
  const det = a * d - b * c;
  return Math.sqrt(0.5 * (s + Math.sqrt(Math.max(0, s * s - 4 * det * det))));
}
