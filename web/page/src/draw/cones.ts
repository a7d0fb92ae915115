/** The silhouettes' cones: from each camera's centre through its outline, as thin sheets and some rays. */
import { type BufferGeometry, DoubleSide, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial } from "three";
import type { Box } from "../decode/hull_box.ts";
import type { Decoded } from "../decode/work.ts";
import { type Camera, normalised, pointAt } from "../view/lens.ts";
import { cameraColor } from "./cameras.ts";
import { dynamic } from "./lines.ts";

/** As many segments as the decoder gives. */
const MAX_SEGMENTS = 1500;
/** Every so many points of an outline, its ray is drawn. */
const RAY_EVERY = 24;

export class Cones {
  readonly group = new Group();
  private readonly sheets: Mesh<BufferGeometry, MeshBasicMaterial>[];
  private readonly outlines: LineSegments<BufferGeometry, LineBasicMaterial>[];
  private readonly cameras: readonly Camera[];

  constructor(cameras: readonly Camera[]) {
    this.cameras = cameras;
    this.sheets = cameras.map((_, index) => {
      const color = cameraColor(index, cameras.length);
      const material = new MeshBasicMaterial({ toneMapped: false, color, transparent: true, opacity: 0.022, side: DoubleSide, depthWrite: false });
      return new Mesh(dynamic(MAX_SEGMENTS * 3), material);
    });
    this.outlines = cameras.map((_, index) => {
      const color = cameraColor(index, cameras.length);
      return new LineSegments(dynamic(MAX_SEGMENTS * 3), new LineBasicMaterial({ toneMapped: false, color, transparent: true, opacity: 0.4, depthWrite: false }));
    });
    for (const thing of [...this.sheets, ...this.outlines]) {
      thing.frustumCulled = false;
      this.group.add(thing);
    }
  }

  /** The outlines of a frame set, drawn to the far side of the working volume. */
  show(set: Decoded, volume: Box): void {
    const shown = new Set<number>();
    for (const part of set.cameras) {
      if (!part.contour) continue;
      shown.add(part.camera);
      this.fill(this.cameras[part.camera], part.contour, volume);
    }
    this.cameras.forEach((_, index) => {
      this.sheets[index].visible = shown.has(index);
      this.outlines[index].visible = shown.has(index);
    });
  }

  dispose(): void {
    for (const thing of [...this.sheets, ...this.outlines]) {
      thing.geometry.dispose();
      thing.material.dispose();
    }
  }

  private fill(camera: Camera, segments: Float32Array, volume: Box): void {
    const sheet = this.sheets[camera.index].geometry;
    const outline = this.outlines[camera.index].geometry;
    const triangles = sheet.getAttribute("position");
    const lines = outline.getAttribute("position");
    const depth = farthest(camera, volume);
    let count = 0;
    let ends = 0;
    for (let at = 0; at < segments.length; at += 4) {
      const a = normalised(camera, segments[at], segments[at + 1]);
      const b = normalised(camera, segments[at + 2], segments[at + 3]);
      if (!a || !b) continue;
      const from = pointAt(camera, a[0], a[1], depth);
      const to = pointAt(camera, b[0], b[1], depth);
      triangles.setXYZ(count * 3, ...camera.centre);
      triangles.setXYZ(count * 3 + 1, ...from);
      triangles.setXYZ(count * 3 + 2, ...to);
      lines.setXYZ(ends++, ...from);
      lines.setXYZ(ends++, ...to);
      if (count % RAY_EVERY === 0) {
        lines.setXYZ(ends++, ...camera.centre);
        lines.setXYZ(ends++, ...from);
      }
      count++;
    }
    triangles.needsUpdate = true;
    lines.needsUpdate = true;
    sheet.setDrawRange(0, count * 3);
    outline.setDrawRange(0, ends);
  }
}

function farthest(camera: Camera, { low, high }: Box): number {
  const row = camera.rotation[2];
  let most = 0;
  for (let corner = 0; corner < 8; corner++) {
    const p = [0, 1, 2].map((i) => ((corner >> i) & 1 ? high[i] : low[i]));
    most = Math.max(most, row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + camera.translation[2]);
  }
  return most;
}
