/** Everything the shaders know of the cameras, as one uniform block: sixteen vectors a camera. */
import { Uniform, UniformsGroup } from "three";
import type { DecodedCamera } from "../decode/work.ts";
import { type DistanceField, fieldStep } from "../feed/distance.ts";
import { type Camera, normalised } from "../view/lens.ts";

/** Vectors of four numbers a camera takes; as `cam[…]` in the shaders. */
export const VECTORS = 16;

/** What is known of a camera's silhouette. */
const ABSENT = 0;
const SILHOUETTE = 1;
const EMPTY = 2;

export class CameraBlock {
  readonly group = new UniformsGroup();
  readonly count: number;
  private readonly numbers: Float32Array;
  private readonly cameras: readonly Camera[];

  constructor(cameras: readonly Camera[]) {
    this.cameras = cameras;
    this.count = cameras.length;
    this.numbers = new Float32Array(Math.max(1, cameras.length) * VECTORS * 4);
    this.group.setName("Cameras");
    this.group.add(new Uniform(this.numbers));
    cameras.forEach((camera, index) => this.calibration(camera, index));
  }

  private set(camera: number, vector: number, values: readonly number[]): void {
    this.numbers.set(values, (camera * VECTORS + vector) * 4);
  }

  private calibration(camera: Camera, k: number): void {
    const [k1, k2, p1, p2, k3] = camera.distortions;
    const [m0, m1] = camera.matrix;
    camera.rotation.forEach((row, i) => this.set(k, i, [...row, camera.translation[i]]));
    this.set(k, 3, [m0[0], m0[1], m0[2], m1[2]]);
    this.set(k, 4, [m1[1], camera.pixelsPerUnit, camera.radiusLimit, ABSENT]);
    this.set(k, 5, [k1, k2, p1, p2]);
    this.set(k, 6, [k3, camera.width, camera.height, fieldStep(camera.width, camera.height)]);
    this.set(k, 11, [...camera.centre, 0]);
  }

  /** The share of a camera's field and image for the next draw; sizes are those of the texture layers. */
  show(part: DecodedCamera, fieldLayer: readonly [number, number], imageLayer: readonly [number, number] | null): void {
    const k = part.camera;
    const at = k * VECTORS * 4;
    const field = part.field;
    this.numbers[at + 4 * 4 + 3] = part.hasRuns ? (field ? SILHOUETTE : EMPTY) : ABSENT;
    this.numbers[at + 11 * 4 + 3] = 0;
    if (field) {
      const { left, top, right, bottom } = field.rect;
      this.set(k, 7, [left, top, right, bottom]);
      this.set(k, 12, [1 / (fieldLayer[0] * field.step), 1 / (fieldLayer[1] * field.step)]);
      const person = part.around ?? field.rect;
      this.set(k, 10, this.normalisedBox(this.cameras[k], person.left + 8, person.top + 8, person.right - 8, person.bottom - 8));
    }
    if (part.image && imageLayer) {
      const { left, top, right, bottom } = part.crop;
      this.set(k, 8, [left, top, right, bottom]);
      const across = part.image.width / (right - left);
      const down = part.image.height / (bottom - top);
      this.set(k, 9, [across / imageLayer[0], down / imageLayer[1], 0.5 / across, 0.5 / down]);
      this.numbers[at + 11 * 4 + 3] = 1;
    }
  }

  /** Where a camera ignores pixels; the size is that of the texture's layers. */
  ignore(k: number, { rect, step }: DistanceField, layer: readonly [number, number]): void {
    this.numbers.set([1 / (layer[0] * step), 1 / (layer[1] * step)], (k * VECTORS + 12) * 4 + 2);
    this.set(k, 13, [rect.left, rect.top, rect.right, rect.bottom]);
  }

  /** No silhouette of this camera. */
  absent(k: number): void {
    this.numbers[k * VECTORS * 4 + 4 * 4 + 3] = ABSENT;
    this.numbers[k * VECTORS * 4 + 11 * 4 + 3] = 0;
  }

  hasField(k: number): boolean {
    return this.numbers[k * VECTORS * 4 + 4 * 4 + 3] === SILHOUETTE;
  }

  /** The box of a camera's depth map: low and high corner, undistorted normalised coordinates. */
  depthBox(k: number): readonly number[] {
    const at = (k * VECTORS + 10) * 4;
    return [...this.numbers.subarray(at, at + 4)];
  }

  /** Around a rectangle of pixels, before the lens. */
  private normalisedBox(camera: Camera, left: number, top: number, right: number, bottom: number): readonly number[] {
    const limit = camera.radiusLimit;
    let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let i = 0; i <= 8; i++) {
      const [u, v] = [left + ((right - left) * i) / 8 - 0.5, top + ((bottom - top) * i) / 8 - 0.5];
      for (const [a, b] of [[u, top - 0.5], [u, bottom - 0.5], [left - 0.5, v], [right - 0.5, v]]) {
        const n = normalised(camera, a, b);
        if (!n) {
          [x0, y0, x1, y1] = [-limit, -limit, limit, limit];
          continue;
        }
        x0 = Math.min(x0, n[0]);
        y0 = Math.min(y0, n[1]);
        x1 = Math.max(x1, n[0]);
        y1 = Math.max(y1, n[1]);
      }
    }
    return [x0, y0, x1, y1];
  }
}
