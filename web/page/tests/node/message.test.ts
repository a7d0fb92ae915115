import assert from "node:assert/strict";
import { test } from "node:test";
import { type FrameSet, parseMessage, type WorldMessage } from "../../src/feed/message.ts";
import { frameMessage, type Part, worldMessage } from "../feeder/write.ts";

const part: Part = { camera: 3, scaleLog2: 1, left: 8, top: 16, width: 64, height: 32, runs: Uint8Array.of(1, 2, 3), jpeg: Uint8Array.of(9, 8) };

test("a frame set is read as it was written", () => {
  const set = parseMessage(frameMessage(1, 7, 42, 1.4, [part, { ...part, camera: 0, jpeg: null }])) as FrameSet;
  assert.equal(set.type, "frames");
  assert.deepEqual([set.seq, set.frame, set.filmS], [7, 42, 1.4]);
  const [first, second] = set.cameras;
  assert.deepEqual({ ...first, runs: [...first.runs!], jpeg: [...first.jpeg!] }, { ...part, runs: [1, 2, 3], jpeg: [9, 8] });
  assert.equal(second.camera, 0);
  assert.equal(second.jpeg, null);
});

test("images tell whether they are thumbnails", () => {
  assert.equal((parseMessage(frameMessage(3, 1, 1, 0, [{ ...part, runs: null }], 1)) as FrameSet).thumbnails, true);
  assert.equal((parseMessage(frameMessage(3, 1, 1, 0, [{ ...part, runs: null }], 0)) as FrameSet).thumbnails, false);
});

test("a world is read as it was written", () => {
  const bodies = [{ id: 5, position: [1, 2, 3] }, { id: 9, position: [0, 0, 0], grabbed: true }];
  const world = parseMessage(worldMessage(1, 2, 240, 2, 60, true, bodies, [[1, 0.5, 0.25, 0, 0, 0, 1]])) as WorldMessage;
  assert.deepEqual([world.generation, world.step, world.filmS, world.frame, world.paused], [2, 240, 2, 60, true]);
  assert.deepEqual(world.bodies.map(({ id, grabbed, position }) => [id, grabbed, position]), [[5, false, [1, 2, 3]], [9, true, [0, 0, 0]]]);
  assert.deepEqual([...world.touches], [1, 0.5, 0.25, 0, 0, 0, 1]);
});

test("a world without a hull names no frame", () => {
  assert.equal((parseMessage(worldMessage(1, 1, 1, 1, null, false, [])) as WorldMessage).frame, null);
});

/** Every way in which a good message is made a bad one. */
const wrong: [string, (view: DataView) => void, RegExp][] = [
  ["another magic", (view) => view.setUint32(0, 1, true), /magic/],
  ["a later version", (view) => view.setUint8(5, 2), /version 2/],
  ["an unknown type", (view) => view.setUint8(4, 9), /type 9/],
  ["a length that is not its own", (view) => view.setUint32(12, 10_000, true), /says 10000 bytes/],
  ["more cameras than bytes", (view) => view.setUint16(6, 60, true), /need/],
  ["more cameras than are drawn", (view) => view.setUint16(6, 65, true), /65 cameras/],
  ["runs beyond the end", (view) => view.setUint32(48 + 16, 1 << 20, true), /runs at/],
  ["runs in the header", (view) => view.setUint32(48 + 12, 0, true), /runs at/],
  ["an image whose end overflows", (view) => view.setUint32(48 + 24, 0xffff_ffff, true), /image at/],
  ["an image without a size", (view) => view.setUint16(48 + 8, 0, true), /crop of 0/],
  ["a scale that is none", (view) => view.setUint8(48 + 3, 7), /scale 7/],
  ["time that is not a number", (view) => view.setFloat64(24, Number.NaN, true), /captured/],
];
for (const [what, change, expected] of wrong) {
  test(`a frame set with ${what} is refused`, () => {
    const buffer = frameMessage(1, 1, 1, 1, [part]);
    change(new DataView(buffer));
    assert.throws(() => parseMessage(buffer), expected);
  });
}

test("a camera that comes twice is refused", () => {
  assert.throws(() => parseMessage(frameMessage(1, 1, 1, 1, [part, part])), /comes twice/);
});

test("bodies that turn by no rotation, and touches of no body, are refused", () => {
  const body = { id: 5, position: [0, 0, 0] };
  const skewed = worldMessage(1, 1, 1, 1, 1, false, [body]);
  new DataView(skewed).setFloat32(48 + 32, 3, true);
  assert.throws(() => parseMessage(skewed), /rotation of length 3/);
  assert.throws(() => parseMessage(worldMessage(1, 1, 1, 1, 1, false, [body], [[1, 0, 0, 0, 0, 0, 0]])), /touch of body 1/);
});

/** Of body 0, four samples: at a point, upwards, sliding; 3 cm deep, 12.5 cm wide. */
const patch = [0, 4, 1, 0.5, 0.25, 0, 1, 0, 0.5, 0, 0, 0.03125, 0.125];
const withPatches = (patches: readonly (readonly number[])[]) => worldMessage(1, 1, 1, 1, 1, false, [{ id: 1, position: [0, 0, 0] }], [[0, 0, 0, 0, 0, 0, 0]], patches);

test("patches are read as they were written", () => {
  assert.deepEqual([...(parseMessage(withPatches([patch, patch])) as WorldMessage).patches], [...patch, ...patch]);
  assert.equal((parseMessage(withPatches([])) as WorldMessage).patches.length, 0);
});

/** A patch with another number in one place. */
const patchBut = (place: number, value: number) => patch.map((n, i) => (i === place ? value : n));
const wrongPatches: [string, readonly (readonly number[])[], RegExp][] = [
  ["of no body", [patchBut(0, 1)], /patch of body 1/],
  ["at no place", [patchBut(3, NaN)], /a patch holds NaN/],
  ["that moves at no speed", [patchBut(8, Infinity)], /a patch holds Infinity/],
  ["whose normal has no length", [patchBut(6, 0)], /normal of length 0/],
  ["smaller than nothing", [patchBut(12, -1)], /radius -1/],
  ["more than four a body", Array(5).fill(patch), /5 patches of 1 bodies/],
];
for (const [what, patches, expected] of wrongPatches) {
  test(`patches ${what} are refused`, () => assert.throws(() => parseMessage(withPatches(patches)), expected));
}

test("no message that was cut short is read past its end", () => {
  const whole = frameMessage(1, 1, 1, 1, [part]);
  const world = worldMessage(1, 1, 1, 1, 1, false, [{ id: 1, position: [0, 0, 0] }], [[0, 0, 0, 0, 0, 0, 0]]);
  const patched = withPatches([patch, patch]);
  for (const message of [whole, world, patched]) {
    for (let length = 0; length < message.byteLength; length++) {
      // A world may end where its patches would begin.
      if (message === patched && length === world.byteLength) continue;
      const cut = message.slice(0, length);
      if (length >= 16) new DataView(cut).setUint32(12, length, true);
      assert.throws(() => parseMessage(cut), Error, `${length} bytes`);
    }
  }
});
