/** Outlines of silhouettes as line segments: marching squares over the distance field. */
import { type DistanceField, NEAR_PIXELS } from "../feed/distance.ts";

/** Segments as x0 y0 x1 y1 in image coordinates, at cells of `stride` texels; at most `most` segments. */
export function contour(field: DistanceField, stride: number, most: number): Float32Array {
  const { columns, rows, bytes, rect, step } = field;
  const segments: number[] = [];
  const value = (column: number, row: number) => bytes[row * columns + column] / 2 - NEAR_PIXELS;
  for (let row = 0; row + stride < rows; row += stride) {
    for (let column = 0; column + stride < columns; column += stride) {
      const corners = [value(column, row), value(column + stride, row), value(column + stride, row + stride), value(column, row + stride)];
      const cut: number[] = [];
      for (let side = 0; side < 4; side++) {
        const [a, b] = [corners[side], corners[(side + 1) % 4]];
        if (a > 0 === b > 0) continue;
        const share = a / (a - b);
        const [x0, y0] = CORNERS[side];
        const [x1, y1] = CORNERS[(side + 1) % 4];
        cut.push(
          rect.left + (column + (x0 + (x1 - x0) * share) * stride + 0.5) * step - 0.5,
          rect.top + (row + (y0 + (y1 - y0) * share) * stride + 0.5) * step - 0.5,
        );
      }
      if (cut.length >= 4) segments.push(...cut.slice(0, 4));
      if (cut.length === 8) segments.push(...cut.slice(4));
      if (segments.length >= most * 4) return Float32Array.from(segments.slice(0, most * 4));
    }
  }
  return Float32Array.from(segments);
}

const CORNERS = [
  [0, 0],
  [1, 0],
  [1, 1],
  [0, 1],
] as const;
