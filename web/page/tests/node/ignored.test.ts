import assert from "node:assert/strict";
import { test } from "node:test";
import { hullBox } from "../../src/decode/hull_box.ts";
import { silhouetteOf as field } from "../../src/decode/silhouette.ts";
import { NEAR_PIXELS, Scratch } from "../../src/feed/distance.ts";
import { decodeRuns, type Runs, union } from "../../src/feed/runs.ts";
import { type Hello, parseText } from "../../src/feed/text.ts";
import { type Camera, camera, type Vec3 } from "../../src/view/lens.ts";
import { distance, hullMask, inside, limbs, occluded, overlap, ringOfCameras, silhouetteOf } from "../feeder/person.ts";
import { encodeRuns } from "../feeder/write.ts";

const [WIDTH, HEIGHT] = [160, 120];
const HIDING = { left: 50, top: 30, right: 110, bottom: 78 };
const VOLUME = { low: [-1.5, 0, -1.5], high: [1.5, 2.2, 1.5] } as const;

function runsOf(mask: Uint8Array, width: number, height: number): Runs {
  return decodeRuns(encodeRuns(mask, width, height), width, height);
}

/** Six cameras around the person; something hides his middle from the first one, which ignores it or not. */
function filmed(ignores: boolean): { cameras: Camera[]; masks: Uint8Array[] } {
  const texts = ringOfCameras(6, WIDTH, HEIGHT);
  const masks = texts.map((text, index) => silhouetteOf(camera(text, index), 0));
  const hidden = occluded(texts[0], masks[0], HIDING);
  masks[0] = hidden.mask;
  if (ignores) texts[0] = hidden.text;
  return { cameras: texts.map(camera), masks };
}

test("two pictures' union is what either has, run by run", () => {
  let state = 11;
  const chance = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
  for (let round = 0; round < 60; round++) {
    const [width, height] = [1 + Math.floor(chance() * 60), 1 + Math.floor(chance() * 8)];
    const [a, b] = [chance(), chance()].map((share) => Uint8Array.from({ length: width * height }, () => (chance() < share * share ? 1 : 0)));
    const either = runsOf(a.map((pixel, i) => pixel | b[i]), width, height);
    assert.deepEqual(union(runsOf(a, width, height), runsOf(b, width, height)), either);
  }
});

test("the hull goes on behind what a camera ignores, where otherwise it would be carved", () => {
  const view = camera(ringOfCameras(5, 80, 80)[2], 0);
  const [silent, carving] = [filmed(true), filmed(false)];
  const whole = { ...silent, masks: silent.cameras.map((each) => silhouetteOf(each, 0)) };
  const seen = (film: typeof silent, minViews: number, outside = true) => hullMask(view, film.cameras, film.masks, minViews, outside);
  const truth = seen({ ...whole, cameras: carving.cameras }, 2);
  const share = (mask: Uint8Array) => mask.reduce((sum, one) => sum + one, 0);
  assert.ok(share(seen(carving, 2)) < 0.8 * share(truth), "a camera that does not ignore it carves the person away");
  for (const outside of [true, false]) {
    const found = seen(silent, 2, outside);
    assert.ok(truth.every((pixel, i) => pixel <= found[i]), "one that does leaves all of him");
    assert.ok(overlap(found, truth) > 0.8, `and little more: ${overlap(found, truth)}`);
    // A silent camera is none of those that see: where all must, nothing is left there.
    assert.deepEqual(seen(silent, 6, outside), seen(carving, 6, outside));
  }
});

test("no distance and no box rejects what the rule keeps, and nothing is kept that a camera rejects", () => {
  const parts = limbs(0);
  for (const outside of [true, false]) {
    const { cameras, masks } = filmed(true);
    const fields = cameras.map((each, k) => field(each, runsOf(masks[k], WIDTH, HEIGHT), outside, true, new Scratch()));
    const box = hullBox(VOLUME, cameras.map((each, k) => ({ camera: each, field: fields[k].field })), outside)!;
    let kept = 0;
    for (let x = -0.6; x < 0.6; x += 0.03) {
      for (let y = 0.02; y < 1.9; y += 0.03) {
        for (let z = -0.6; z < 0.6; z += 0.03) {
          const isInside = inside(cameras, masks, 2, outside, x, y, z);
          if (distance(parts, x, y, z)[0] < -0.02) assert.ok(isInside, `${x}, ${y}, ${z} is in the person`);
          if (!isInside) continue;
          kept++;
          const point: Vec3 = [x, y, z];
          assert.ok(point.every((n, i) => n >= box.low[i] && n <= box.high[i]), `${point} beside ${JSON.stringify(box)}`);
        }
      }
    }
    assert.ok(kept > 500);
    // Pixel by pixel: the first camera carves where there is neither foreground nor anything ignored.
    const { rect, columns, bytes } = fields[0].field!;
    for (let i = 0; i < WIDTH * HEIGHT; i++) {
      const [column, row] = [(i % WIDTH) - rect.left, Math.floor(i / WIDTH) - rect.top];
      if (column < 0 || row < 0 || column >= columns || row >= bytes.length / columns) continue;
      const isIgnored = i % WIDTH >= HIDING.left && i % WIDTH < HIDING.right && row + rect.top >= HIDING.top && row + rect.top < HIDING.bottom;
      assert.equal(bytes[row * columns + column] / 2 < NEAR_PIXELS, masks[0][i] === 1 || isIgnored, `pixel ${i}`);
    }
    assert.notDeepEqual(fields[0].outlined, fields[0].field, "the outline is the silhouette's own");
    assert.equal(fields[1].outlined, fields[1].field);
  }
});

test("where a camera sees no person, there may be one behind what it ignores", () => {
  const { cameras, masks } = filmed(true);
  masks[0].fill(0);
  const seen = cameras.map((each, k) => ({ camera: each, field: field(each, runsOf(masks[k], WIDTH, HEIGHT), true, false, new Scratch()).field }));
  assert.ok(hullBox(VOLUME, seen, true));
});

test("a hello tells what cameras ignore, and is refused if that is nothing", () => {
  const text = { name: "a", width: 6, height: 3, matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], distortions: [0, 0, 0, 0, 0], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation: [0, 0, 0] };
  const read = (change: object) =>
    (parseText(JSON.stringify({ op: "hello", version: 1, fps: 30, cameras: [{ ...text, ...change }], volume: VOLUME })) as Hello).cameras[0].ignored;
  const base64 = (...bytes: number[]) => Buffer.from(bytes).toString("base64");
  const runs = read({ ignored: base64(0, 2, 1, 2, 0, 0, 1, 0, 5) });
  assert.deepEqual([runs?.area, runs?.bounds], [10, { left: 0, top: 1, right: 6, bottom: 3 }]);
  assert.equal(read({}), null);
  assert.equal(read({ ignored: base64(0, 0, 0) }), null, "no pixels are none");
  assert.throws(() => read({ ignored: 7 }), /cameras\[0\].ignored is no text/);
  assert.throws(() => read({ ignored: "?" }), /cameras\[0\].ignored: /);
  assert.throws(() => read({ ignored: base64(0, 0) }), /cameras\[0\].ignored: runs end/);
});
