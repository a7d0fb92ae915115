/** Where a new body would be, half transparent, with its edges: it is not there yet. */
import { Color, EdgesGeometry, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, type Vector3 } from "three";
import type { Shape } from "../feed/text.ts";
import type { Vec3 } from "../view/lens.ts";
import { EDGE_ANGLE_DEG, geometryOf } from "./bodies.ts";

export class Preview {
  readonly mesh = new Mesh(undefined, new MeshBasicMaterial({ transparent: true, opacity: 0.45, depthWrite: false, toneMapped: false }));
  private readonly edges = new LineSegments(undefined, new LineBasicMaterial({ color: 0xffffff, toneMapped: false }));
  private key = "";

  constructor() {
    this.mesh.add(this.edges);
    this.mesh.visible = false;
  }

  /** Its centre; null while none is shown. */
  get place(): readonly number[] | null {
    return this.mesh.visible ? this.mesh.position.toArray() : null;
  }

  show(shape: Shape, at: Vector3, color: Vec3): void {
    const key = JSON.stringify(shape);
    if (key !== this.key) this.reshape(shape);
    this.key = key;
    this.mesh.material.color = new Color().setRGB(color[0], color[1], color[2], "srgb");
    this.mesh.position.copy(at);
    this.mesh.visible = true;
  }

  hide(): void {
    this.mesh.visible = false;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.edges.geometry.dispose();
    this.mesh.material.dispose();
    this.edges.material.dispose();
  }

  private reshape(shape: Shape): void {
    this.mesh.geometry.dispose();
    this.edges.geometry.dispose();
    this.mesh.geometry = geometryOf(shape);
    this.edges.geometry = new EdgesGeometry(this.mesh.geometry, EDGE_ANGLE_DEG);
  }
}
