/** All that is drawn, and the order of it. Knows nothing of sockets, pages or time. */
import {
  AmbientLight,
  BoxGeometry,
  Color,
  DirectionalLight,
  DoubleSide,
  FogExp2,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  BufferGeometry,
  Float32BufferAttribute,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  PCFShadowMap,
  PerspectiveCamera,
  PlaneGeometry,
  Quaternion,
  Scene,
  ShadowMaterial,
  Vector3,
  WebGLRenderer,
} from "three";
import type { Decoded } from "../decode/work.ts";
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import type { Hello, Scene as SceneText } from "../feed/text.ts";
import type { HullMode, Layer } from "../view/hash.ts";
import { type Camera, camera as makeCamera } from "../view/lens.ts";
import { Bodies } from "./bodies.ts";
import { Cameras } from "./cameras.ts";
import { Cones } from "./cones.ts";
import { type Eye, eyeOf, FAR_M, NEAR_M } from "./eye.ts";
import { HullView } from "./hull.ts";
import * as glsl from "./glsl/index.ts";
import type { Level } from "./quality.ts";
import { Patches } from "./patches.ts";
import { Touches } from "./touches.ts";

export const BACKGROUND = 0x14171c;
const SHADOW_SIZE = 1024;

/** One view to draw. */
export interface Picture {
  readonly eye: readonly [number, number, number];
  readonly target: readonly [number, number, number];
  readonly up: readonly [number, number, number];
  readonly fovDeg: number;
  /** The camera that is looked through, with how much of its image is seen and whether before the scene. */
  readonly through: { readonly camera: Camera; readonly opacity: number; readonly inFront: boolean } | null;
  readonly mode: HullMode;
  /** Whether the person is drawn grey: it is not that of now. */
  readonly isGrey: boolean;
  readonly layers: ReadonlySet<Layer>;
  readonly level: Level;
  /** Pixels of the drawing buffer that panels cover at the right and at the bottom. */
  readonly covered: readonly [number, number];
}

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly view = new PerspectiveCamera(45, 1, NEAR_M, FAR_M);
  readonly bodies = new Bodies();
  readonly touches = new Touches();
  readonly patches = new Patches();
  cameras: Cameras | null = null;
  cones: Cones | null = null;
  hull: HullView | null = null;
  rig: readonly Camera[] = [];
  hello: Hello | null = null;
  private readonly scene = new Scene();
  private readonly light = new DirectionalLight(0xfff4e6, 2.1);
  private readonly ground = new Group();
  private shadowBox: Mesh | null = null;
  private shadowsAreOld = true;
  private cut = { mode: "photo" as HullMode, shadows: false };

  constructor(canvas: HTMLCanvasElement, antialias: boolean) {
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: false, powerPreference: "high-performance" });
    this.renderer.autoClear = true;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.info.autoReset = true;
    this.scene.background = new Color(BACKGROUND);
    this.scene.fog = new FogExp2(BACKGROUND, 0.028);
    this.scene.add(new AmbientLight(0xffffff, 0.35), new HemisphereLight(0xdfe8f5, 0x3a3833, 1.0), this.light, this.light.target);
    this.light.castShadow = true;
    this.light.shadow.mapSize.set(SHADOW_SIZE, SHADOW_SIZE);
    this.light.shadow.bias = -0.0008;
    this.light.shadow.normalBias = 0.01;
    this.scene.add(this.ground, this.bodies.group, this.touches.group, this.patches.group);
  }

  /** A rig: everything that depends on the cameras is made again. */
  async setRig(hello: Hello): Promise<void> {
    this.hello = hello;
    this.rig = hello.cameras.map(makeCamera);
    for (const old of [this.cameras, this.cones, this.hull]) old?.dispose();
    if (this.cameras) this.scene.remove(this.cameras.group, this.cameras.backdrop);
    if (this.cones) this.scene.remove(this.cones.group);
    if (this.hull) this.scene.remove(this.hull.compose);
    this.cameras = new Cameras(this.rig);
    this.cones = new Cones(this.rig);
    this.hull = new HullView(this.rig, {
      cameras: this.rig.length,
      offImageIsOutside: hello.rule.out_of_view === "outside",
      minViews: hello.rule.min_views,
      straight: this.rig.every(({ straight }) => straight),
      ignoring: this.rig.some(({ ignored }) => ignored),
    });
    this.hull.up = hello.up;
    this.scene.add(this.cameras.group, this.cameras.backdrop, this.cones.group, this.hull.compose);
    this.aimLight(hello);
    this.makeShadowBox();
    this.makeGround(hello);
    await this.hull.compile(this.renderer);
  }

  setScene(scene: SceneText): void {
    if (this.hello && scene.floor_m !== undefined && scene.floor_m !== this.hello.floor_m) {
      // Another scene may stand on another floor.
      this.hello = { ...this.hello, floor_m: scene.floor_m };
      this.makeGround(this.hello);
    }
    this.bodies.describe(scene.bodies);
    this.shadowsAreOld = true;
  }

  /** A decoded frame set becomes the person that is drawn. */
  showFrame(set: Decoded): void {
    if (!this.hull || !this.hello) return;
    this.hull.upload(this.renderer, set);
    if (set.cameras.some((part) => part.contour)) this.cones?.show(set, this.hello.volume);
    this.shadowsAreOld = true;
  }

  showWorld(world: WorldMessage, bodies: readonly BodyPose[], withTouches: boolean): void {
    this.bodies.place(bodies);
    if (withTouches) {
      this.touches.show(world, bodies);
      this.patches.show(world.patches);
    }
    this.shadowsAreOld = true;
  }

  resize(width: number, height: number, ratio: number): void {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  /** Drawing buffer, pixels. */
  size(): readonly [number, number] {
    const canvas = this.renderer.domElement;
    return [canvas.width, canvas.height];
  }

  draw(picture: Picture): void {
    const [width, height] = this.size();
    const eye = this.aim(picture, width, height);
    const { layers, mode, level } = picture;
    this.ground.visible = layers.has("grid");
    this.bodies.group.visible = layers.has("bodies");
    this.touches.group.visible = layers.has("touches");
    this.patches.group.visible = layers.has("touches");
    this.cameras?.show(layers.has("cameras"), layers.has("images"), picture.through?.camera.index ?? null);
    if (this.cones) this.cones.group.visible = mode === "cones";
    this.cameras?.lookThrough(picture.through?.camera ?? null, eye.pinhole, height, picture.through?.opacity ?? 0, picture.through?.inFront ?? false);
    const scale = level.scale;
    const [w, h] = [Math.max(8, Math.round(width * scale)), Math.max(8, Math.round(height * scale))];
    const shrunk: Eye = { ...eye, pinhole: [eye.pinhole[0] * (w / width), eye.pinhole[1] * (h / height), eye.pinhole[2] * (w / width), eye.pinhole[3] * (h / height)] };
    if (this.hull) this.hull.fade = picture.isGrey ? 1 : 0;
    this.hull?.draw(this.renderer, shrunk, w, h, mode, level, [width, height]);
    this.shadows(layers.has("shadows") && level.shadows, mode);
    this.renderer.setRenderTarget(null);
    this.renderer.render(this.scene, this.view);
  }

  /** The person's depth at a point of the last picture, shares from the top left. */
  hullDepthAt(x: number, y: number): number | null {
    return this.hull?.depthAt(this.renderer, x, y) ?? null;
  }

  /** The hull's shading, position, and so on alone, through any pinhole: for checks. */
  hullPicture(eye: Eye, width: number, height: number, mode: "photo" | "shaded"): { rgba: Uint8Array; depth: Float32Array } | null {
    return this.hull?.picture(this.renderer, eye, width, height, mode) ?? null;
  }

  /**
   * The card lost everything: frees all that was on it while that is allowed. What the page holds itself
   * goes back onto the card by itself.
   */
  release(): void {
    this.scene.traverse((thing) => {
      const { geometry, material } = thing as Mesh;
      geometry?.dispose();
      for (const each of Array.isArray(material) ? material : material ? [material] : []) each.dispose();
      thing.customDepthMaterial?.dispose();
    });
    this.light.shadow.map?.dispose();
    this.light.shadow.map = null;
    this.hull?.release();
    this.cameras?.release();
    this.shadowsAreOld = true;
  }

  /** A point of the world as the last picture has it, −1 to 1; null behind the view. */
  toClip(point: readonly [number, number, number]): [number, number] | null {
    const at = new Vector3(...point).applyMatrix4(this.view.matrixWorldInverse);
    if (at.z > -NEAR_M) return null;
    at.applyMatrix4(this.view.projectionMatrix);
    return [at.x, at.y];
  }

  dispose(): void {
    for (const old of [this.cameras, this.cones, this.hull, this.bodies, this.touches, this.patches]) old?.dispose();
    this.renderer.dispose();
  }

  /** Points the three.js camera; returns the same view for the hull. */
  private aim(picture: Picture, width: number, height: number): Eye {
    const { view } = this;
    let pinhole: [number, number, number, number];
    const free = [Math.max(width / 3, width - picture.covered[0]), Math.max(height / 3, height - picture.covered[1])];
    if (picture.through) {
      const { camera } = picture.through;
      const s = Math.min(free[0] / camera.width, free[1] / camera.height);
      const [m0, m1] = camera.matrix;
      pinhole = [m0[0] * s, m1[1] * s, free[0] / 2 + (m0[2] + 0.5 - camera.width / 2) * s, free[1] / 2 + (m1[2] + 0.5 - camera.height / 2) * s];
      view.position.fromArray(camera.centre);
      const [r0, r1, r2] = camera.rotation;
      const basis = new Matrix4().makeBasis(new Vector3(...r0), new Vector3(...r1).negate(), new Vector3(...r2).negate());
      view.quaternion.setFromRotationMatrix(basis);
    } else {
      // Upright screens keep the width in view that wide ones have.
      const tan = Math.tan((picture.fovDeg * Math.PI) / 360) * Math.max(1, Math.min(1.6, free[1] / free[0]));
      const f = free[1] / 2 / tan;
      pinhole = [f, f, free[0] / 2, free[1] / 2];
      view.position.fromArray(picture.eye);
      view.up.fromArray(picture.up);
      view.lookAt(...picture.target);
    }
    const [fx, fy, cx, cy] = pinhole;
    view.projectionMatrix.makePerspective((-cx / fx) * NEAR_M, ((width - cx) / fx) * NEAR_M, (cy / fy) * NEAR_M, (-(height - cy) / fy) * NEAR_M, NEAR_M, FAR_M);
    view.projectionMatrixInverse.copy(view.projectionMatrix).invert();
    view.updateMatrixWorld(true);
    return eyeOf(view, pinhole);
  }

  private aimLight(hello: Hello): void {
    const { low, high } = hello.volume;
    const middle = new Vector3(...low).add(new Vector3(...high)).multiplyScalar(0.5);
    const up = new Vector3(...hello.up);
    const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), up);
    const towards = new Vector3(0.42, 0.86, 0.46).normalize().applyQuaternion(turn);
    const radius = Math.max(1.5, Math.min(6, 0.5 * new Vector3(...high).sub(new Vector3(...low)).length()));
    this.light.target.position.copy(middle);
    this.light.position.copy(middle).addScaledVector(towards, radius * 2.5);
    const frustum = this.light.shadow.camera;
    [frustum.left, frustum.right, frustum.top, frustum.bottom] = [-radius, radius, radius, -radius];
    [frustum.near, frustum.far] = [0.1, radius * 5];
    frustum.updateProjectionMatrix();
    this.light.target.updateMatrixWorld();
    if (this.hull) this.hull.light = towards;
  }

  /** A box that only the light sees: its shader marches to the hull. */
  private makeShadowBox(): void {
    if (this.shadowBox) this.scene.remove(this.shadowBox);
    const hull = this.hull!;
    const material = hull.material(glsl.SHADOW_VERTEX, glsl.SHADOW_FRAGMENT, hull.common);
    material.depthTest = true;
    material.depthWrite = true;
    material.side = DoubleSide;
    const unseen = new MeshBasicMaterial({ colorWrite: false, depthWrite: false });
    this.shadowBox = new Mesh(new BoxGeometry(1, 1, 1), unseen);
    this.shadowBox.customDepthMaterial = material;
    this.shadowBox.castShadow = true;
    this.shadowBox.frustumCulled = false;
    this.scene.add(this.shadowBox);
  }

  private shadows(wanted: boolean, mode: HullMode): void {
    if (wanted !== this.cut.shadows || mode !== this.cut.mode) this.shadowsAreOld = true;
    this.cut = { mode, shadows: wanted };
    this.light.castShadow = wanted;
    const box = this.hull?.box;
    if (this.shadowBox) {
      this.shadowBox.visible = wanted && !!box && mode !== "off";
      if (box) {
        this.shadowBox.position.fromArray(box.low.map((l, i) => (l + box.high[i]) / 2));
        this.shadowBox.scale.fromArray(box.low.map((l, i) => Math.max(1e-3, box.high[i] - l)));
      }
    }
    if (wanted && this.shadowsAreOld) {
      this.renderer.shadowMap.needsUpdate = true;
      this.shadowsAreOld = false;
    }
  }

  private makeGround(hello: Hello): void {
    for (const child of [...this.ground.children]) {
      this.ground.remove(child);
      if (child instanceof Mesh || child instanceof LineSegments) child.geometry.dispose();
    }
    const { low, high } = hello.volume;
    const up = new Vector3(...hello.up);
    const along = (p: readonly number[]) => p[0] * up.x + p[1] * up.y + p[2] * up.z;
    const height = hello.floor_m ?? Math.min(along(low), along(high));
    const middle = new Vector3(...low).add(new Vector3(...high)).multiplyScalar(0.5);
    this.ground.position.copy(middle).addScaledVector(up, height - middle.dot(up));
    this.ground.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), up);
    // Lines fall on whole metres of the world, if up is up.
    if (Math.abs(up.y) > 0.999) {
      this.ground.position.x = Math.round(middle.x);
      this.ground.position.z = Math.round(middle.z);
    }
    this.ground.add(lines(8, 0.25, 0x232830), lines(8, 1, 0x39414d));
    const floor = new Mesh(new PlaneGeometry(16, 16), new ShadowMaterial({ color: 0x000000, opacity: 0.42 }));
    floor.rotation.x = -Math.PI / 2;
    floor.position.y = -0.002;
    floor.receiveShadow = true;
    this.ground.add(floor);
  }
}

function lines(half: number, step: number, color: number): LineSegments {
  const numbers: number[] = [];
  for (let at = -half; at <= half + 1e-6; at += step) {
    numbers.push(-half, 0, at, half, 0, at, at, 0, -half, at, 0, half);
  }
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(numbers, 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color }));
}
