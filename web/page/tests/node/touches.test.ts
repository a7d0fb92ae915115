/** Which touches are new, the rings that show them, and the rims of touched bodies. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { Group, type InstancedBufferAttribute, type InstancedBufferGeometry, Mesh, type MeshStandardMaterial } from "three";
import { Bodies } from "../../src/draw/bodies.ts";
import { LIFE_MS, MAX_RIPPLES, Ripples } from "../../src/draw/ripples.ts";
import { type BodyPose, parseMessage, type WorldMessage } from "../../src/feed/message.ts";
import { NewTouches, touchesOf } from "../../src/time/touches.ts";
import { type Placed, worldMessage } from "../feeder/write.ts";

const HZ = 60;
const patch = (place: number, ...point: number[]) => [place, 4, ...point, 0, 1, 0, 0, 0, 0, 0.001, 0.03];
const sample = (place: number, ...numbers: number[]) => [place, ...numbers];

function world(at: number, patches: readonly number[][] = [], body: Partial<Placed> = {}, samples: readonly number[][] = [], generation = 1): WorldMessage {
  return parseMessage(worldMessage(at, generation, 2 * at, at / HZ, 0, false, [{ id: 7, position: [0, 1, 0], ...body }, { id: 9, position: [1, 1, 0] }], samples, patches)) as WorldMessage;
}

/** Shows worlds sixty a second; at which of them touches are new. */
function newAt(count: number, worldOf: (at: number) => WorldMessage): number[] {
  const touches = new NewTouches();
  return Array.from({ length: count }, (_, at) => at).flatMap((at) => touches.add(worldOf(at)).map(() => at));
}

test("a touch is new once, while the body stays touched", () => {
  assert.deepEqual(newAt(120, (at) => world(at, at >= 40 ? [patch(0, 0, 1.1, 0)] : [])), [40]);
});

test("a touch that flickers is new once; after 0.3 s without any it is new again", () => {
  assert.deepEqual(newAt(120, (at) => world(at, at >= 40 && at % 12 === 0 ? [patch(0, 0, 1.1, 0)] : [])), [48]);
  assert.deepEqual(newAt(120, (at) => world(at, at === 40 || at >= 60 ? [patch(0, 0, 1.1, 0)] : [])), [40, 60]);
});

test("a second touch is new where it is over 10 cm from the others", () => {
  const second = (x: number) => newAt(120, (at) => world(at, at < 40 ? [] : at < 80 ? [patch(0, 0, 1.1, 0)] : [patch(0, 0, 1.1, 0), patch(0, x, 1.1, 0)]));
  assert.deepEqual(second(0.09), [40]);
  assert.deepEqual(second(0.11), [40, 80]);
  // Two hands at once; and two bodies.
  assert.deepEqual(newAt(60, (at) => world(at, at < 40 ? [] : [patch(0, 0.2, 1, 0), patch(0, -0.2, 1, 0), patch(0, -0.2, 1.01, 0), patch(1, 1, 1, 0)])), [40, 40, 40]);
});

test("a body carried fast takes its touch along, and one that rolls leaves it where it is", () => {
  const carried = (at: number) => world(at, at < 40 ? [] : [patch(0, at / 4 + 0.1, 1, 0)], { position: [at / 4, 1, 0] });
  assert.deepEqual(newAt(80, carried), [40]);
  const turned = (at: number): WorldMessage => {
    const made = world(at, at < 40 ? [] : [patch(0, 0.3, 1, 0)]);
    const half = at / 8;
    return { ...made, bodies: made.bodies.map((body) => ({ ...body, rotation: [0, Math.sin(half), 0, Math.cos(half)] })) };
  };
  assert.deepEqual(newAt(80, turned), [40]);
  // The touch turns with the body: far away in the world, and in the body's frame where it was.
  const turning = (at: number): WorldMessage => {
    const angle = at / 4;
    const made = world(at, at < 40 ? [] : [patch(0, 0.3 * Math.cos(angle), 1, -0.3 * Math.sin(angle))]);
    return { ...made, bodies: made.bodies.map((body) => ({ ...body, rotation: [0, Math.sin(angle / 2), 0, Math.cos(angle / 2)] })) };
  };
  assert.deepEqual(newAt(80, turning), [40]);
});

test("nothing is new before the worlds of 0.3 s are known: at first, after a gap, in another world", () => {
  assert.deepEqual(newAt(60, (at) => world(at, [patch(0, 0, 1.1, 0)])), []);
  assert.deepEqual(newAt(60, (at) => world(at < 40 ? at : at + 30, at < 40 ? [] : [patch(0, 0, 1.1, 0)])), []);
  assert.deepEqual(newAt(60, (at) => world(at, at < 40 ? [] : [patch(0, 0, 1.1, 0)], {}, [], at < 40 ? 1 : 2)), []);
  assert.deepEqual(newAt(80, (at) => world(at, at < 70 ? [] : [patch(0, 0, 1.1, 0)], {}, [], at < 40 ? 1 : 2)), [70]);
});

test("steps without a hull end no touch", () => {
  assert.deepEqual(newAt(100, (at) => (at > 60 && at < 76 ? { ...world(at), blind: true } : world(at, at < 40 ? [] : [patch(0, 0, 1.1, 0)]))), [40]);
});

test("a body that is touched without a patch has its samples, or the way that it was moved", () => {
  const touching = world(0, [], { touching: true });
  assert.deepEqual(touchesOf(touching), [{ place: 0, point: null, normal: null }]);
  const moved = { ...touching, bodies: touching.bodies.map((body, place) => (place === 0 ? { ...body, response: [0, 0.02, 0] as const } : body)) };
  assert.deepEqual(touchesOf(moved), [{ place: 0, point: null, normal: [0, 1, 0] }]);
  const samples = [sample(0, 0, 1, 0, 0, 0.5, 0), sample(0, 0.0625, 1, 0, 0, 0.5, 0), sample(0, 0.5, 1, 0, 0, 0, 0)];
  assert.deepEqual(touchesOf(world(0, [], { touching: true }, samples)), [{ place: 0, point: [0.03125, 1, 0], normal: [0, 1, 0] }, { place: 0, point: [0.5, 1, 0], normal: null }]);
  assert.deepEqual(touchesOf(world(0, [], {}, samples)), [], "a body that is not marked");
  assert.deepEqual(newAt(120, (at) => world(at, [], { touching: at >= 40 && at % 3 > 0 })), [40]);
});

function rings(ripples: Ripples): { geometry: InstancedBufferGeometry; at: (index: number) => number[] } {
  const { geometry } = (ripples.group as Group).children[0] as Mesh<InstancedBufferGeometry>;
  const places = geometry.getAttribute("aRing") as InstancedBufferAttribute;
  return { geometry, at: (index) => [places.getX(index), places.getY(index), places.getZ(index), places.getW(index)] };
}

test("a ring grows old in 0.6 s, and the picture changes until it is gone", () => {
  const ripples = new Ripples();
  const { at } = rings(ripples);
  assert.equal(ripples.advance(900), false);
  ripples.add([1, 2, 3], [0, 1, 0], 1000);
  assert.equal(ripples.advance(1000), true);
  assert.deepEqual([ripples.count, ...at(0)], [1, 1, 2, 3, 0]);
  assert.equal(ripples.advance(1000 + LIFE_MS / 2), true);
  assert.deepEqual(at(0), [1, 2, 3, 0.5]);
  assert.equal(ripples.advance(1000 + LIFE_MS), true, "the picture without it");
  assert.deepEqual([ripples.count, LIFE_MS], [0, 600]);
  assert.equal(ripples.advance(1016 + LIFE_MS), false);
});

test("of too many rings the oldest gives way", () => {
  const ripples = new Ripples();
  const { at } = rings(ripples);
  for (let x = 0; x < MAX_RIPPLES + 3; x++) ripples.add([x, 0, 0], null, x);
  ripples.advance(MAX_RIPPLES + 3);
  assert.deepEqual([ripples.count, at(0)[0], at(MAX_RIPPLES - 1)[0]], [MAX_RIPPLES, 3, MAX_RIPPLES + 2]);
});

const BOX = { id: 7, name: "box", color: [0.5, 0.5, 0.5] as const, fixed: false, shape: { box: { size: [0.2, 0.4, 0.6] as const } } };
const pose = (more: Partial<BodyPose> = {}): BodyPose => ({ id: 7, touching: false, grabbed: false, asleep: false, insideSamples: 0, position: [1, 2, 3], rotation: [0, 0, 0, 1], response: [0, 0, 0], ...more });
const NO_PATCH = new Float32Array(0);

/** Bodies of one box, and the colour of its rim on the card. */
function boxed(): { bodies: Bodies; rim: () => number[] } {
  const bodies = new Bodies();
  bodies.describe([BOX]);
  const shader = { uniforms: {} as Record<string, any>, vertexShader: "", fragmentShader: "void main() {\n#include <emissivemap_fragment>\n}" };
  (bodies.mesh(7)!.material as MeshStandardMaterial).onBeforeCompile(shader as never, null as never);
  assert.match(shader.fragmentShader, /uniform vec3 uRim;\nvoid main[^]*totalEmissiveRadiance \+= uRim/);
  return { bodies, rim: () => shader.uniforms.uRim.value.toArray() };
}

test("the rim of a body comes with a touch, goes after it, and is nothing without one", () => {
  const { bodies, rim } = boxed();
  const at = (ms: number, poses: readonly BodyPose[], patches = NO_PATCH) => {
    bodies.place(poses, patches);
    return bodies.advance(ms);
  };
  assert.deepEqual([at(1000, [pose()]), rim()], [false, [0, 0, 0]]);
  assert.equal(at(1050, [pose({ touching: true })]), true);
  const half = rim();
  assert.ok(half[0] > half[1] && half[1] > half[2] && half[2] > 0, `${half}, expected amber`);
  assert.equal(at(1200, [pose()], Float32Array.from(patch(0, 1, 2, 3))), true, "a patch is a touch");
  assert.equal(at(1250, [pose({ touching: true })]), false, "as it was");
  assert.ok(Math.abs(rim()[0] - 2 * half[0]) < 1e-6);
  assert.equal(at(1450, [pose()]), true);
  assert.ok(rim()[0] > 0);
  assert.deepEqual([at(1700, [pose()]), rim()], [true, [0, 0, 0]]);
  assert.equal(at(1800, [pose()]), false);
  at(2000, [pose({ grabbed: true })]);
  const [red, , blue] = rim();
  assert.ok(blue > red, "held elsewhere");
  bodies.hold(7);
  at(2100, [pose({ grabbed: true })]);
  assert.ok(rim()[0] === rim()[2] && rim()[0] > 0, "held by this page");
});

test("what sleeps on a still surface has no rim", () => {
  const { bodies, rim } = boxed();
  for (const ms of [1000, 1200]) {
    bodies.place([pose({ asleep: true })], Float32Array.from(patch(0, 1, 2, 3)));
    bodies.advance(ms);
  }
  assert.deepEqual(rim(), [0, 0, 0]);
});

test("a ray from the middle of a body leaves it at its surface", () => {
  const { bodies } = boxed();
  const near = (found: readonly number[] | null, expected: readonly number[]) => assert.ok(found && Math.hypot(...found.map((n, i) => n - expected[i])) < 1e-6, `${found}, expected ${expected}`);
  near(bodies.surfaceTowards(pose(), [0, 5, 0]), [1, 2.2, 3]);
  near(bodies.surfaceTowards(pose({ rotation: [0, Math.SQRT1_2, 0, Math.SQRT1_2] }), [1, 0, 0]), [1.3, 2, 3]);
  assert.equal(bodies.surfaceTowards(pose(), [0, 0, 0]), null);
  assert.equal(bodies.surfaceTowards(pose({ id: 8 }), [0, 1, 0]), null);
});
