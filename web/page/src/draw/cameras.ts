/** The rig's cameras: frusta with live images on their planes, and one image behind the scene. */
import {
  BufferGeometry,
  Color,
  CustomBlending,
  Float32BufferAttribute,
  GLSL3,
  Group,
  Mesh,
  NoColorSpace,
  OneFactor,
  OneMinusSrcAlphaFactor,
  RawShaderMaterial,
  SrcAlphaFactor,
  Texture,
  Vector2,
  Vector4,
  LinearFilter,
  DoubleSide,
} from "three";
import type { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { type Camera, border, normalised, pointAt } from "../view/lens.ts";
import { thick } from "./lines.ts";

/** How long a frustum is drawn, metres. */
const LENGTH_M = 0.42;
/** Steps across an image plane: enough to bend it as the lens does. */
const STEPS = 16;

const VERTEX = /* glsl */ `
in vec3 position;
in vec2 uv;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
out vec2 at;
void main() {
  at = uv;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}
`;

const FRAGMENT = /* glsl */ `
precision highp float;
precision highp sampler2D;
uniform sampler2D uImage;
uniform float uOpacity;
in vec2 at;
out vec4 colour;
void main() { colour = vec4(texture(uImage, at).rgb, uOpacity); }
`;

/** Behind the scene: the image without its lens, by the lens of every pixel. */
const BACKDROP_FRAGMENT = /* glsl */ `
precision highp float;
precision highp sampler2D;
uniform sampler2D uImage;
uniform float uOpacity;
uniform vec4 uView;
uniform float uHeight;
uniform vec4 uMatrix;
uniform vec2 uMatrix2;
uniform vec4 uBend;
uniform vec4 uBend3;
out vec4 colour;
void main() {
  vec2 px = vec2(gl_FragCoord.x, uHeight - gl_FragCoord.y);
  vec2 n = (px - uView.zw) / uView.xy;
  float r2 = dot(n, n);
  if (r2 > uBend3.y * uBend3.y) discard;
  float c = 1.0 + r2 * (uBend.x + r2 * (uBend.y + r2 * uBend3.x));
  float xy = n.x * n.y;
  vec2 d = c * n + vec2(2.0 * uBend.z * xy + uBend.w * (r2 + 2.0 * n.x * n.x), uBend.z * (r2 + 2.0 * n.y * n.y) + 2.0 * uBend.w * xy);
  vec2 uv = (vec2(uMatrix.x * d.x + uMatrix.y * d.y + uMatrix.z, uMatrix2.x * d.y + uMatrix.w) + 0.5) / uBend3.zw;
  if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) discard;
  colour = vec4(texture(uImage, uv).rgb, uOpacity);
}
`;

interface Drawn {
  readonly camera: Camera;
  readonly lines: LineSegments2;
  readonly plane: Mesh;
  readonly material: RawShaderMaterial;
  readonly texture: Texture;
  readonly lineMaterial: LineMaterial;
  hasImage: boolean;
}

/** A colour for each camera, evenly round the wheel. */
export function cameraColor(index: number, count: number): Color {
  return new Color().setHSL(((index * 0.618034) % 1) * (count > 0 ? 1 : 0), 0.45, 0.68);
}

export class Cameras {
  readonly group = new Group();
  readonly backdrop: Mesh;
  private readonly drawn: Drawn[];
  private readonly behind: RawShaderMaterial;
  private readonly behindTexture = imageTexture();
  private missing: ReadonlySet<number> = new Set();

  constructor(cameras: readonly Camera[]) {
    this.drawn = cameras.map((camera) => this.make(camera, cameras.length));
    this.behind = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: "in vec3 position; void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: BACKDROP_FRAGMENT,
      uniforms: {
        uImage: { value: this.behindTexture },
        uOpacity: { value: 0 },
        uView: { value: new Vector4() },
        uHeight: { value: 1 },
        uMatrix: { value: new Vector4() },
        uMatrix2: { value: new Vector2() },
        uBend: { value: new Vector4() },
        uBend3: { value: new Vector4() },
      },
      // Also where it counts as opaque: behind the scene it is drawn before opaque bodies.
      blending: CustomBlending,
      blendSrc: SrcAlphaFactor,
      blendDst: OneMinusSrcAlphaFactor,
      blendSrcAlpha: OneFactor,
      blendDstAlpha: OneMinusSrcAlphaFactor,
      depthTest: false,
      depthWrite: false,
    });
    const square = new BufferGeometry().setAttribute(
      "position",
      new Float32BufferAttribute([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0], 3),
    );
    this.backdrop = new Mesh(square, this.behind);
    this.backdrop.frustumCulled = false;
    this.backdrop.visible = false;
  }

  /** A new small image of a camera; the bitmap is kept, and the one before closed. */
  thumbnail(index: number, bitmap: ImageBitmap): void {
    const drawn = this.drawn[index];
    if (!drawn) return bitmap.close();
    put(drawn.texture, bitmap);
    drawn.hasImage = true;
  }

  /** Whether a camera's frustum has an image. */
  hasThumbnail(index: number): boolean {
    return this.drawn[index]?.hasImage ?? false;
  }

  /** Whether images are drawn on the frusta; the camera that is looked through is not drawn itself. */
  show(lines: boolean, images: boolean, except: number | null): void {
    this.drawn.forEach((drawn, index) => {
      drawn.lines.visible = lines && index !== except;
      drawn.plane.visible = lines && images && drawn.hasImage && index !== except;
    });
  }

  /** Marks cameras that are not there; returns whether others are missing than before. */
  health(missing: ReadonlySet<number>): boolean {
    if (missing.size === this.missing.size && [...missing].every((index) => this.missing.has(index))) return false;
    this.missing = missing;
    this.drawn.forEach((drawn, index) => {
      drawn.lineMaterial.color.copy(missing.has(index) ? new Color(0xe06c5a) : cameraColor(index, this.drawn.length));
    });
    return true;
  }

  /** The image behind the scene, or in front of it. */
  behindImage(bitmap: ImageBitmap): void {
    put(this.behindTexture, bitmap);
  }

  /** Lays the image of a camera over the view of it; `pinhole` in pixels of the drawing buffer. */
  lookThrough(camera: Camera | null, pinhole: readonly number[], height: number, opacity: number, inFront: boolean): void {
    this.backdrop.visible = camera !== null && opacity > 0 && this.behindTexture.image !== null;
    if (!camera) return;
    const u = this.behind.uniforms;
    const [m0, m1] = camera.matrix;
    const [k1, k2, p1, p2, k3] = camera.distortions;
    u.uOpacity.value = opacity;
    (u.uView.value as Vector4).fromArray(pinhole as number[]);
    u.uHeight.value = height;
    (u.uMatrix.value as Vector4).set(m0[0], m0[1], m0[2], m1[2]);
    (u.uMatrix2.value as Vector2).set(m1[1], 0);
    (u.uBend.value as Vector4).set(k1, k2, p1, p2);
    (u.uBend3.value as Vector4).set(k3, camera.radiusLimit, camera.width, camera.height);
    // A transparent material is drawn after all opaque ones, whatever its order.
    this.behind.transparent = inFront;
    this.backdrop.renderOrder = inFront ? 1000 : -1000;
  }

  /** Whether the camera that is looked through has shown its image. */
  get hasImageBehind(): boolean {
    return this.behindTexture.image !== null;
  }

  /** Forgets the image behind the scene: another camera's comes. */
  clearBehind(): void {
    if (this.behindTexture.image) (this.behindTexture.image as ImageBitmap).close();
    this.behindTexture.image = null;
    this.backdrop.visible = false;
  }

  /** The card lost everything: the images are put onto it again when it is there. */
  release(): void {
    for (const texture of [this.behindTexture, ...this.drawn.map((drawn) => drawn.texture)]) {
      texture.dispose();
      if (texture.image) texture.needsUpdate = true;
    }
  }

  /** Image planes, for picking a camera with the pointer. */
  planes(): Mesh[] {
    return this.drawn.filter((drawn) => drawn.lines.visible).map((drawn) => drawn.plane);
  }

  dispose(): void {
    for (const drawn of this.drawn) {
      drawn.lines.geometry.dispose();
      drawn.plane.geometry.dispose();
      drawn.material.dispose();
      drawn.lineMaterial.dispose();
      if (drawn.hasImage) (drawn.texture.image as ImageBitmap).close();
      drawn.texture.dispose();
    }
    this.clearBehind();
    this.behindTexture.dispose();
    this.behind.dispose();
    this.backdrop.geometry.dispose();
  }

  private make(camera: Camera, count: number): Drawn {
    const lineMaterial = thick(cameraColor(camera.index, count), 0.9);
    const lines = new LineSegments2(frustum(camera), lineMaterial);
    const texture = imageTexture();
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { uImage: { value: texture }, uOpacity: { value: 0.92 } },
      transparent: true,
      side: DoubleSide,
    });
    const plane = new Mesh(imagePlane(camera), material);
    plane.userData.camera = camera.index;
    plane.visible = false;
    this.group.add(lines, plane);
    return { camera, lines, plane, material, texture, lineMaterial, hasImage: false };
  }
}

function imageTexture(): Texture {
  const texture = new Texture();
  texture.image = null;
  texture.colorSpace = NoColorSpace;
  texture.minFilter = LinearFilter;
  texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.flipY = false;
  return texture;
}

function put(texture: Texture, bitmap: ImageBitmap): void {
  const before = texture.image as ImageBitmap | null;
  // Textures have a fixed size once they are on the card.
  if (before && (before.width !== bitmap.width || before.height !== bitmap.height)) texture.dispose();
  before?.close();
  texture.image = bitmap;
  texture.needsUpdate = true;
}

function frustum(camera: Camera): LineSegmentsGeometry {
  const numbers: number[] = [];
  const edge = border(camera, 12).map(([u, v]) => normalised(camera, u, v));
  // Sides interleave as top, right, bottom, left: put them in one round.
  const round = [0, 1, 2, 3].flatMap((side) => edge.filter((_, i) => i % 4 === side));
  const points = round.filter((n) => n !== null).map((n) => pointAt(camera, n[0], n[1], LENGTH_M));
  points.forEach((point, i) => numbers.push(...point, ...points[(i + 1) % points.length]));
  for (const [u, v] of [[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]]) {
    const n = normalised(camera, u - 0.5, v - 0.5);
    if (n) numbers.push(...camera.centre, ...pointAt(camera, n[0], n[1], LENGTH_M));
  }
  return new LineSegmentsGeometry().setPositions(numbers);
}

function imagePlane(camera: Camera): BufferGeometry {
  const [positions, uvs, index]: [number[], number[], number[]] = [[], [], []];
  for (let row = 0; row <= STEPS; row++) {
    for (let column = 0; column <= STEPS; column++) {
      const [s, t] = [column / STEPS, row / STEPS];
      const n = normalised(camera, s * camera.width - 0.5, t * camera.height - 0.5) ?? [0, 0];
      positions.push(...pointAt(camera, n[0], n[1], LENGTH_M));
      uvs.push(s, t);
      if (row === STEPS || column === STEPS) continue;
      const a = row * (STEPS + 1) + column;
      const b = a + STEPS + 1;
      index.push(a, b, a + 1, a + 1, b, b + 1);
    }
  }
  return new BufferGeometry()
    .setAttribute("position", new Float32BufferAttribute(positions, 3))
    .setAttribute("uv", new Float32BufferAttribute(uvs, 2))
    .setIndex(index);
}
