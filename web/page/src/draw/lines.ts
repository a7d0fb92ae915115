/** Lines that change often: buffers of a fixed size, thin lines or thick ones, and arrows of thick ones. */
import { BufferGeometry, type ColorRepresentation, DynamicDrawUsage, Float32BufferAttribute, type InstancedInterleavedBuffer, type InterleavedBufferAttribute, type Material, type Object3D } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

/** Of thick lines, CSS pixels. */
const WIDTH_PX = 2;
/** An arrow's shaft and the two strokes of its head. */
const STROKES = 3;

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

/** Lines of one colour and width that change often, of which so many can be drawn. */
export class ThickLines {
  readonly lines: LineSegments2;
  private readonly ends: InterleavedBufferAttribute;
  private readonly starts: InterleavedBufferAttribute;

  constructor(most: number, color: number, opacity = 1) {
    const geometry = new LineSegmentsGeometry().setPositions(new Float32Array(most * 6));
    geometry.instanceCount = 0;
    this.starts = geometry.getAttribute("instanceStart") as InterleavedBufferAttribute;
    this.ends = geometry.getAttribute("instanceEnd") as InterleavedBufferAttribute;
    (this.starts.data as InstancedInterleavedBuffer).setUsage(DynamicDrawUsage);
    this.lines = new LineSegments2(geometry, thick(color, opacity));
    drawnOver(this.lines);
  }

  /** The line at an index goes from a point to another. */
  set(index: number, x: number, y: number, z: number, toX: number, toY: number, toZ: number): void {
    this.starts.setXYZ(index, x, y, z);
    this.ends.setXYZ(index, toX, toY, toZ);
  }

  /** Draws the first lines, as they were set. */
  show(count: number): void {
    this.starts.data.needsUpdate = true;
    this.lines.geometry.instanceCount = count;
  }

  dispose(): void {
    this.lines.geometry.dispose();
    this.lines.material.dispose();
  }
}

/** What draws lines as wide as a projector needs them. */
export function thick(color: ColorRepresentation, opacity: number): LineMaterial {
  return new LineMaterial({ toneMapped: false, color, opacity, transparent: true, linewidth: WIDTH_PX });
}

/** Arrows of one colour, set again all together; those beyond the most are left out. */
export class Arrows {
  private readonly strokes: ThickLines;
  private readonly most: number;
  private count = 0;

  constructor(most: number, color: number) {
    this.most = most;
    this.strokes = new ThickLines(most * STROKES, color);
  }

  get lines(): LineSegments2 {
    return this.strokes.lines;
  }

  begin(): void {
    this.count = 0;
  }

  /** An arrow from (x, y, z) by (dx, dy, dz), of some length. */
  add(x: number, y: number, z: number, dx: number, dy: number, dz: number): void {
    if (this.count === this.most) return;
    const length = Math.hypot(dx, dy, dz);
    // A head of two strokes, across any direction: its cross product with y, or with x where that is short.
    const isUpright = Math.abs(dy) >= 0.9 * length;
    const [sx, sy, sz] = isUpright ? [0, dz, -dy] : [-dz, 0, dx];
    const share = (0.12 * length) / (Math.hypot(sx, sy, sz) || 1);
    let at = this.count++ * STROKES;
    this.strokes.set(at++, x, y, z, x + dx, y + dy, z + dz);
    for (let sign = 1; sign >= -1; sign -= 2) {
      this.strokes.set(at++, x + dx, y + dy, z + dz, x + 0.75 * dx + sign * share * sx, y + 0.75 * dy + sign * share * sy, z + 0.75 * dz + sign * share * sz);
    }
  }

  end(): void {
    this.strokes.show(this.count * STROKES);
  }

  dispose(): void {
    this.strokes.dispose();
  }
}
