/** Rings that widen and fade where bodies begin to be touched. */
import { DynamicDrawUsage, Float32BufferAttribute, GreaterDepth, Group, InstancedBufferAttribute, InstancedBufferGeometry, type DepthModes, LessEqualDepth, Mesh, ShaderMaterial } from "three";
import type { Vec3 } from "../view/lens.ts";

/** A ring is gone after so long, milliseconds. */
export const LIFE_MS = 600;
/** At once at most; the oldest gives way. */
export const MAX_RIPPLES = 64;
/** Nothing of a ring is farther from its middle, metres. */
export const REACH_M = 0.09;
/** Surfaces that are no more than this before a ring do not hide it, metres: it lies between body and person. */
const BIAS_M = 0.03;
/** What bodies and the person hide of a ring is seen so much. */
const HIDDEN_SHARE = 0.3;

/** A square around each ring, across its normal, turned towards the eye as far as is needed to see it. */
const VERTEX = /* glsl */ `
in vec4 aRing;
in vec3 aNormal;
out vec2 at;
out float age;
void main() {
  vec3 toEye = normalize(cameraPosition - aRing.xyz);
  vec3 facing = normalize((dot(aNormal, toEye) < 0.0 ? -aNormal : aNormal) + 0.7 * toEye);
  vec3 across = normalize(cross(abs(facing.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0), facing));
  at = position.xy;
  age = aRing.w;
  vec3 corner = aRing.xyz + ${REACH_M.toFixed(3)} * (position.x * across + position.y * cross(facing, across));
  vec4 seen = viewMatrix * vec4(corner, 1.0);
  gl_Position = projectionMatrix * seen;
  // The depth is that of a point nearer to the eye.
  seen.z += min(${BIAS_M.toFixed(3)}, -0.5 * seen.z);
  vec4 nearer = projectionMatrix * seen;
  gl_Position.z = nearer.z / nearer.w * gl_Position.w;
}
`;

/** A bright ring and a dark one inside it, so that it is seen on any colour. Its colour is the screen's, times alpha. */
const FRAGMENT = /* glsl */ `
uniform float uShare;
in vec2 at;
in float age;
float bell(float x) { return exp(-x * x); }
void main() {
  float left = 1.0 - age;
  float radius = mix(0.86, 0.25, left * left);
  float width = mix(0.06, 0.14, left * left);
  float r = length(at);
  float bright = max(bell((r - radius) / width), max(0.0, 1.0 - 3.0 * age) * bell(r / 0.25));
  float dark = 0.4 * bell((r - radius + 1.8 * width) / width) * (1.0 - bright);
  float seen = 0.85 * uShare * left * sqrt(left) * (1.0 - smoothstep(0.92, 1.0, r));
  gl_FragColor = seen * vec4(vec3(1.0, 0.87, 0.62) * bright, bright + dark);
}
`;

interface Ring {
  readonly point: Vec3;
  readonly normal: Vec3;
  readonly beganMs: number;
}

export class Ripples {
  readonly group = new Group();
  /** Oldest first. */
  private readonly rings: Ring[] = [];
  private readonly geometry = new InstancedBufferGeometry();
  /** Of each ring its middle and the share of its life that is over. */
  private readonly places = new InstancedBufferAttribute(new Float32Array(MAX_RIPPLES * 4), 4);
  private readonly normals = new InstancedBufferAttribute(new Float32Array(MAX_RIPPLES * 3), 3);
  private readonly materials: readonly ShaderMaterial[];

  constructor() {
    for (const attribute of [this.places, this.normals]) attribute.setUsage(DynamicDrawUsage);
    this.geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0], 3));
    this.geometry.setAttribute("aRing", this.places);
    this.geometry.setAttribute("aNormal", this.normals);
    this.geometry.instanceCount = 0;
    // Each pixel of a ring is drawn by one of the two. Both are in the scene from the start: shaders compile before the first touch.
    this.materials = [material(1, LessEqualDepth), material(HIDDEN_SHARE, GreaterDepth)];
    for (const each of this.materials) {
      const mesh = new Mesh(this.geometry, each);
      mesh.frustumCulled = false;
      mesh.renderOrder = 40;
      this.group.add(mesh);
    }
  }

  /** Rings that are drawn. */
  get count(): number {
    return this.geometry.instanceCount;
  }

  /** A ring begins, across a unit normal; facing the eye without one. It is drawn after the next {@link advance}. */
  add(point: Vec3, normal: Vec3 | null, nowMs: number): void {
    if (this.rings.length === MAX_RIPPLES) this.rings.shift();
    this.rings.push({ point, normal: normal ?? [0, 0, 0], beganMs: nowMs });
  }

  /** Makes rings as old as they are now; returns whether the picture changes by that. */
  advance(nowMs: number): boolean {
    if (this.rings.length === 0) return false;
    while (this.rings.length > 0 && nowMs - this.rings[0].beganMs >= LIFE_MS) this.rings.shift();
    this.rings.forEach(({ point, normal, beganMs }, index) => {
      this.places.setXYZW(index, ...point, Math.max(0, nowMs - beganMs) / LIFE_MS);
      this.normals.setXYZ(index, ...normal);
    });
    this.places.needsUpdate = true;
    this.normals.needsUpdate = true;
    this.geometry.instanceCount = this.rings.length;
    return true;
  }

  dispose(): void {
    this.geometry.dispose();
    for (const each of this.materials) each.dispose();
  }
}

function material(share: number, depthFunc: DepthModes): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: { uShare: { value: share } },
    transparent: true,
    premultipliedAlpha: true,
    depthFunc,
    depthWrite: false,
    toneMapped: false,
  });
}
