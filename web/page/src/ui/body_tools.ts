/** Bodies under the pointer: picking, carrying, throwing, placing new ones. */
import { Box3, Plane, Raycaster, Vector2, Vector3, type Mesh } from "three";
import type { App } from "../app/app.ts";
import { radiusOf } from "../draw/bodies.ts";
import type { Shape } from "../feed/text.ts";
import type { Vec3 } from "../view/lens.ts";
import { byId, setText, toast } from "./dom.ts";
import { takeAway } from "./take_away.ts";

/** Thrown bodies are no faster, m/s. */
const MAX_THROW_M_S = 9;
/** The throw is the mean movement of so long before letting go, milliseconds. */
const THROW_MS = 90;
/** About that of light wood: bodies that a person can shove. */
const DENSITY_KG_M3 = 120;
/** New bodies go no farther out than this beside the volume in which the cameras see a person, metres. */
const MAX_OUTSIDE_M = 1;
const TOO_FAR = "Too far away: the new body goes nearer to the person.";
const PLACE_HINT = "Click where the new body goes. Esc ends it.";
const PALETTE: readonly Vec3[] = [
  [0.85, 0.47, 0.24],
  [0.24, 0.55, 0.8],
  [0.4, 0.68, 0.38],
  [0.8, 0.68, 0.27],
  [0.6, 0.45, 0.78],
  [0.8, 0.42, 0.55],
];

export type ShapeKind = "box" | "ball" | "capsule" | "cylinder" | "cone";

/** A shape of about so many metres. */
export function shapeOf(kind: ShapeKind, sizeM: number): Shape {
  const radius = sizeM / 2;
  switch (kind) {
    case "box":
      return { box: { size: [sizeM, sizeM, sizeM] } };
    case "ball":
      return { ball: { radius } };
    case "capsule":
      return { capsule: { radius: radius * 0.55, length: sizeM } };
    case "cylinder":
      return { cylinder: { radius: radius * 0.8, height: sizeM } };
    case "cone":
      return { cone: { radius: radius * 0.9, height: sizeM } };
  }
}

/** What is under the pointer. */
export interface Hit {
  readonly point: Vector3;
  readonly normal: Vector3;
  readonly body: number | null;
  readonly what: "body" | "person" | "floor";
}

interface HeldBody {
  readonly body: number;
  readonly grip: Vec3;
  readonly plane: Plane;
  target: Vector3;
  readonly path: { at: number; point: Vector3 }[];
  sentAt: number;
  /** Whether an answer is waited for. */
  isAsking: boolean;
  /** Whether the run has answered that this page holds it. */
  isHeld: boolean;
}

/** Where a new body would be. */
interface Spot {
  readonly at: Vector3;
  readonly shape: Shape;
  readonly isTooFar: boolean;
}

export class BodyTools {
  private readonly app: App;
  private readonly raycaster = new Raycaster();
  private held: HeldBody | null = null;
  private spawned = 0;
  /** The body that buttons act on. */
  chosen: number | null = null;
  private isPlacing = false;
  kind: ShapeKind = "box";
  sizeM = 0.25;

  constructor(app: App) {
    this.app = app;
  }

  get carrying(): boolean {
    return this.held !== null;
  }

  /** Whether a click puts a new body there. */
  get placing(): boolean {
    return this.isPlacing;
  }

  set placing(placing: boolean) {
    this.isPlacing = placing;
    this.endPreview();
  }

  /** What lies under a point of the canvas, in CSS pixels from its corner. */
  hit(x: number, y: number, floor = true): Hit | null {
    const { stage } = this.app;
    if (!stage || !this.aim(x, y)) return null;
    const hits: (Hit & { distance: number })[] = [];
    if (this.app.layers.has("bodies")) {
      const body = this.raycaster.intersectObjects(stage.bodies.meshes().filter((mesh) => mesh.visible), false)[0];
      if (body) {
        const normal = body.face ? body.face.normal.clone().transformDirection(body.object.matrixWorld) : this.raycaster.ray.direction.clone().negate();
        hits.push({ point: body.point, normal, body: (body.object as Mesh).userData.body as number, what: "body", distance: body.distance });
      }
    }
    const person = this.personHit(x, y);
    if (person) hits.push(person);
    const ground = floor ? this.floorHit() : null;
    if (ground) hits.push(ground);
    hits.sort((a, b) => a.distance - b.distance);
    return hits[0] ?? null;
  }

  /** The body under a point, without minding what hides it: cheap enough for every movement. */
  bodyAt(x: number, y: number): number | null {
    const { stage } = this.app;
    if (!stage || !this.app.layers.has("bodies") || !this.aim(x, y)) return null;
    const body = this.raycaster.intersectObjects(stage.bodies.meshes().filter((mesh) => mesh.visible), false)[0];
    return body ? ((body.object as Mesh).userData.body as number) : null;
  }

  /** The camera whose image plane is under a point, if nothing is before it. */
  cameraAt(x: number, y: number): number | null {
    const { stage } = this.app;
    if (!stage?.cameras || !this.aim(x, y)) return null;
    const plane = this.raycaster.intersectObjects(stage.cameras.planes(), false)[0];
    return plane ? (plane.object.userData.camera as number) : null;
  }

  /** Takes hold of a body; false if it cannot be carried. */
  grab(hit: Hit): boolean {
    const { app } = this;
    const mesh = hit.body === null ? null : app.stage?.bodies.mesh(hit.body);
    if (!mesh || hit.body === null || !app.steers || app.stage!.bodies.text(hit.body)?.fixed || !app.frames.playout.live) return false;
    const grip = mesh.worldToLocal(hit.point.clone());
    const facing = app.stage!.view.getWorldDirection(new Vector3());
    this.held = {
      body: hit.body,
      grip: [grip.x, grip.y, grip.z],
      plane: new Plane().setFromNormalAndCoplanarPoint(facing, hit.point),
      target: hit.point.clone(),
      path: [{ at: performance.now(), point: hit.point.clone() }],
      sentAt: 0,
      isAsking: false,
      isHeld: false,
    };
    this.send();
    return true;
  }

  /** Carries on to a point of the canvas. */
  carry(x: number, y: number): void {
    if (!this.held || !this.aim(x, y)) return;
    const point = this.raycaster.ray.intersectPlane(this.held.plane, new Vector3());
    if (!point) return;
    this.move(point);
  }

  /** Draws what is carried nearer or pushes it away. */
  reach(factor: number): void {
    if (!this.held) return;
    const eye = this.app.stage!.view.position;
    const point = this.held.target.clone().sub(eye).multiplyScalar(factor).add(eye);
    this.held.plane.setFromNormalAndCoplanarPoint(this.held.plane.normal, point);
    this.move(point);
  }

  /** Lets go; in motion, throws. */
  async release(): Promise<void> {
    const held = this.held;
    if (!held) return;
    this.held = null;
    this.app.stage!.bodies.release();
    const now = performance.now();
    const recent = held.path.filter(({ at }) => now - at <= THROW_MS);
    const velocity = new Vector3();
    if (recent.length >= 2) {
      const [first, last] = [recent[0], recent[recent.length - 1]];
      const seconds = Math.max(0.016, (last.at - first.at) / 1000);
      velocity.copy(last.point).sub(first.point).divideScalar(seconds).clampLength(0, MAX_THROW_M_S);
    }
    const thrown = velocity.length() > 0.15;
    this.tell(await this.app.command("release", { body: held.body, ...(thrown ? { velocity: velocity.toArray() } : {}) }));
  }

  /** A new body where the pointer is. */
  async place(x: number, y: number): Promise<void> {
    const spot = this.spot(x, y);
    if (!spot) return toast("Nothing there to put it on.");
    if (spot.isTooFar) return toast(TOO_FAR);
    await this.spawn(spot.at, spot.shape);
  }

  /** Shows where a new body would be. */
  preview(x: number, y: number): void {
    const spot = this.spot(x, y);
    setText(byId("hint"), spot?.isTooFar ? TOO_FAR : PLACE_HINT);
    if (spot && !spot.isTooFar) this.app.stage!.preview.show(spot.shape, spot.at, this.nextColor);
    else this.app.stage?.preview.hide();
    this.app.invalidate();
  }

  endPreview(): void {
    setText(byId("hint"), PLACE_HINT);
    if (!this.app.stage?.preview.place) return;
    this.app.stage.preview.hide();
    this.app.invalidate();
  }

  private spot(x: number, y: number): Spot | null {
    const hit = this.hit(x, y);
    if (!hit) return null;
    const shape = shapeOf(this.kind, this.sizeM);
    // On the floor it stands; on other things it is let go of just off their surface.
    const lift = hit.what === "floor" ? this.halfHeight(shape) + 0.005 : radiusOf(shape) + 0.02;
    const at = hit.point.clone().addScaledVector(hit.normal, lift);
    return { at, shape, isTooFar: this.outsideM(at) > MAX_OUTSIDE_M };
  }

  /** How far a point is beside the volume in which there can be a person, metres. */
  private outsideM(point: Vector3): number {
    const { low, high } = this.app.hello!.volume;
    const box = new Box3(new Vector3(...low), new Vector3(...high));
    const way = box.clampPoint(point, new Vector3()).sub(point);
    const up = new Vector3(...this.app.hello!.up);
    return way.addScaledVector(up, -way.dot(up)).length();
  }

  /** A new body above the middle of what is looked at. */
  async drop(): Promise<void> {
    const { hello } = this.app;
    if (!hello) return;
    const { low, high } = hello.volume;
    const box = this.app.stage?.hull?.box;
    const up = new Vector3(...hello.up);
    const middle = new Vector3(...(box?.low ?? low)).add(new Vector3(...(box?.high ?? high))).multiplyScalar(0.5);
    const top = Math.max(new Vector3(...(box?.high ?? high)).dot(up), new Vector3(...(box?.low ?? low)).dot(up));
    const shape = shapeOf(this.kind, this.sizeM);
    await this.spawn(middle.addScaledVector(up, top - middle.dot(up) + this.sizeM + 0.1), shape);
  }

  async push(): Promise<void> {
    if (this.chosen === null || !this.app.stage) return;
    const facing = this.app.stage.view.getWorldDirection(new Vector3());
    const up = new Vector3(...(this.app.hello?.up ?? [0, 1, 0]));
    const impulse = facing.addScaledVector(up, -facing.dot(up)).normalize().addScaledVector(up, 0.4).multiplyScalar(1.5);
    this.tell(await this.app.command("push", { body: this.chosen, impulse: impulse.toArray() }));
  }

  async remove(): Promise<void> {
    if (this.chosen === null) return;
    const body = this.chosen;
    const name = this.app.stage?.bodies.text(body)?.name ?? "The body";
    this.chosen = null;
    await takeAway(this.app, "remove", { body }, `${name} was removed.`);
    this.app.changed();
  }

  private get nextColor(): Vec3 {
    return PALETTE[this.spawned % PALETTE.length];
  }

  private async spawn(at: Vector3, shape: Shape): Promise<void> {
    const color = this.nextColor;
    this.spawned++;
    const answer = await this.app.command("spawn", { shape, color, position: at.toArray(), density: DENSITY_KG_M3 });
    this.tell(answer);
    if ("body" in answer && answer.body !== undefined) {
      this.chosen = answer.body;
      this.app.changed();
    }
  }

  private move(point: Vector3): void {
    const held = this.held!;
    const up = new Vector3(...(this.app.hello?.up ?? [0, 1, 0]));
    const floor = this.floor();
    if (floor !== null) point.addScaledVector(up, Math.max(0, floor + 0.02 - point.dot(up)));
    held.target = point;
    held.path.push({ at: performance.now(), point: point.clone() });
    if (held.path.length > 64) held.path.shift();
    this.send();
  }

  /** Says where to; not oftener than pictures are drawn. */
  private send(): void {
    const held = this.held!;
    const now = performance.now();
    if (now - held.sentAt < 14) return;
    held.sentAt = now;
    // One at a time: a run that stands still for a moment is not sent a hundred places.
    if (held.isAsking) return;
    held.isAsking = true;
    const sent = held.target;
    void this.app.command("grab", { body: held.body, grip: held.grip, target: sent.toArray() }).then((answer) => {
      held.isAsking = false;
      if ("refused" in answer) return this.lose(held, answer.refused);
      held.isHeld = true;
      if (this.held === held || this.held === null) this.app.stage!.bodies.hold(held.body);
      // It was released meanwhile.
      if (this.held === null) this.app.stage!.bodies.release();
      if (this.held === held && !held.target.equals(sent)) this.send();
    });
  }

  /** A body cannot be held, or not any more. */
  private lose(held: HeldBody, why: string): void {
    if (this.held !== held) return;
    this.held = null;
    this.app.stage!.bodies.release();
    toast(why);
    if (held.isHeld) void this.app.command("release", { body: held.body });
  }

  /** Height of the scene's floor, or of the run's where the scene says nothing; metres along up. */
  private floor(): number | null {
    const { scene, hello } = this.app;
    return (scene?.floor_m === undefined ? hello?.floor_m : scene.floor_m) ?? null;
  }

  private tell(answer: { refused?: string } | object): void {
    if ("refused" in answer && answer.refused) toast(answer.refused);
  }

  private halfHeight(shape: Shape): number {
    if ("box" in shape) return shape.box.size[1] / 2;
    if ("ball" in shape) return shape.ball.radius;
    if ("capsule" in shape) return shape.capsule.length / 2 + shape.capsule.radius;
    if ("cylinder" in shape) return shape.cylinder.height / 2;
    return radiusOf(shape);
  }

  private aim(x: number, y: number): boolean {
    const { stage } = this.app;
    if (!stage) return false;
    const { clientWidth, clientHeight } = stage.renderer.domElement;
    if (clientWidth === 0 || clientHeight === 0) return false;
    this.raycaster.setFromCamera(new Vector2((x / clientWidth) * 2 - 1, 1 - (y / clientHeight) * 2), stage.view);
    return true;
  }

  private personHit(x: number, y: number): (Hit & { distance: number }) | null {
    const stage = this.app.stage!;
    if (this.app.mode === "off") return null;
    const { clientWidth, clientHeight } = stage.renderer.domElement;
    const depth = stage.hullDepthAt(x / clientWidth, y / clientHeight);
    if (depth === null) return null;
    const point = new Vector3((x / clientWidth) * 2 - 1, 1 - (y / clientHeight) * 2, depth * 2 - 1).applyMatrix4(stage.view.projectionMatrixInverse).applyMatrix4(stage.view.matrixWorld);
    const normal = this.raycaster.ray.direction.clone().negate();
    return { point, normal, body: null, what: "person", distance: point.distanceTo(this.raycaster.ray.origin) };
  }

  private floorHit(): (Hit & { distance: number }) | null {
    const { hello } = this.app;
    if (!hello) return null;
    const normal = new Vector3(...hello.up);
    const height = this.floor() ?? Math.min(new Vector3(...hello.volume.low).dot(normal), new Vector3(...hello.volume.high).dot(normal));
    const point = this.raycaster.ray.intersectPlane(new Plane(normal, -height), new Vector3());
    if (!point || point.distanceTo(this.raycaster.ray.origin) > 30) return null;
    return { point, normal, body: null, what: "floor", distance: point.distanceTo(this.raycaster.ray.origin) };
  }
}
