import assert from "node:assert/strict";
import { test } from "node:test";
import { distanceField, MARGIN_PIXELS, NEAR_PIXELS, Scratch } from "../../src/feed/distance.ts";
import { decodeRuns } from "../../src/feed/runs.ts";
import { encodeRuns } from "../feeder/write.ts";

/** A mask from rows of text: # is foreground. */
function mask(...rows: string[]): [Uint8Array, number, number] {
  return [Uint8Array.from(rows.join("").replaceAll("#", "1").replaceAll(".", "0"), Number), rows[0].length, rows.length];
}

/** Chance that is the same every time. */
function seeded(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

function paint(runs: ReturnType<typeof decodeRuns>): Uint8Array {
  const pixels = new Uint8Array(runs.width * runs.height);
  for (let row = 0; row < runs.height; row++) {
    for (let run = runs.rows[row]; run < runs.rows[row + 1]; run++) pixels.fill(1, row * runs.width + runs.starts[run], row * runs.width + runs.ends[run]);
  }
  return pixels;
}

test("these bytes are this picture, as the nodes write it", () => {
  // Row 0: none. Row 1: columns 1 to 3 and 5. Row 2: all six. Gaps after the first run are less one.
  const runs = decodeRuns(Uint8Array.of(0, 2, 1, 2, 0, 0, 1, 0, 5), 6, 3);
  assert.deepEqual([...paint(runs)], [...mask("......", ".###.#", "######")[0]]);
  assert.equal(runs.area, 10);
  assert.deepEqual(runs.bounds, { left: 0, top: 1, right: 6, bottom: 3 });
});

test("random masks come back as they were", () => {
  const chance = seeded(7);
  for (let round = 0; round < 60; round++) {
    const [width, height] = [1 + Math.floor(chance() * 300), 1 + Math.floor(chance() * 12)];
    const share = chance();
    const pixels = Uint8Array.from({ length: width * height }, () => (chance() < share ? 1 : 0));
    assert.deepEqual(paint(decodeRuns(encodeRuns(pixels, width, height), width, height)), pixels);
  }
});

test("bytes that are no runs are refused", () => {
  const refused = (bytes: number[], expected: RegExp) => assert.throws(() => decodeRuns(Uint8Array.from(bytes), 6, 2), expected);
  refused([0], /end after 1 bytes/);
  refused([0, 0, 0], /1 bytes are left/);
  refused([1, 5, 1, 0], /ends at 7/);
  refused([9, 0, 0, 0], /claims 9 runs/);
  refused([0x80, 0x80, 0x80, 0x01], /larger than any column/);
});

/** Pixel centres' true distance to the outline between foreground and background. */
function brute(pixels: Uint8Array, width: number, height: number, column: number, row: number): number {
  const inside = (c: number, r: number) => c >= 0 && r >= 0 && c < width && r < height && pixels[r * width + c] === 1;
  const here = inside(column, row);
  let best = Infinity;
  for (let r = -20; r < height + 20; r++) {
    for (let c = -20; c < width + 20; c++) if (inside(c, r) !== here) best = Math.min(best, Math.hypot(c - column, r - row));
  }
  return here ? 0.5 - best : best - 0.5;
}

test("distances are those to the outline, a twelfth long at most and never short", () => {
  const [pixels, width, height] = mask("........", "..####..", "..#####.", "...##...", "........");
  const field = distanceField(decodeRuns(encodeRuns(pixels, width, height), width, height), true, 1, new Scratch())!;
  for (let row = 0; row < field.rows; row++) {
    for (let column = 0; column < field.columns; column++) {
      const found = field.bytes[row * field.columns + column] / 2 - NEAR_PIXELS;
      const truth = brute(pixels, width, height, column + field.rect.left, row + field.rect.top);
      // Bytes hold half pixels, so a quarter is rounding.
      const [low, high] = truth > 0 ? [truth - 0.25, (truth + 0.5) * 1.083 - 0.25] : [(truth - 0.5) * 1.083 + 0.25, truth + 0.25];
      assert.ok(found >= low - 1e-9 && found <= high + 1e-9, `${column}, ${row}: ${found} instead of ${truth}`);
    }
  }
});

test("the field reaches past the silhouette's box, and past the image where that is outside", () => {
  const [pixels, width, height] = mask("##..", "##..", "....");
  const runs = decodeRuns(encodeRuns(pixels, width, height), width, height);
  const past = distanceField(runs, true, 1, new Scratch())!;
  assert.deepEqual(past.rect, { left: -MARGIN_PIXELS, top: -MARGIN_PIXELS, right: 2 + MARGIN_PIXELS, bottom: 2 + MARGIN_PIXELS });
  assert.deepEqual(distanceField(runs, false, 1, new Scratch())!.rect, { left: 0, top: 0, right: 4, bottom: 3 });
});

test("a silhouette at the image's edge ends there, or goes on unseen, as the rule says", () => {
  const [pixels, width, height] = mask("####", "####", "####", "####");
  const runs = decodeRuns(encodeRuns(pixels, width, height), width, height);
  const at = (pastEdge: boolean) => {
    const field = distanceField(runs, pastEdge, 1, new Scratch())!;
    return field.bytes[-field.rect.top * field.columns - field.rect.left] / 2 - NEAR_PIXELS;
  };
  assert.equal(at(true), -0.5);
  assert.equal(at(false), -NEAR_PIXELS);
});

test("coarse fields tell the same in larger steps", () => {
  const size = 64;
  const pixels = Uint8Array.from({ length: size * size }, (_, i) => (Math.hypot((i % size) - 32, Math.floor(i / size) - 32) < 20 ? 1 : 0));
  const runs = decodeRuns(encodeRuns(pixels, size, size), size, size);
  const field = distanceField(runs, true, 4, new Scratch())!;
  const [column, row] = [(32 - field.rect.left) / 4, (4 - field.rect.top) / 4];
  const found = (field.bytes[Math.floor(row) * field.columns + Math.floor(column)] / 2 - NEAR_PIXELS) * 4;
  assert.ok(Math.abs(found - (Math.hypot(2, 6 - 32) - 20)) < 4, `${found}`);
});

test("an empty silhouette has no field", () => {
  assert.equal(distanceField(decodeRuns(Uint8Array.of(0, 0), 4, 2), true, 1, new Scratch()), null);
});
