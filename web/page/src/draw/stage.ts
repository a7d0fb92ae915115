/** All that is drawn, and the order of it. Knows nothing of sockets, pages or time. */
import {
  BasicShadowMap,
  Color,
  Matrix4,
  type Mesh,
  NeutralToneMapping,
  PCFShadowMap,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import type { Background } from "../audience.ts";
import type { Decoded } from "../decode/work.ts";
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import type { Hello, Scene as SceneText } from "../feed/text.ts";
import type { HullMode, Layer } from "../view/hash.ts";
import { type Camera, camera as makeCamera } from "../view/lens.ts";
import { Bodies } from "./bodies.ts";
import { Cameras } from "./cameras.ts";
import { Cones } from "./cones.ts";
import { ContactShadow } from "./contact_shadow.ts";
import { type Eye, eyeOf, FAR_M, NEAR_M } from "./eye.ts";
import { Ground } from "./ground.ts";
import { HullView } from "./hull.ts";
import { Light } from "./light.ts";
import { MeanPicture } from "./mean.ts";
import { Patches } from "./patches.ts";
import { Preview } from "./preview.ts";
import type { Level } from "./quality.ts";
import { type Part, SHIFTS } from "./refinement.ts";
import { Ripples } from "./ripples.ts";
import { CLEAR, Sky } from "./sky.ts";
import { Touches } from "./touches.ts";

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
  readonly ripples = new Ripples();
  readonly preview = new Preview();
  cameras: Cameras | null = null;
  cones: Cones | null = null;
  hull: HullView | null = null;
  rig: readonly Camera[] = [];
  hello: Hello | null = null;
  /** The view of the last picture, in pixels of the drawing buffer. */
  seen: Eye | null = null;
  private readonly scene = new Scene();
  private readonly contact = new ContactShadow();
  private readonly mean = new MeanPicture();
  private readonly light: Light;
  private readonly ground: Ground;
  private readonly sky: Sky;
  /** Whether there is a floor and a sky. */
  private readonly isRoom: boolean;

  constructor(canvas: HTMLCanvasElement, { antialias, software }: { antialias: boolean; software: boolean }, background: Background) {
    this.light = new Light(this.contact, !software);
    this.ground = new Ground(this.contact, !software);
    this.sky = new Sky(!software);
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: background === "transparent", powerPreference: "high-performance" });
    this.renderer.autoClear = true;
    this.renderer.shadowMap.enabled = true;
    // Soft edges cost the processor more than all else on the floor.
    this.renderer.shadowMap.type = software ? BasicShadowMap : PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.info.autoReset = true;
    // Of bodies alone: the person's colours are the cameras', and lines and floor are drawn as they are meant.
    this.renderer.toneMapping = NeutralToneMapping;
    this.isRoom = background === "room";
    this.sky.mesh.visible = this.isRoom;
    this.scene.background = background === "transparent" ? null : new Color(background === "room" ? CLEAR : background);
    if (background === "transparent") this.renderer.setClearAlpha(0);
    this.scene.environmentIntensity = 0.5;
    this.scene.add(this.light.group, this.sky.mesh);
    this.scene.add(this.ground.group, this.bodies.group, this.touches.group, this.patches.group, this.ripples.group, this.preview.mesh);
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
    this.light.setRig(hello, this.hull);
    this.sky.up = new Vector3(...hello.up);
    this.ground.place(hello);
    await this.hull.compile(this.renderer);
  }

  setScene(scene: SceneText): void {
    if (this.hello && scene.floor_m !== undefined && scene.floor_m !== this.hello.floor_m) {
      // Another scene may stand on another floor.
      this.hello = { ...this.hello, floor_m: scene.floor_m };
      this.ground.place(this.hello);
    }
    this.bodies.describe(scene.bodies);
    this.light.invalidate(true);
  }

  /** A decoded frame set becomes the person that is drawn. */
  showFrame(set: Decoded): void {
    if (!this.hull || !this.hello) return;
    this.hull.upload(this.renderer, set);
    if (set.cameras.some((part) => part.contour)) this.cones?.show(set, this.hello.volume);
    this.light.invalidate(false);
  }

  showWorld(world: WorldMessage, bodies: readonly BodyPose[], withTouches: boolean): void {
    this.bodies.place(bodies, world.patches);
    if (withTouches) {
      this.touches.show(world, bodies);
      this.patches.show(world.patches);
    }
    this.light.invalidate(true);
  }

  /** Moves on what fades: ripples, and the rims of bodies. Returns whether the picture changes by that. */
  advance(nowMs: number): boolean {
    const haveRipples = this.ripples.advance(nowMs);
    return this.bodies.advance(nowMs) || haveRipples;
  }

  resize(width: number, height: number, ratio: number): void {
    this.mean.forget();
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
    const eye = this.arrange(picture, width, height, [0, 0]);
    const { mode, level } = picture;
    const { scale } = level;
    // What stands no longer is not kept: on a wall it is a hundred megabytes.
    this.mean.forget();
    const [w, h] = [Math.max(8, Math.round(width * scale)), Math.max(8, Math.round(height * scale))];
    const shrunk: Eye = { ...eye, pinhole: [eye.pinhole[0] * (w / width), eye.pinhole[1] * (h / height), eye.pinhole[2] * (w / width), eye.pinhole[3] * (h / height)] };
    this.hull?.draw(this.renderer, shrunk, w, h, mode, level, [width, height]);
    this.drawScene(picture);
  }

  /**
   * Draws a part of a picture that stands, its pixels shifted, the person at the size of the screen. The part that completes
   * the picture shows the mean of all such pictures so far.
   */
  refine(picture: Picture, { sample, rows }: Part): void {
    const [width, height] = this.size();
    const { mode, level } = picture;
    const eye = this.arrange(picture, width, height, SHIFTS[sample]);
    if (rows) {
      this.hull?.drawRows(this.renderer, eye, width, height, mode, level, rows);
    } else {
      // The edges of the first picture are softened: alone it is jagged.
      this.hull?.readyRows(eye, width, height, mode, sample > 0);
      this.drawScene(picture);
      this.mean.add(this.renderer, width, height, sample + 1);
    }
    // Pointers see through the view as it is.
    this.aim(picture, width, height, [0, 0]);
  }

  /** Draws the refined picture once more: browsers forget what they have shown. */
  showRefined(): void {
    this.mean.show(this.renderer);
  }

  /** Places and shows all but the hull as a picture wants it; returns its view. */
  private arrange(picture: Picture, width: number, height: number, shift: readonly [number, number]): Eye {
    const eye = this.aim(picture, width, height, shift);
    const { layers, mode } = picture;
    const image = picture.through && !picture.through.inFront ? picture.through.opacity : 0;
    this.ground.group.visible = layers.has("grid");
    this.ground.show(!this.isRoom ? 0 : this.cameras?.hasImageBehind ? 1 - image : 1, this.isRoom);
    this.sky.mesh.position.copy(this.view.position);
    this.bodies.group.visible = layers.has("bodies");
    this.ripples.group.visible = layers.has("bodies");
    this.touches.group.visible = layers.has("touches");
    this.patches.group.visible = layers.has("touches");
    this.cameras?.show(layers.has("cameras"), layers.has("images"), picture.through?.camera.index ?? null);
    if (this.cones) this.cones.group.visible = mode === "cones";
    this.cameras?.lookThrough(picture.through?.camera ?? null, eye.pinhole, height, picture.through?.opacity ?? 0, picture.through?.inFront ?? false);
    if (this.hull) this.hull.fade = picture.isGrey ? 1 : 0;
    return eye;
  }

  /** Draws bodies, room and all, with the hull's picture among them, on the canvas. */
  private drawScene({ layers, mode, level }: Picture): void {
    this.light.draw(this.renderer, this.scene, layers.has("shadows"), mode, level.shadowSize);
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
    this.light.release();
    this.mean.release();
    this.hull?.release();
    this.cameras?.release();
  }

  /** A point of the world as the last picture has it, −1 to 1; null behind the view. */
  toClip(point: readonly [number, number, number]): [number, number] | null {
    const at = new Vector3(...point).applyMatrix4(this.view.matrixWorldInverse);
    if (at.z > -NEAR_M) return null;
    at.applyMatrix4(this.view.projectionMatrix);
    return [at.x, at.y];
  }

  dispose(): void {
    for (const old of [this.cameras, this.cones, this.hull, this.bodies, this.touches, this.patches, this.ripples, this.preview, this.light, this.ground, this.sky]) old?.dispose();
    this.mean.release();
    this.renderer.dispose();
  }

  /** Points the three.js camera, pixels shifted right and down; returns the same view for the hull. */
  private aim(picture: Picture, width: number, height: number, shift: readonly [number, number]): Eye {
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
    pinhole = [pinhole[0], pinhole[1], pinhole[2] + shift[0], pinhole[3] + shift[1]];
    const [fx, fy, cx, cy] = pinhole;
    view.projectionMatrix.makePerspective((-cx / fx) * NEAR_M, ((width - cx) / fx) * NEAR_M, (cy / fy) * NEAR_M, (-(height - cy) / fy) * NEAR_M, NEAR_M, FAR_M);
    view.projectionMatrixInverse.copy(view.projectionMatrix).invert();
    view.updateMatrixWorld(true);
    return (this.seen = eyeOf(view, pinhole));
  }
}
