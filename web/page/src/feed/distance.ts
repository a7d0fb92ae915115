/**
 * Silhouettes as signed distances: how far a pixel's centre is from the outline, in pixels, positive outside.
 * A two-pass chamfer with the weights 1 and √2 (at most 8 % long, never short of what sphere tracing minds:
 * the shader takes that share off), and half a pixel where foreground and background meet.
 */
import type { Rect, Runs } from "./runs.ts";

/** Texture bytes hold (distance + NEAR) · 2, so half pixels from −32 to 95.5. */
export const NEAR_PIXELS = 32;
/** Pixels around the silhouette's box whose distances are kept; farther out the box itself tells enough. */
export const MARGIN_PIXELS = 16;

/** Fields of larger images are made at half or a quarter of their size. */
const MAX_FIELD_SIDE = 2048;

const FAR = 1e6;
const DIAGONAL = Math.SQRT2;

/** Distances on a grid of texels, each `step` × `step` pixels. */
export interface DistanceField {
  /** In full pixels; a multiple of the step wide and high; may lie off the image. */
  readonly rect: Rect;
  readonly step: number;
  /** Texels across and down. */
  readonly columns: number;
  readonly rows: number;
  /** Bytes as textures hold them, in texels of `step` pixels. */
  readonly bytes: Uint8Array;
}

/** Pixels a texel's side covers in the fields of a camera with images of this size. */
export function fieldStep(width: number, height: number): number {
  let step = 1;
  while (Math.max(width, height) / step > MAX_FIELD_SIDE) step *= 2;
  return step;
}

/**
 * The field around a silhouette, or null for an empty one. `pastEdge` says that pixels off the image are
 * background; otherwise nothing is known of them, and the field ends at the image's edge.
 */
export function distanceField(runs: Runs, pastEdge: boolean, step: number, scratch: Scratch): DistanceField | null {
  if (!runs.bounds) return null;
  const rect = fieldRect(runs.bounds, runs.width, runs.height, pastEdge, step);
  const columns = (rect.right - rect.left) / step;
  const rows = (rect.bottom - rect.top) / step;
  // One texel of border keeps the passes free of tests.
  const stride = columns + 2;
  const { inside, outside } = scratch.of(stride * (rows + 2));
  inside.fill(FAR);
  outside.fill(FAR);
  fill(runs, rect, step, stride, columns, rows, inside, outside);
  chamfer(outside, stride, columns, rows);
  chamfer(inside, stride, columns, rows);
  const bytes = new Uint8Array(columns * rows);
  for (let row = 0; row < rows; row++) {
    let at = (row + 1) * stride + 1;
    for (let column = 0; column < columns; column++, at++) {
      // `outside` is zero on foreground and grows away from it, `inside` the other way round.
      const distance = outside[at] > 0 ? outside[at] - 0.5 : 0.5 - inside[at];
      bytes[row * columns + column] = Math.max(0, Math.min(255, Math.round((distance + NEAR_PIXELS) * 2)));
    }
  }
  return { rect, step, columns, rows, bytes };
}

/** Buffers that are kept between frames, grown on demand. */
export class Scratch {
  private first = new Float32Array(0);
  private second = new Float32Array(0);

  /** Two buffers of so many numbers; their contents do not matter. */
  of(length: number): { inside: Float32Array; outside: Float32Array } {
    if (this.first.length < length) {
      this.first = new Float32Array(length);
      this.second = new Float32Array(length);
    }
    return { inside: this.first.subarray(0, length), outside: this.second.subarray(0, length) };
  }
}

/** What the field around a box of foreground covers; see {@link distanceField}. */
export function fieldRect(bounds: Rect, width: number, height: number, pastEdge: boolean, step: number): Rect {
  const margin = MARGIN_PIXELS * step;
  const down = (value: number) => Math.floor(value / step) * step;
  const up = (value: number) => Math.ceil(value / step) * step;
  const grown = {
    left: down(bounds.left - margin),
    top: down(bounds.top - margin),
    right: up(bounds.right + margin),
    bottom: up(bounds.bottom + margin),
  };
  if (pastEdge) return grown;
  return {
    left: Math.max(grown.left, 0),
    top: Math.max(grown.top, 0),
    right: Math.min(grown.right, up(width)),
    bottom: Math.min(grown.bottom, up(height)),
  };
}

/** Marks foreground texels: those whose middle pixel is foreground. */
function fill(
  runs: Runs,
  rect: Rect,
  step: number,
  stride: number,
  columns: number,
  rows: number,
  inside: Float32Array,
  outside: Float32Array,
): void {
  const middle = step >> 1;
  for (let row = 0; row < rows; row++) {
    const pixelRow = rect.top + row * step + middle;
    const begin = (row + 1) * stride + 1;
    inside.fill(0, begin, begin + columns);
    if (pixelRow < 0 || pixelRow >= runs.height) continue;
    for (let run = runs.rows[pixelRow]; run < runs.rows[pixelRow + 1]; run++) {
      const from = Math.ceil((runs.starts[run] - rect.left - middle) / step);
      const to = Math.ceil((runs.ends[run] - rect.left - middle) / step);
      inside.fill(FAR, begin + from, begin + Math.min(to, columns));
      outside.fill(0, begin + from, begin + Math.min(to, columns));
    }
  }
}

function chamfer(field: Float32Array, stride: number, columns: number, rows: number): void {
  for (let row = 1; row <= rows; row++) {
    let at = row * stride + 1;
    for (let column = 0; column < columns; column++, at++) {
      let best = field[at];
      if (best === 0) continue;
      let other = field[at - 1] + 1;
      if (other < best) best = other;
      other = field[at - stride] + 1;
      if (other < best) best = other;
      other = field[at - stride - 1] + DIAGONAL;
      if (other < best) best = other;
      other = field[at - stride + 1] + DIAGONAL;
      if (other < best) best = other;
      field[at] = best;
    }
  }
  for (let row = rows; row >= 1; row--) {
    let at = row * stride + columns;
    for (let column = 0; column < columns; column++, at--) {
      let best = field[at];
      if (best === 0) continue;
      let other = field[at + 1] + 1;
      if (other < best) best = other;
      other = field[at + stride] + 1;
      if (other < best) best = other;
      other = field[at + stride + 1] + DIAGONAL;
      if (other < best) best = other;
      other = field[at + stride - 1] + DIAGONAL;
      if (other < best) best = other;
      field[at] = best;
    }
  }
}
