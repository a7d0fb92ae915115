/** The floor: a pool of light that fades into the distance, lines of whole metres, and the shadows on it. */
import {
  BufferGeometry,
  Color,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  ShadowMaterial,
  Vector3,
} from "three";
import type { Hello } from "../feed/text.ts";
import type { ContactShadow } from "./contact_shadow.ts";
import { FAR_FLOOR } from "./sky.ts";

/** The floor ends so far from its middle, metres. */
const RADIUS_M = 16;
const LINES_M = 8;
const RINGS = 16;
const SEGMENTS = 48;
const NEAR_FLOOR = 0x9aa1a8;
/** Share of light that a shadow takes. */
const SHADOW = 0.42;

export class Ground {
  readonly group = new Group();
  private readonly floor: Mesh<BufferGeometry, MeshBasicMaterial>;
  private readonly shadow: Mesh<PlaneGeometry, ShadowMaterial>;
  private readonly lines: readonly LineSegments<BufferGeometry, LineBasicMaterial>[];

  /** Dithered where colours would show steps; that costs, where the processor draws. */
  constructor(contact: ContactShadow, dithering: boolean) {
    // Nothing of the floor hides what is drawn after it: feet of the person reach a little below.
    const flat = { transparent: true, depthWrite: false, toneMapped: false } as const;
    this.floor = new Mesh(disc(), new MeshBasicMaterial({ ...flat, vertexColors: true, dithering }));
    this.shadow = new Mesh(new PlaneGeometry(2 * LINES_M, 2 * LINES_M), new ShadowMaterial({ ...flat, color: 0x000000, opacity: SHADOW }));
    this.shadow.rotation.x = -Math.PI / 2;
    this.shadow.receiveShadow = true;
    this.lines = [grid(0.25, 0x7d858e), grid(1, 0x5f6872)];
    [this.floor, contact.plane, this.shadow, ...this.lines].forEach((layer, order) => {
      layer.renderOrder = -40 + order;
      this.group.add(layer);
    });
    this.floor.position.y = -0.003;
    contact.plane.position.y = -0.002;
    this.shadow.position.y = -0.001;
  }

  /** Where the floor of a rig is. */
  place(hello: Hello): void {
    const { low, high } = hello.volume;
    const up = new Vector3(...hello.up);
    const along = (p: readonly number[]) => p[0] * up.x + p[1] * up.y + p[2] * up.z;
    const height = hello.floor_m ?? Math.min(along(low), along(high));
    const middle = new Vector3(...low).add(new Vector3(...high)).multiplyScalar(0.5);
    this.group.position.copy(middle).addScaledVector(up, height - middle.dot(up));
    this.group.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), up);
    // Lines fall on whole metres of the world, if up is up.
    if (Math.abs(up.y) > 0.999) {
      this.group.position.x = Math.round(middle.x);
      this.group.position.z = Math.round(middle.z);
    }
    this.group.updateMatrixWorld(true);
  }

  /** How much is seen of the floor itself, and whether its lines are; shadows stay. */
  show(share: number, withLines: boolean): void {
    this.floor.material.opacity = share;
    this.floor.visible = share > 0;
    for (const lines of this.lines) lines.visible = withLines;
  }

  dispose(): void {
    for (const layer of [this.floor, this.shadow, ...this.lines]) {
      layer.geometry.dispose();
      layer.material.dispose();
    }
  }
}

const smooth = (from: number, to: number, at: number) => {
  const share = Math.max(0, Math.min(1, (at - from) / (to - from)));
  return share * share * (3 - 2 * share);
};

/** How much of the floor is seen so far from its middle. */
const seenAt = (radiusM: number) => 1 - smooth(LINES_M, RADIUS_M, radiusM);

function disc(): BufferGeometry {
  const [positions, colours, index]: [number[], number[], number[]] = [[], [], []];
  const [near, far] = [new Color(NEAR_FLOOR), new Color(FAR_FLOOR)];
  for (let ring = 0; ring <= RINGS; ring++) {
    const radius = RADIUS_M * (ring / RINGS) ** 1.5;
    const colour = near.clone().lerp(far, smooth(1, 9, radius));
    for (let i = 0; i <= SEGMENTS; i++) {
      const angle = (i / SEGMENTS) * 2 * Math.PI;
      positions.push(radius * Math.cos(angle), 0, radius * Math.sin(angle));
      colours.push(colour.r, colour.g, colour.b, seenAt(radius));
      if (ring === 0 || i === 0) continue;
      const [a, b] = [(ring - 1) * (SEGMENTS + 1) + i - 1, ring * (SEGMENTS + 1) + i - 1];
      index.push(a, a + 1, b, a + 1, b + 1, b);
    }
  }
  return new BufferGeometry()
    .setAttribute("position", new Float32BufferAttribute(positions, 3))
    .setAttribute("color", new Float32BufferAttribute(colours, 4))
    .setIndex(index);
}

/** Lines at each step, which fade as the floor does. */
function grid(step: number, hex: number): LineSegments<BufferGeometry, LineBasicMaterial> {
  const [positions, colours]: [number[], number[]] = [[], []];
  const { r, g, b } = new Color(hex);
  const put = (x: number, z: number) => {
    positions.push(x, 0, z);
    colours.push(r, g, b, 1 - smooth(2, LINES_M, Math.hypot(x, z)));
  };
  for (let at = -LINES_M; at <= LINES_M + 1e-6; at += step) {
    for (let from = -LINES_M; from < LINES_M; from++) {
      put(from, at);
      put(from + 1, at);
      put(at, from);
      put(at, from + 1);
    }
  }
  const geometry = new BufferGeometry()
    .setAttribute("position", new Float32BufferAttribute(positions, 3))
    .setAttribute("color", new Float32BufferAttribute(colours, 4));
  const material = new LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, toneMapped: false });
  return new LineSegments(geometry, material);
}
