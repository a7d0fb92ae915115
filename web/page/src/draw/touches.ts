/** Samples inside the hull as points, their ways out as lines, and each body's response as an arrow. */
import { type BufferGeometry, Group, Points, PointsMaterial } from "three";
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import { Arrows, drawnOver, dynamic, ThickLines } from "./lines.ts";

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
  private readonly ways = new ThickLines(MAX_DRAWN, 0xff7a59, 0.55);
  private readonly arrows = new Arrows(MAX_ARROWS, 0xffe08a);

  constructor() {
    this.points = new Points(dynamic(MAX_DRAWN), new PointsMaterial({ toneMapped: false, color: 0xffb454, size: 5, sizeAttenuation: false }));
    drawnOver(this.points);
    this.group.add(this.points, this.ways.lines, this.arrows.lines);
  }

  /** Shows a world's touches. */
  show(world: WorldMessage, bodies: readonly BodyPose[]): void {
    this.count = world.touches.length / 7;
    const step = Math.max(1, Math.ceil(this.count / MAX_DRAWN));
    const points = this.points.geometry.getAttribute("position");
    let [drawn, ways] = [0, 0];
    for (let touch = 0; touch < this.count; touch += step) {
      const at = touch * 7;
      const [x, y, z] = [world.touches[at + 1], world.touches[at + 2], world.touches[at + 3]];
      points.setXYZ(drawn, x, y, z);
      drawn++;
      const [wayX, wayY, wayZ] = [world.touches[at + 4], world.touches[at + 5], world.touches[at + 6]];
      // A line without a direction has no width.
      if (wayX !== 0 || wayY !== 0 || wayZ !== 0) this.ways.set(ways++, x, y, z, x + wayX, y + wayY, z + wayZ);
    }
    points.needsUpdate = true;
    this.points.geometry.setDrawRange(0, drawn);
    this.ways.show(ways);
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
    this.points.geometry.dispose();
    this.points.material.dispose();
    this.ways.dispose();
    this.arrows.dispose();
  }
}
