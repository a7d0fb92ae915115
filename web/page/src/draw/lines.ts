/** Lines that change often: buffers of a fixed size, and arrows in one of them. */
import { BufferGeometry, DynamicDrawUsage, Float32BufferAttribute, LineBasicMaterial, LineSegments, type Material, type Object3D } from "three";

/** A shaft and two strokes of a head. */
const VERTICES = 6;

/** A geometry of so many vertices at most, none of them drawn yet. */
export function dynamic(vertices: number): BufferGeometry {
  const attribute = new Float32BufferAttribute(new Float32Array(vertices * 3), 3);
  attribute.setUsage(DynamicDrawUsage);
  const geometry = new BufferGeometry().setAttribute("position", attribute);
  geometry.setDrawRange(0, 0);
  return geometry;
}

/** Draws a thing over all others: what lies inside the person can be seen only through it. */
export function drawnOver(thing: Object3D & { readonly material: Material }): void {
  thing.frustumCulled = false;
  thing.material.depthTest = false;
  thing.material.transparent = true;
  thing.renderOrder = 50;
}

/** Arrows of one colour, set again all together; those beyond the most are left out. */
export class Arrows {
  readonly lines: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly most: number;
  private count = 0;

  constructor(most: number, color: number) {
    this.most = most;
    this.lines = new LineSegments(dynamic(most * VERTICES), new LineBasicMaterial({ toneMapped: false, color }));
    drawnOver(this.lines);
  }

  begin(): void {
    this.count = 0;
  }

  /** An arrow from (x, y, z) by (dx, dy, dz), of some length. */
  add(x: number, y: number, z: number, dx: number, dy: number, dz: number): void {
    if (this.count === this.most) return;
    const ends = this.lines.geometry.getAttribute("position");
    const length = Math.hypot(dx, dy, dz);
    // A head of two strokes, across any direction: its cross product with y, or with x where that is short.
    const isUpright = Math.abs(dy) >= 0.9 * length;
    const [sx, sy, sz] = isUpright ? [0, dz, -dy] : [-dz, 0, dx];
    const share = (0.12 * length) / (Math.hypot(sx, sy, sz) || 1);
    let at = this.count++ * VERTICES;
    ends.setXYZ(at++, x, y, z);
    ends.setXYZ(at++, x + dx, y + dy, z + dz);
    for (let sign = 1; sign >= -1; sign -= 2) {
      ends.setXYZ(at++, x + dx, y + dy, z + dz);
      ends.setXYZ(at++, x + 0.75 * dx + sign * share * sx, y + 0.75 * dy + sign * share * sy, z + 0.75 * dz + sign * share * sz);
    }
  }

  end(): void {
    this.lines.geometry.getAttribute("position").needsUpdate = true;
    this.lines.geometry.setDrawRange(0, this.count * VERTICES);
  }

  dispose(): void {
    this.lines.geometry.dispose();
    this.lines.material.dispose();
  }
}
