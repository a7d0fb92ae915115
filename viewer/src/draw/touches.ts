/** Samples inside the hull as points, their ways out as lines, and each body's response as an arrow. */
import { BufferGeometry, DynamicDrawUsage, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments, Points, PointsMaterial } from "three";
import type { BodyPose, WorldMessage } from "../feed/message.ts";

/** More would hide each other. */
const MAX_DRAWN = 8192;
/** A response of a body is drawn this many times as long as it is. */
const RESPONSE_SCALE = 4;
const MIN_ARROW_M = 0.04;

export class Touches {
  readonly group = new Group();
  /** Touches of the world that is shown. */
  count = 0;
  private readonly points: Points<BufferGeometry, PointsMaterial>;
  private readonly ways: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly arrows: LineSegments<BufferGeometry, LineBasicMaterial>;

  constructor() {
    this.points = new Points(dynamic(MAX_DRAWN), new PointsMaterial({ color: 0xffb454, size: 5, sizeAttenuation: false }));
    this.ways = new LineSegments(dynamic(MAX_DRAWN * 2), new LineBasicMaterial({ color: 0xff7a59, transparent: true, opacity: 0.55 }));
    this.arrows = new LineSegments(dynamic(1024 * 6), new LineBasicMaterial({ color: 0xffe08a }));
    // What lies inside the person can be seen only through it.
    for (const thing of [this.points, this.ways, this.arrows]) {
      thing.frustumCulled = false;
      thing.material.depthTest = false;
      thing.material.transparent = true;
      thing.renderOrder = 50;
      this.group.add(thing);
    }
  }

  /** Shows a world's touches. */
  show(world: WorldMessage, bodies: readonly BodyPose[]): void {
    this.count = world.touches.length / 7;
    const step = Math.max(1, Math.ceil(this.count / MAX_DRAWN));
    const points = this.points.geometry.getAttribute("position");
    const ways = this.ways.geometry.getAttribute("position");
    let drawn = 0;
    for (let touch = 0; touch < this.count; touch += step) {
      const at = touch * 7;
      const [x, y, z] = [world.touches[at + 1], world.touches[at + 2], world.touches[at + 3]];
      points.setXYZ(drawn, x, y, z);
      ways.setXYZ(drawn * 2, x, y, z);
      ways.setXYZ(drawn * 2 + 1, x + world.touches[at + 4], y + world.touches[at + 5], z + world.touches[at + 6]);
      drawn++;
    }
    points.needsUpdate = true;
    ways.needsUpdate = true;
    this.points.geometry.setDrawRange(0, drawn);
    this.ways.geometry.setDrawRange(0, drawn * 2);
    this.showArrows(bodies);
  }

  private showArrows(bodies: readonly BodyPose[]): void {
    const arrows = this.arrows.geometry.getAttribute("position");
    let at = 0;
    for (const { position, response } of bodies) {
      const length = Math.hypot(...response);
      if (length === 0 || at + 6 > arrows.count) continue;
      const drawn = Math.max(length * RESPONSE_SCALE, MIN_ARROW_M);
      const unit = response.map((r) => r / length);
      const tip = position.map((p, i) => p + unit[i] * drawn);
      // A head of two strokes, across any direction.
      const side = Math.abs(unit[1]) < 0.9 ? cross(unit, [0, 1, 0]) : cross(unit, [1, 0, 0]);
      arrows.setXYZ(at++, position[0], position[1], position[2]);
      arrows.setXYZ(at++, tip[0], tip[1], tip[2]);
      for (const sign of [1, -1]) {
        arrows.setXYZ(at++, tip[0], tip[1], tip[2]);
        const back = [0, 1, 2].map((i) => tip[i] - unit[i] * drawn * 0.25 + sign * side[i] * drawn * 0.12);
        arrows.setXYZ(at++, back[0], back[1], back[2]);
      }
    }
    arrows.needsUpdate = true;
    this.arrows.geometry.setDrawRange(0, at);
  }

  dispose(): void {
    for (const thing of [this.points, this.ways, this.arrows]) {
      thing.geometry.dispose();
      thing.material.dispose();
    }
  }
}

function dynamic(vertices: number): BufferGeometry {
  const attribute = new Float32BufferAttribute(new Float32Array(vertices * 3), 3);
  attribute.setUsage(DynamicDrawUsage);
  const geometry = new BufferGeometry().setAttribute("position", attribute);
  geometry.setDrawRange(0, 0);
  return geometry;
}

function cross(a: readonly number[], b: readonly number[]): number[] {
  const c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const length = Math.hypot(...c) || 1;
  return c.map((x) => x / length);
}
