/** Samples inside the hull as points, their ways out as lines, and each body's response as an arrow. */
import { type BufferGeometry, Group, LineBasicMaterial, LineSegments, Points, PointsMaterial } from "three";
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import { Arrows, drawnOver, dynamic } from "./lines.ts";

/** More would hide each other. */
const MAX_DRAWN = 8192;
/** A response of a body is drawn this many times as long as it is. */
const RESPONSE_SCALE = 4;
const MIN_ARROW_M = 0.04;
const MAX_ARROWS = 1024;

export class Touches {
  readonly group = new Group();
  /** Touches of the world that is shown. */
  count = 0;
  private readonly points: Points<BufferGeometry, PointsMaterial>;
  private readonly ways: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly arrows = new Arrows(MAX_ARROWS, 0xffe08a);

  constructor() {
    this.points = new Points(dynamic(MAX_DRAWN), new PointsMaterial({ toneMapped: false, color: 0xffb454, size: 5, sizeAttenuation: false }));
    this.ways = new LineSegments(dynamic(MAX_DRAWN * 2), new LineBasicMaterial({ toneMapped: false, color: 0xff7a59, transparent: true, opacity: 0.55 }));
    drawnOver(this.points);
    drawnOver(this.ways);
    this.group.add(this.points, this.ways, this.arrows.lines);
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
    this.arrows.begin();
    for (const { position, response } of bodies) {
      const length = Math.hypot(response[0], response[1], response[2]);
      if (length === 0) continue;
      const scale = Math.max(RESPONSE_SCALE, MIN_ARROW_M / length);
      this.arrows.add(position[0], position[1], position[2], response[0] * scale, response[1] * scale, response[2] * scale);
    }
    this.arrows.end();
  }

  dispose(): void {
    for (const thing of [this.points, this.ways]) {
      thing.geometry.dispose();
      thing.material.dispose();
    }
    this.arrows.dispose();
  }
}
