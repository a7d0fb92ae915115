/** The light of the scene, and the shadows that it casts: of bodies and person, on both and on the floor. */
import {
  BoxGeometry,
  DirectionalLight,
  DoubleSide,
  Group,
  HemisphereLight,
  Mesh,
  MeshBasicMaterial,
  PMREMGenerator,
  Quaternion,
  type RawShaderMaterial,
  type Scene,
  Vector3,
  type WebGLRenderer,
  type WebGLRenderTarget,
} from "three";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";
import type { Hello } from "../feed/text.ts";
import type { HullMode } from "../view/hash.ts";
import { ONLY_BODIES } from "./bodies.ts";
import { BodyShadow } from "./body_shadow.ts";
import type { ContactShadow } from "./contact_shadow.ts";
import * as glsl from "./glsl/index.ts";
import type { HullView } from "./hull.ts";

/** Towards the light, where up is y. */
const TOWARDS = new Vector3(0.42, 0.86, 0.46).normalize();
/** A body this near before a point of the person leaves it lit: the person's surface is not known better, metres. */
const BIAS_M = 0.02;

export class Light {
  readonly group = new Group();
  private readonly sun = new DirectionalLight(0xfff4e6, 2.2);
  private readonly bodies = new BodyShadow();
  private readonly contact: ContactShadow;
  /** Only the light sees it: its shader marches to the hull. */
  private box: Mesh<BoxGeometry, MeshBasicMaterial> | null = null;
  private hull: HullView | null = null;
  private surroundings: WebGLRenderTarget | null = null;
  private isOld = true;
  private bodiesAreOld = true;
  private drawn = { mode: "photo" as HullMode, isWanted: false };

  /** Whether bodies reflect a room around them: by the processor that takes seconds to ready. */
  private readonly reflects: boolean;

  constructor(contact: ContactShadow, reflects: boolean) {
    this.contact = contact;
    this.reflects = reflects;
    this.group.add(new HemisphereLight(0xe6eef8, 0x6b6a66, reflects ? 0.5 : 1.4), this.sun, this.sun.target);
    // Lights that some eyes do not see would make materials for both kinds of eyes.
    for (const light of this.group.children) light.layers.enable(ONLY_BODIES);
    this.sun.castShadow = true;
    this.sun.shadow.bias = -0.0008;
    this.sun.shadow.normalBias = 0.01;
  }

  /** Shines into the volume of a rig; the person is that of this hull. */
  setRig({ volume: { low, high }, up }: Hello, hull: HullView): void {
    const middle = new Vector3(...low).add(new Vector3(...high)).multiplyScalar(0.5);
    const towards = TOWARDS.clone().applyQuaternion(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), new Vector3(...up)));
    const radius = Math.max(1.5, Math.min(6, 0.5 * new Vector3(...high).sub(new Vector3(...low)).length()));
    this.sun.target.position.copy(middle);
    this.sun.position.copy(middle).addScaledVector(towards, radius * 2.5);
    const frustum = this.sun.shadow.camera;
    [frustum.left, frustum.right, frustum.top, frustum.bottom] = [-radius, radius, radius, -radius];
    [frustum.near, frustum.far] = [0.1, radius * 5];
    frustum.updateProjectionMatrix();
    this.sun.target.updateMatrixWorld();
    this.hull = hull;
    hull.light = towards;
    this.makeBox(hull);
    this.invalidate(true);
  }

  /** Something that casts shadows moved: a body, or the person alone. */
  invalidate(isBody: boolean): void {
    this.isOld = true;
    this.bodiesAreOld ||= isBody;
  }

  /** Readies shadows and surroundings for the next picture. */
  draw(renderer: WebGLRenderer, scene: Scene, isWanted: boolean, mode: HullMode, size: number): void {
    if (this.reflects) scene.environment = (this.surroundings ??= this.makeSurroundings(renderer)).texture;
    const { shadow } = this.sun;
    if (shadow.mapSize.x !== size) {
      shadow.mapSize.set(size, size);
      this.forgetMap();
    }
    if (isWanted !== this.drawn.isWanted || mode !== this.drawn.mode) this.invalidate(true);
    this.drawn = { mode, isWanted };
    this.sun.castShadow = isWanted;
    this.contact.plane.visible = isWanted;
    this.placeBox(isWanted && mode !== "off");
    if (isWanted && this.bodiesAreOld) {
      this.bodies.draw(renderer, scene, this.sun, size);
      this.contact.draw(renderer, scene, size / 2);
      this.bodiesAreOld = false;
    }
    if (isWanted && this.isOld) {
      renderer.shadowMap.needsUpdate = true;
      this.isOld = false;
    }
    this.hull?.shade(isWanted ? this.bodies.depth : null, this.bodies.matrix, BIAS_M / (shadow.camera.far - shadow.camera.near));
  }

  /** The card lost everything. */
  release(): void {
    this.forgetMap();
    this.bodies.release();
    this.contact.release();
    this.surroundings?.dispose();
    this.surroundings = null;
  }

  dispose(): void {
    this.release();
    this.removeBox();
  }

  private forgetMap(): void {
    // It is made again with its next use.
    this.sun.shadow.map?.dispose();
    this.sun.shadow.map = null;
    this.invalidate(true);
  }

  private makeSurroundings(renderer: WebGLRenderer): WebGLRenderTarget {
    const generator = new PMREMGenerator(renderer);
    const room = new RoomEnvironment();
    const made = generator.fromScene(room, 0.04);
    generator.dispose();
    room.dispose();
    return made;
  }

  private makeBox(hull: HullView): void {
    this.removeBox();
    const material: RawShaderMaterial = hull.material(glsl.SHADOW_VERTEX, glsl.SHADOW_FRAGMENT, hull.common);
    material.depthTest = true;
    material.depthWrite = true;
    material.side = DoubleSide;
    this.box = new Mesh(new BoxGeometry(1, 1, 1), new MeshBasicMaterial({ colorWrite: false, depthWrite: false }));
    this.box.customDepthMaterial = material;
    this.box.castShadow = true;
    this.box.frustumCulled = false;
    this.group.add(this.box);
  }

  private removeBox(): void {
    if (!this.box) return;
    this.group.remove(this.box);
    this.box.geometry.dispose();
    this.box.material.dispose();
    this.box.customDepthMaterial?.dispose();
    this.box = null;
  }

  private placeBox(isWanted: boolean): void {
    const around = this.hull?.box;
    if (!this.box) return;
    this.box.visible = isWanted && !!around;
    if (!around) return;
    this.box.position.fromArray(around.low.map((l, i) => (l + around.high[i]) / 2));
    this.box.scale.fromArray(around.low.map((l, i) => Math.max(1e-3, around.high[i] - l)));
  }
}
