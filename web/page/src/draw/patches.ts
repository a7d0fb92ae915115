/** The person's surface at the bodies: discs that lie in it, their normals, and arrows for how it moves. */
import { CircleGeometry, DoubleSide, DynamicDrawUsage, Group, InstancedMesh, Matrix4, MeshBasicMaterial, RingGeometry } from "three";
import { PATCH_NUMBERS } from "../feed/message.ts";
import { Arrows, drawnOver, ThickLines } from "./lines.ts";

/** Four a body, as many bodies as a world holds. */
const MAX_DRAWN = 4000;
/** Discs are as large as the samples lie apart, but no smaller and no larger than this, metres. */
const MIN_RADIUS_M = 0.04;
const MAX_RADIUS_M = 1;
const NORMAL_M = 0.08;
/** A metre a second is drawn so long, metres; slower than a centimetre a second is not drawn, faster than four metres as those. */
const SPEED_SCALE = 0.25;
const LEAST_M_S = 0.01;
const MOST_M_S = 4;

export class Patches {
  readonly group = new Group();
  /** Patches of the world that is shown. */
  count = 0;
  private readonly discs: InstancedMesh<CircleGeometry, MeshBasicMaterial>;
  /** Their edges, at the same places. */
  private readonly rims: InstancedMesh<RingGeometry, MeshBasicMaterial>;
  private readonly normals = new ThickLines(MAX_DRAWN, 0xff7a59);
  private readonly arrows = new Arrows(MAX_DRAWN, 0xffe08a);
  private readonly place = new Matrix4();

  constructor() {
    const sheet = new MeshBasicMaterial({ toneMapped: false, color: 0xffb454, opacity: 0.3, side: DoubleSide, depthWrite: false });
    this.discs = new InstancedMesh(new CircleGeometry(1, 24), sheet, MAX_DRAWN);
    this.discs.instanceMatrix.setUsage(DynamicDrawUsage);
    this.discs.count = 0;
    this.rims = new InstancedMesh(new RingGeometry(0.95, 1, 24), new MeshBasicMaterial({ toneMapped: false, color: 0xffb454, side: DoubleSide, depthWrite: false }), 0);
    this.rims.instanceMatrix = this.discs.instanceMatrix;
    for (const thing of [this.discs, this.rims]) drawnOver(thing);
    this.group.add(this.discs, this.normals.lines, this.arrows.lines, this.rims);
  }

  /** Shows a world's patches. */
  show(patches: Float32Array): void {
    this.count = patches.length / PATCH_NUMBERS;
    const drawn = Math.min(this.count, MAX_DRAWN);
    this.arrows.begin();
    for (let patch = 0; patch < drawn; patch++) {
      const at = patch * PATCH_NUMBERS;
      const [x, y, z] = [patches[at + 2], patches[at + 3], patches[at + 4]];
      const [nx, ny, nz] = [patches[at + 5], patches[at + 6], patches[at + 7]];
      this.lay(patch, x, y, z, nx, ny, nz, Math.min(Math.max(patches[at + 12], MIN_RADIUS_M), MAX_RADIUS_M));
      this.normals.set(patch, x, y, z, x + nx * NORMAL_M, y + ny * NORMAL_M, z + nz * NORMAL_M);
      const [vx, vy, vz] = [patches[at + 8], patches[at + 9], patches[at + 10]];
      const speed = Math.hypot(vx, vy, vz);
      if (speed < LEAST_M_S) continue;
      const scale = SPEED_SCALE * Math.min(1, MOST_M_S / speed);
      this.arrows.add(x, y, z, vx * scale, vy * scale, vz * scale);
    }
    this.arrows.end();
    this.normals.show(drawn);
    this.discs.count = drawn;
    this.rims.count = drawn;
    this.discs.instanceMatrix.needsUpdate = true;
  }

  dispose(): void {
    this.normals.dispose();
    for (const thing of [this.discs, this.rims]) {
      thing.geometry.dispose();
      thing.material.dispose();
    }
    this.discs.dispose();
    this.arrows.dispose();
  }

  /** Lays a disc around a point, across a normal. */
  private lay(disc: number, x: number, y: number, z: number, nx: number, ny: number, nz: number, radius: number): void {
    // Two directions across the normal: its cross product with y, or with x where that is short; and with that one.
    const isUpright = Math.abs(ny) >= 0.9;
    const [ax, ay, az] = isUpright ? [0, nz, -ny] : [-nz, 0, nx];
    const scale = radius / Math.hypot(ax, ay, az);
    const [ux, uy, uz] = [ax * scale, ay * scale, az * scale];
    const [vx, vy, vz] = [ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux];
    this.place.set(ux, vx, nx, x, uy, vy, ny, y, uz, vz, nz, z, 0, 0, 0, 1);
    this.discs.setMatrixAt(disc, this.place);
  }
}
