/** The virtual bodies: meshes of their shapes, with dark edges, moved to the pose of the moment. */
import {
  BoxGeometry,
  BufferGeometry,
  CapsuleGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  EdgesGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  Quaternion,
  Raycaster,
  SphereGeometry,
  Vector3,
} from "three";
import { type BodyPose, patchedPlaces } from "../feed/message.ts";
import type { BodyText, Shape } from "../feed/text.ts";
import type { Vec3 } from "../view/lens.ts";

/** Edges are drawn where faces meet at more than this. */
export const EDGE_ANGLE_DEG = 30;
/** The edges and the glow of a body that another page or a program holds. */
const HELD_ELSEWHERE = 0x6fa8ff;
const HELD_HERE = 0xffffff;
const TOUCHED = 0xffd08a;
/** How bright the rim of a body in a hand is at most, and how long it takes to come and to go, seconds. */
const RIM = 0.55;
const RIM_COMES_S = 0.1;
const RIM_GOES_S = 0.4;
/** The rim: most where the surface is seen from the side. */
const RIM_GLSL = "{ float turned = 1.0 - saturate(dot(normal, normalize(vViewPosition))); totalEmissiveRadiance += uRim * turned * turned * turned; }";
/** The layer on which eyes see bodies alone, without their edges. */
export const ONLY_BODIES = 1;

interface Drawn {
  readonly text: BodyText;
  readonly mesh: Mesh;
  readonly edges: LineSegments;
  readonly material: MeshStandardMaterial;
  readonly edge: LineBasicMaterial;
  readonly rim: Rim;
  readonly key: string;
}

interface Rim {
  /** Its colour on the card: black without a rim. */
  readonly uniform: { readonly value: Color };
  readonly color: Color;
  /** How much of it is seen now, 0 to 1, and whether it comes or goes. */
  share: number;
  isWanted: boolean;
}

export class Bodies {
  readonly group = new Group();
  private readonly drawn = new Map<number, Drawn>();
  private highlighted: number | null = null;
  /** The body that this page holds, or held last: worlds show for a moment longer that it is held. */
  private inHand: number | null = null;
  private isHolding = false;
  /** The bodies that another page or a program holds. */
  private readonly elsewhere = new Set<number>();
  private advancedMs = 0;

  /** The bodies of a scene; those that stay keep their meshes. */
  describe(bodies: readonly BodyText[]): void {
    const wanted = new Map(bodies.map((body) => [body.id, body]));
    for (const [id, drawn] of this.drawn) {
      const body = wanted.get(id);
      if (body && drawn.key === keyOf(body)) wanted.delete(id);
      else this.remove(id, drawn);
    }
    for (const body of wanted.values()) this.add(body);
  }

  /** Where they are, and the person's surface at them. Bodies that are not mentioned are not drawn. */
  place(poses: readonly BodyPose[], patches: Float32Array): void {
    for (const drawn of this.drawn.values()) drawn.mesh.visible = drawn.rim.isWanted = false;
    this.elsewhere.clear();
    const patched = patchedPlaces(patches);
    for (const [place, pose] of poses.entries()) {
      const drawn = this.drawn.get(pose.id);
      if (!drawn) continue;
      drawn.mesh.visible = true;
      drawn.mesh.position.fromArray(pose.position);
      drawn.mesh.quaternion.fromArray(pose.rotation as unknown as number[]);
      // Touched bodies are told by their edges too, not by colour alone.
      const marked = pose.touching || pose.grabbed || pose.id === this.highlighted;
      const isElsewhere = this.isElsewhere(pose);
      if (isElsewhere) this.elsewhere.add(pose.id);
      drawn.edge.color.set(isElsewhere ? HELD_ELSEWHERE : pose.grabbed ? HELD_HERE : pose.touching ? TOUCHED : marked ? 0xffffff : 0x0c0e12);
      drawn.edge.opacity = marked ? 1 : 0.55;
      if (isElsewhere) drawn.material.emissive.set(HELD_ELSEWHERE).multiplyScalar(0.5);
      else drawn.material.emissive.setScalar(pose.id === this.highlighted || pose.grabbed ? 0.07 : 0);
      // What sleeps lies on something that does not move: it is in no hand.
      drawn.rim.isWanted = pose.grabbed || (!pose.asleep && (pose.touching || patched.has(place)));
      if (drawn.rim.isWanted) drawn.rim.color.set(isElsewhere ? HELD_ELSEWHERE : pose.grabbed ? HELD_HERE : TOUCHED);
    }
  }

  /** Lets rims come and go until now; returns whether any changed. */
  advance(nowMs: number): boolean {
    const seconds = Math.min(0.25, Math.max(0, nowMs - this.advancedMs) / 1000);
    this.advancedMs = nowMs;
    let isChanged = false;
    for (const { rim } of this.drawn.values()) {
      const share = rim.isWanted ? Math.min(1, rim.share + seconds / RIM_COMES_S) : Math.max(0, rim.share - seconds / RIM_GOES_S);
      isChanged ||= share !== rim.share;
      rim.share = share;
      rim.uniform.value.copy(rim.color).multiplyScalar(RIM * share);
    }
    return isChanged;
  }

  /** Where a ray from the middle of a body leaves its surface, world; null for a body that is not known, or without a direction. */
  surfaceTowards({ id, position, rotation }: BodyPose, direction: Vec3): Vec3 | null {
    const geometry = this.drawn.get(id)?.mesh.geometry;
    if (!geometry) return null;
    const turn = new Quaternion(...rotation);
    const inward = new Vector3(...direction).normalize().negate().applyQuaternion(turn.clone().invert());
    if (!geometry.boundingSphere) geometry.computeBoundingSphere();
    const { radius, center } = geometry.boundingSphere!;
    const ray = new Raycaster(inward.clone().multiplyScalar(-2 * (radius + center.length())), inward);
    const point = ray.intersectObject(new Mesh(geometry))[0]?.point.applyQuaternion(turn).add(new Vector3(...position));
    return point ? [point.x, point.y, point.z] : null;
  }

  private isElsewhere({ id, grabbed }: BodyPose): boolean {
    if (id !== this.inHand) return grabbed;
    if (!grabbed && !this.isHolding) this.inHand = null;
    return false;
  }

  /** This page holds a body. */
  hold(id: number): void {
    this.inHand = id;
    this.isHolding = true;
  }

  /** This page holds nothing any more. */
  release(): void {
    this.isHolding = false;
  }

  /** Whether another page or a program holds a body. */
  isHeldElsewhere(id: number): boolean {
    return this.elsewhere.has(id);
  }

  /** Marks the body that is chosen. */
  highlight(id: number | null): void {
    this.highlighted = id;
  }

  meshes(): Mesh[] {
    return [...this.drawn.values()].map((drawn) => drawn.mesh);
  }

  mesh(id: number): Mesh | null {
    return this.drawn.get(id)?.mesh ?? null;
  }

  text(id: number): BodyText | null {
    return this.drawn.get(id)?.text ?? null;
  }

  get count(): number {
    return this.drawn.size;
  }

  dispose(): void {
    for (const [id, drawn] of this.drawn) this.remove(id, drawn);
  }

  private add(body: BodyText): void {
    const geometry = geometryOf(body.shape);
    const color = new Color().setRGB(body.color[0], body.color[1], body.color[2], "srgb");
    const material = new MeshStandardMaterial({
      color,
      roughness: 0.6,
      flatShading: "hull" in body.shape,
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
    });
    const rim: Rim = { uniform: { value: new Color(0) }, color: new Color(0), share: 0, isWanted: false };
    material.onBeforeCompile = (shader) => {
      shader.uniforms.uRim = rim.uniform;
      shader.fragmentShader = shader.fragmentShader.replace("void main() {", "uniform vec3 uRim;\nvoid main() {").replace("#include <emissivemap_fragment>", `#include <emissivemap_fragment>\n${RIM_GLSL}`);
    };
    const mesh = new Mesh(geometry, material);
    mesh.layers.enable(ONLY_BODIES);
    mesh.castShadow = true;
    mesh.receiveShadow = true;
    mesh.name = body.name;
    mesh.userData.body = body.id;
    mesh.visible = false;
    const edge = new LineBasicMaterial({ color: 0x0c0e12, toneMapped: false, transparent: true, opacity: 0.55 });
    const edges = new LineSegments(new EdgesGeometry(geometry, EDGE_ANGLE_DEG), edge);
    mesh.add(edges);
    this.group.add(mesh);
    this.drawn.set(body.id, { text: body, mesh, edges, material, edge, rim, key: keyOf(body) });
  }

  private remove(id: number, drawn: Drawn): void {
    this.group.remove(drawn.mesh);
    drawn.mesh.geometry.dispose();
    drawn.edges.geometry.dispose();
    drawn.material.dispose();
    drawn.edge.dispose();
    this.drawn.delete(id);
  }
}

function keyOf(body: BodyText): string {
  return JSON.stringify([body.shape, body.color, body.name]);
}

/** A shape's triangles, body frame, metres; axes along y. */
export function geometryOf(shape: Shape): BufferGeometry {
  if ("box" in shape) return new BoxGeometry(...shape.box.size);
  if ("ball" in shape) return new SphereGeometry(shape.ball.radius, 40, 24);
  if ("capsule" in shape) return new CapsuleGeometry(shape.capsule.radius, shape.capsule.length, 12, 32);
  if ("cylinder" in shape) return new CylinderGeometry(shape.cylinder.radius, shape.cylinder.radius, shape.cylinder.height, 40);
  if ("cone" in shape) return new ConeGeometry(shape.cone.radius, shape.cone.height, 40);
  if ("hull" in shape) {
    const { corners, faces } = shape.hull;
    const numbers: number[] = [];
    for (const face of faces) for (const corner of face) numbers.push(...(corners[corner] ?? [0, 0, 0]));
    const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(numbers, 3));
    geometry.computeVertexNormals();
    return geometry;
  }
  // A shape of a newer server: something to see at least.
  return new BoxGeometry(0.1, 0.1, 0.1);
}

/** The radius of a shape around its origin, metres. */
export function radiusOf(shape: Shape): number {
  const geometry = geometryOf(shape);
  geometry.computeBoundingSphere();
  const sphere = geometry.boundingSphere!;
  const radius = sphere.radius + sphere.center.length();
  geometry.dispose();
  return radius;
}
