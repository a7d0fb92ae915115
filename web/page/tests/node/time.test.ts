import assert from "node:assert/strict";
import { test } from "node:test";
import { parseMessage, type WorldMessage } from "../../src/feed/message.ts";
import { between, posesKey } from "../../src/time/bodies.ts";
import { Playout } from "../../src/time/playout.ts";
import { MAX_BYTES, SPAN_MS, Timeline } from "../../src/time/timeline.ts";
import { Worlds } from "../../src/time/worlds.ts";
import { worldMessage } from "../feeder/write.ts";

/** A world of 120 steps a second and 30 frames, whose only body moves a metre a second along x. */
function world(step: number, generation = 1, frame: number | null = Math.floor(step / 4)): WorldMessage {
  return parseMessage(worldMessage(step, generation, step, step / 120, frame, false, [{ id: 1, position: [step / 120, 0, 0] }])) as WorldMessage;
}

const x = (bodies: readonly { position: readonly number[] }[]) => bodies[0].position[0];
const near = (found: number, expected: number) => assert.ok(Math.abs(found - expected) < 1e-6, `${found}, expected ${expected}`);

test("bodies between two worlds lie between them", () => {
  near(x(between(world(120), world(122), 121 / 120)), 121 / 120);
  near(x(between(world(120), world(122), 9)), 122 / 120);
  near(x(between(world(120), world(122), 0)), 1);
});

test("nothing is blended from one world's life into another's", () => {
  near(x(between(world(120, 1), world(2, 2), 0.01)), 2 / 120);
});

test("rotations turn the short way", () => {
  const turned = (w: number, z: number): WorldMessage => {
    const made = world(w > 0 ? 1 : 2);
    return { ...made, bodies: [{ ...made.bodies[0], rotation: [0, 0, z, w] }] };
  };
  const [, , z, w] = between(turned(1, 0), turned(-Math.SQRT1_2, -Math.SQRT1_2), 1.5 / 120)[0].rotation;
  near(Math.abs(2 * Math.atan2(z, w)), Math.PI / 4);
});

test("a picture is drawn again when the surface at a body moves, though the body does not", () => {
  const key = (speed: number) => {
    const made = world(1);
    return posesKey({ world: { ...made, patches: Float32Array.of(0, 4, 0, 0, 0, 0, 1, 0, speed, 0, 0, 0, 0.1) }, bodies: made.bodies });
  };
  assert.equal(key(0.1), key(0.10001));
  assert.notEqual(key(0.1), key(0.2));
  assert.notEqual(key(0), posesKey({ world: world(1), bodies: world(1).bodies }));
});

test("where patches are not drawn, a picture is drawn again when a body begins to be touched, not when the surface moves", () => {
  const key = (patches: readonly number[]) => posesKey({ world: { ...world(1), patches: Float32Array.from(patches) }, bodies: world(1).bodies }, false);
  const patch = (speed: number) => [0, 4, 0, 0, 0, 0, 1, 0, speed, 0, 0, 0, 0.1];
  assert.equal(key(patch(0.1)), key([...patch(0.2), ...patch(0.3)]));
  assert.notEqual(key(patch(0.1)), key([]));
});

test("the bodies of a frame are those of the step that first saw it, and go on from there", () => {
  const worlds = new Worlds();
  for (let step = 0; step <= 60; step += 2) worlds.add(world(step));
  near(x(worlds.atFrame(10, 0)!.bodies), 40 / 120);
  near(x(worlds.atFrame(10, 1 / 120)!.bodies), 41 / 120);
  near(x(worlds.atFrame(10, 1)!.bodies), 60 / 120);
});

test("a frame that no step has seen yet has no bodies", () => {
  const worlds = new Worlds();
  for (let step = 0; step <= 8; step += 2) worlds.add(world(step));
  assert.equal(worlds.atFrame(3, 0), null);
});

test("a frame that every step passed over has the bodies of the next one", () => {
  const worlds = new Worlds();
  for (const [step, frame] of [[0, 0], [8, 2], [12, 3]]) worlds.add(world(step, 1, frame));
  near(x(worlds.atFrame(1, 0)!.bodies), 8 / 120);
});

test("steps without a hull do not hide those with one", () => {
  const worlds = new Worlds();
  for (const [step, frame] of [[0, 0], [4, 1], [8, null], [12, 3]] as const) worlds.add(world(step, 1, frame));
  near(x(worlds.atFrame(1, 0)!.bodies), 4 / 120);
});

test("worlds are kept for a while, not for ever", () => {
  const worlds = new Worlds();
  for (let step = 0; step < 5000; step++) worlds.add(world(step));
  assert.ok(worlds.length <= 720);
  assert.equal(worlds.newest()!.step, 4999);
});

test("worlds are read once each, in order, up to the one that is shown", () => {
  const worlds = new Worlds();
  const all = [0, 2, 4, 6].map((step) => world(step));
  for (const each of all) worlds.add(each);
  assert.deepEqual(worlds.after(null, all[1]), all.slice(0, 2));
  assert.deepEqual(worlds.after(all[1], all[3]), all.slice(2));
  assert.deepEqual(worlds.after(all[3], all[3]), []);
  assert.deepEqual(worlds.after(all[3], all[1]), []);
  assert.deepEqual(worlds.after(all[1], world(8)), []);
});

const kept = (atMs: number, bytes = 8) => ({ atMs, frame: Math.floor(atMs / 33), message: new ArrayBuffer(bytes) });

test("the timeline forgets what is older than its span, and what is too much", () => {
  const timeline = new Timeline();
  for (let at = 0; at <= 15_000; at += 100) timeline.add(kept(at));
  assert.deepEqual(timeline.span(), [15_000 - SPAN_MS, 15_000]);
  for (let at = 15_001; at < 15_010; at++) timeline.add(kept(at, MAX_BYTES / 4));
  assert.ok(timeline.byteLength <= MAX_BYTES);
});

test("a moment shows the set that was on then", () => {
  const timeline = new Timeline();
  for (const at of [100, 200, 300]) timeline.add(kept(at));
  assert.deepEqual([0, 150, 200, 299, 900].map((ms) => timeline.at(ms)!.atMs), [100, 100, 200, 200, 300]);
  assert.equal(timeline.beside(200, 1)!.atMs, 300);
  assert.equal(timeline.beside(100, -1)!.atMs, 100);
});

test("looking back stands, plays on as it came, and ends live", () => {
  const timeline = new Timeline();
  for (let at = 0; at <= 1000; at += 100) timeline.add(kept(at));
  const playout = new Playout(timeline);
  assert.equal(playout.step(5000), null);
  assert.equal(playout.behindMs, null);
  playout.seek(400);
  assert.equal(playout.behindMs, 600);
  assert.equal(playout.step(5000)!.atMs, 400);
  assert.equal(playout.step(6000)!.atMs, 400);
  playout.play(true);
  assert.equal(playout.step(6100)!.atMs, 400);
  assert.equal(playout.step(6320)!.atMs, 600);
  assert.equal(playout.step(9000), null);
  assert.ok(playout.live);
});

test("what is looked at stays though it is forgotten, and goes on from the oldest", () => {
  const timeline = new Timeline();
  for (const at of [0, 100, 200]) timeline.add(kept(at));
  const playout = new Playout(timeline);
  playout.seek(100);
  assert.equal(playout.step(1)!.atMs, 100);
  assert.equal(playout.isForgotten, false);
  for (let at = SPAN_MS; at <= 2 * SPAN_MS; at += 100) timeline.add(kept(at));
  assert.equal(playout.step(20_000)!.atMs, 100);
  assert.ok(playout.isForgotten && !playout.live);
  assert.equal(playout.behindMs, 2 * SPAN_MS - 100);
  playout.play(true);
  assert.equal(playout.step(20_001)!.atMs, SPAN_MS);
  assert.equal(playout.isForgotten, false);
});
