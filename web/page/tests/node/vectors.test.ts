/** The server's very bytes and texts, as its own tests hold them. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { type FrameSet, parseMessage, type WorldMessage } from "../../src/feed/message.ts";
import { parseText, type Scene, type Status } from "../../src/feed/text.ts";

const file = (name: string) => readFileSync(`tests/vectors/${name}`);
const message = (name: string) => {
  const bytes = file(name);
  return parseMessage(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length) as ArrayBuffer);
};

test("a frame set of the server's is read", () => {
  const set = message("frame_set.bin") as FrameSet;
  assert.deepEqual([set.type, set.seq, set.frame, set.filmS, set.capturedUnixS], ["frames", 41, 90, 3, 1_700_000_000.125]);
  const [both, runs, nothing] = set.cameras;
  assert.deepEqual([both.camera, both.scaleLog2, both.left, both.top, both.width, both.height], [0, 1, 16, 32, 48, 64]);
  assert.deepEqual([...both.jpeg!], [0xff, 0xd8, 1, 2, 3, 0xff, 0xd9]);
  // Rows of 8 pixels: "........", "..##.#..", ".######.", ".######.", "...##...", "........".
  assert.deepEqual([...both.runs!], [0, 2, 2, 1, 0, 0, 1, 1, 5, 1, 1, 5, 1, 3, 1, 0]);
  assert.deepEqual([runs.camera, runs.jpeg], [2, null]);
  assert.deepEqual([nothing.camera, nothing.runs, nothing.jpeg], [5, null, null]);
  assert.deepEqual((message("frame_set_empty.bin") as FrameSet).cameras, []);
});

test("images of the server's are read", () => {
  const all = message("images_thumbnails.bin") as FrameSet;
  assert.deepEqual([all.type, all.thumbnails, all.cameras.map(({ camera, width, runs }) => [camera, width, runs])], ["images", true, [[0, 640, null], [1, 640, null]]]);
  const one = message("images_one.bin") as FrameSet;
  assert.deepEqual([one.thumbnails, one.cameras.length, one.cameras[0].camera], [false, 1, 1]);
});

test("a world of the server's is read", () => {
  const world = message("world.bin") as WorldMessage;
  assert.deepEqual([world.generation, world.step, world.filmS, world.frame, world.paused, world.blind], [2, 360, 3, 90, true, false]);
  const [asleep, touching] = world.bodies;
  assert.deepEqual([asleep.id, asleep.asleep, asleep.touching, asleep.position], [4, true, false, [1, 0.5, -0.25]]);
  assert.deepEqual([touching.id, touching.touching, touching.grabbed, touching.insideSamples], [5, true, true, 3]);
  assert.deepEqual(touching.response, [0, 0.125, 0.0625]);
  assert.ok(Math.abs(touching.rotation[1] - 0.6) < 1e-6 && Math.abs(touching.rotation[3] - 0.8) < 1e-6);
  assert.deepEqual([...world.touches], [1, 1.25, 0.5, -0.25, 0, 0.125, 0, 1, 1.25, 0.75, -0.25, 0, 0.125, 0]);
  assert.equal(world.patches.length, 0);
  const patched = message("world_patches.bin") as WorldMessage;
  assert.deepEqual([patched.bodies, patched.touches], [world.bodies, world.touches]);
  const patch = (slides: number) => [1, 25, 1.25, 0.5, -0.25, 0, 1, 0, slides, 0.25, 0, 0.03125, 0.125];
  assert.deepEqual([...patched.patches], [...patch(0), ...patch(-0.5)]);
  const blind = message("world_blind.bin") as WorldMessage;
  assert.deepEqual([blind.frame, blind.blind, blind.bodies.length], [null, true, 0]);
});

test("texts of the server's are read", () => {
  const text = (name: string) => parseText(file(name).toString());
  const scene = text("scene.json") as Scene;
  const kinds = scene.bodies.map(({ shape }) => Object.keys(shape)[0]);
  assert.deepEqual(kinds, ["box", "ball", "capsule", "cylinder", "cone", "hull"]);
  assert.equal(scene.parameters.hull_restitution, 0.25);
  const status = text("status.json") as Status;
  assert.deepEqual([status.progress?.film_s, status.progress?.hull_age_ms, status.cameras?.[1].problem, status.feed?.tier], [3, 66.5, "connection refused", "full"]);
  assert.deepEqual(text("done.json"), { op: "done", id: 7, body: 12 });
  assert.deepEqual(text("refused.json"), { op: "refused", id: 8, why: "no body has number 99" });
  assert.deepEqual(text("bye.json"), { op: "bye", why: "the run has ended" });
});
