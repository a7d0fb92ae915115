import assert from "node:assert/strict";
import { test } from "node:test";
import { LEVELS, Quality } from "../../src/draw/quality.ts";
import { backoffMs } from "../../src/feed/backoff.ts";
import { Credit } from "../../src/feed/credit.ts";
import { type Hello, parseText } from "../../src/feed/text.ts";
import { readHash, writeHash } from "../../src/view/hash.ts";
import { MAX_DISTANCE_M, Orbit } from "../../src/view/orbit.ts";

test("what is shown is acknowledged, with what it replaced", () => {
  const said: number[] = [];
  const credit = new Credit((seq) => said.push(seq));
  for (const seq of [4, 5, 6]) credit.received(seq);
  credit.shown(5);
  assert.deepEqual(said, [4, 5]);
  credit.dropped(6);
  credit.shown(6);
  assert.deepEqual(said, [4, 5, 6]);
  assert.equal(credit.outstanding, 0);
});

test("a slow page has one set on its way at a time, and owes nothing once it is quick", () => {
  const said: number[] = [];
  const credit = new Credit((seq) => said.push(seq));
  credit.slow = true;
  for (const seq of [1, 2]) credit.received(seq);
  credit.shown(1);
  assert.deepEqual(said, []);
  credit.shown(2);
  assert.deepEqual(said, [1]);
  credit.received(3);
  credit.shown(3);
  assert.deepEqual([said, credit.outstanding], [[1, 2], 1]);
  credit.slow = false;
  assert.deepEqual([said, credit.outstanding], [[1, 2, 3], 0]);
});

test("what hangs is given back, once", () => {
  const said: number[] = [];
  const credit = new Credit((seq) => said.push(seq));
  credit.slow = true;
  for (const seq of [1, 2]) credit.received(seq);
  credit.shown(1);
  credit.giveBack();
  credit.shown(2);
  assert.deepEqual([said, credit.outstanding], [[1, 2], 0]);
});

test("waits double to eight seconds, and differ between pages", () => {
  const middle = [0, 1, 2, 3, 4, 50].map((attempt) => backoffMs(attempt, () => 0.5));
  assert.deepEqual(middle, [500, 1000, 2000, 4000, 8000, 8000]);
  assert.deepEqual([backoffMs(0, () => 0), backoffMs(0, () => 1)], [375, 625]);
});

test("a view comes back from its address", () => {
  const view = { eye: [1.5, 2, -3] as const, target: [0, 1, 0.25] as const, mode: "shaded" as const, layers: new Set(["grid", "touches"] as const), camera: "cam 1&2", follow: "box/3" };
  const read = readHash(`#${writeHash(view)}`);
  assert.deepEqual(read, { ...view, layers: new Set(["touches", "grid"]) });
});

test("an address that makes no sense changes nothing", () => {
  assert.deepEqual(readHash("#eye=1,2&at=0,0,0&fov=900&mode=loud"), {});
  assert.deepEqual(readHash("#eye=0,0,0&at=0,0,0"), {});
  assert.deepEqual(readHash("#eye=1,,2&at=NaN,1,1"), {});
});

const hello = {
  op: "hello",
  version: 1,
  fps: 30,
  cameras: [{ name: "a", width: 4, height: 3, matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], distortions: [0, 0, 0, 0, 0], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation: [0, 0, 0], max_radius: null }],
  volume: { low: [0, 0, 0], high: [1, 1, 1] },
};

test("a hello is read, with what it may leave out", () => {
  const read = parseText(JSON.stringify(hello)) as Hello;
  assert.equal(read.controller, false);
  assert.deepEqual(read.rule, { min_views: 2, out_of_view: "outside" });
  assert.deepEqual(read.up, [0, 1, 0]);
  assert.equal(read.floor_m, null);
  assert.equal(read.insecure, null);
  const open = parseText(JSON.stringify({ ...hello, insecure: "--insecure: so" })) as Hello;
  assert.equal(open.insecure, "--insecure: so");
});

test("a hello that cannot be drawn is refused by what is wrong with it", () => {
  const refused = (change: object, expected: RegExp) => assert.throws(() => parseText(JSON.stringify({ ...hello, ...change })), expected);
  refused({ version: 2 }, /version 2/);
  refused({ fps: 0 }, /fps is 0/);
  refused({ volume: { low: [0, 0] } }, /volume.low/);
  refused({ cameras: [{ ...hello.cameras[0], matrix: [[1, 0, 0]] }] }, /cameras\[0\].matrix/);
  refused({ cameras: [{ ...hello.cameras[0], distortions: [0] }] }, /distortions/);
  assert.throws(() => parseText("nonsense"), /not JSON/);
});

test("an op of a newer server is passed over", () => {
  assert.equal(parseText('{"op":"confetti"}'), null);
});

test("shadows are drawn on every level", () => {
  for (const { shadowSize } of LEVELS) assert.ok(shadowSize >= 256);
});

test("slow pictures lower the effort soon, quick ones raise it late, and one slow one changes nothing", () => {
  const quality = new Quality();
  quality.took(500);
  assert.equal(quality.number, 0);
  for (let i = 0; i < 100; i++) quality.took(200);
  assert.equal(quality.number, LEVELS.length - 1);
  for (let i = 0; i < 89; i++) quality.took(5);
  assert.equal(quality.number, LEVELS.length - 1);
  quality.took(5);
  assert.equal(quality.number, LEVELS.length - 2);
});

const start = { target: [0, 1, 0] as const, azimuth: 0.5, polar: 1.2, distance: 3 };

test("the view from an eye is that eye's, whichever way up is", () => {
  for (const up of [[0, 1, 0], [0, 0, 1], [0, -1, 0], [1, 0, 0]] as const) {
    const orbit = new Orbit(up, null, start);
    const eye = [1.2, 0.7, 2.1] as const;
    const back = orbit.eye(orbit.viewOf(eye, [0.1, 0.2, 0.3]));
    back.forEach((n, i) => assert.ok(Math.abs(n - eye[i]) < 1e-9, `${up}: ${back}`));
  }
});

test("the eye stays above the floor and within reach", () => {
  const orbit = new Orbit([0, 1, 0], 0, start);
  orbit.turn(0, 9, false);
  assert.ok(orbit.eye()[1] >= 0.049, `${orbit.eye()}`);
  orbit.zoom(1e6);
  assert.equal(orbit.now.distance, MAX_DISTANCE_M);
  assert.ok(orbit.eye()[1] >= 0.049);
});

test("a flight ends where it was to go, and a turn ends it", () => {
  const orbit = new Orbit([0, 1, 0], 0, start);
  const to = { ...start, azimuth: start.azimuth + 2 * Math.PI - 0.3, distance: 5 };
  orbit.fly(to);
  orbit.step(10, 0.016, false);
  orbit.step(10.2, 0.016, false);
  // The short way: backwards by 0.3.
  assert.ok(orbit.now.azimuth < start.azimuth && orbit.now.azimuth > start.azimuth - 0.31);
  orbit.step(11, 0.016, false);
  assert.ok(Math.abs(orbit.now.distance - 5) < 1e-9);
  orbit.fly(start);
  orbit.turn(0.1, 0, false);
  assert.equal(orbit.step(12, 0.016, true), false);
});

test("circling goes round at one height, and ends with whatever is asked", () => {
  const stops: ((orbit: Orbit) => void)[] = [(o) => o.turn(0.1, 0, false), (o) => o.pan(0.1, 0, 1), (o) => o.zoom(1), (o) => o.jump(start), (o) => o.fly(start), (o) => o.hold()];
  for (const stop of stops) {
    const orbit = new Orbit([0, 1, 0], 0, start);
    orbit.circle();
    let before = orbit.now.azimuth;
    for (let i = 0; i < 10; i++) {
      assert.ok(orbit.step(i, 0.1, false));
      assert.ok(orbit.now.azimuth > before && orbit.now.polar === start.polar && orbit.now.distance === start.distance);
      before = orbit.now.azimuth;
    }
    stop(orbit);
    orbit.step(100, 0.1, false);
    orbit.step(101, 0.1, false);
    orbit.step(102, 0.1, false);
    assert.equal(orbit.step(103, 0.1, false), false, String(stop));
  }
});

test("reduced motion neither coasts nor flies nor circles", () => {
  const orbit = new Orbit([0, 1, 0], 0, start);
  orbit.reduced = true;
  orbit.fly({ ...start, distance: 4 });
  assert.equal(orbit.now.distance, 4);
  orbit.turn(0.5, 0, true);
  orbit.circle();
  assert.equal(orbit.step(1, 0.016, false), false);
});
