/** From where and through what a picture is taken: the free view, or a camera with its lens. */
import { Matrix4, type PerspectiveCamera } from "three";
import type { Camera } from "../view/lens.ts";

/** The nearest and the farthest that is drawn, and that depths can hold, metres. */
export const NEAR_M = 0.05;
export const FAR_M = 120;

export interface Eye {
  /** World, metres. */
  readonly position: readonly [number, number, number];
  /** Camera frame (x right, y down, z forward) to world, row by row. */
  readonly turn: readonly number[];
  /** fx, fy, cx, cy in pixels of the picture; a pixel's centre is at a half. */
  readonly pinhole: readonly [number, number, number, number];
  readonly skew: number;
  readonly lens: readonly [number, number, number, number, number];
  /** World to clip space: for the depth alone. */
  readonly clip: Matrix4;
}

/** The same view for the hull's shaders. */
export function eyeOf(view: PerspectiveCamera, pinhole: readonly [number, number, number, number]): Eye {
  const e = view.matrixWorld.elements;
  return {
    position: [e[12], e[13], e[14]],
    turn: [e[0], -e[4], -e[8], e[1], -e[5], -e[9], e[2], -e[6], -e[10]],
    pinhole,
    skew: 0,
    lens: [0, 0, 0, 0, 0],
    clip: new Matrix4().multiplyMatrices(view.projectionMatrix, view.matrixWorldInverse),
  };
}

/** A camera's own view, lens and all, at some size. */
export function eyeOfCamera(camera: Camera, width: number, height: number): Eye {
  const [sx, sy] = [width / camera.width, height / camera.height];
  const [m0, m1] = camera.matrix;
  const [r0, r1, r2] = camera.rotation;
  return {
    position: camera.centre,
    turn: [r0[0], r1[0], r2[0], r0[1], r1[1], r2[1], r0[2], r1[2], r2[2]],
    pinhole: [m0[0] * sx, m1[1] * sy, (m0[2] + 0.5) * sx, (m1[2] + 0.5) * sy],
    skew: m0[1] * sx,
    lens: camera.distortions,
    clip: clipOf(camera.rotation, camera.translation),
  };
}

/** World to clip space with depth alone: x and y are not used. */
export function clipOf(rotation: readonly (readonly number[])[], translation: readonly number[]): Matrix4 {
  const [a, b] = [(FAR_M + NEAR_M) / (FAR_M - NEAR_M), (-2 * FAR_M * NEAR_M) / (FAR_M - NEAR_M)];
  const r = rotation[2];
  return new Matrix4().set(0, 0, 0, 0, 0, 0, 0, 0, a * r[0], a * r[1], a * r[2], a * translation[2] + b, r[0], r[1], r[2], translation[2]);
}
