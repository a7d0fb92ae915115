/** How a picture that stands is refined: where its pixels are shifted to, and which part is drawn when. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { type Part, Refinement, SAMPLES, SHIFTS } from "../../src/draw/refinement.ts";

/** Of a pixel, how much lies on one side of a straight edge. */
function covered(angle: number, offset: number): number {
  const SIDE = 64;
  let count = 0;
  for (let i = 0; i < SIDE * SIDE; i++) {
    const [x, y] = [((i % SIDE) + 0.5) / SIDE - 0.5, (Math.floor(i / SIDE) + 0.5) / SIDE - 0.5];
    if (x * Math.cos(angle) + y * Math.sin(angle) < offset) count++;
  }
  return count / (SIDE * SIDE);
}

/** All parts until there is none; each takes so many milliseconds. */
function partsOf(refinement: Refinement, ms: number): Part[] {
  const parts: Part[] = [];
  for (let part = refinement.next(); part; part = refinement.next()) {
    parts.push(part);
    refinement.took(part, ms);
    assert.ok(parts.length <= 17 * SAMPLES, "it ends");
  }
  return parts;
}

test("shifts move a picture by nothing on the whole, and by less than a pixel each", () => {
  assert.equal(SHIFTS.length, SAMPLES);
  for (const axis of [0, 1]) {
    const sum = SHIFTS.reduce((total, shift) => total + shift[axis], 0);
    assert.ok(Math.abs(sum) < 1e-12, `axis ${axis}: ${sum}`);
    assert.equal(new Set(SHIFTS.map((shift) => shift[axis])).size, SAMPLES, "no two in one row or column");
    for (const shift of SHIFTS) assert.ok(Math.abs(shift[axis]) < 0.55, `${shift}`);
  }
  // The first one alone is on the screen for a moment.
  assert.ok(Math.hypot(...SHIFTS[0]) < 0.2, `${SHIFTS[0]}`);
});

test("shifts find how much of a pixel an edge covers, wherever and however it runs", (t) => {
  let [worst, sum, count] = [0, 0, 0];
  for (let angle = 0; angle < Math.PI; angle += Math.PI / 24) {
    for (let offset = -0.5; offset <= 0.5; offset += 0.05) {
      const found = SHIFTS.filter(([x, y]) => x * Math.cos(angle) + y * Math.sin(angle) < offset).length / SAMPLES;
      const error = Math.abs(found - covered(angle, offset));
      worst = Math.max(worst, error);
      sum += error;
      count++;
    }
  }
  t.diagnostic(`error ${(sum / count).toFixed(3)} of a pixel in the mean, ${worst.toFixed(3)} at worst`);
  assert.ok(sum / count < 0.05 && worst < 0.2, `${sum / count}, ${worst}`);
});

test("every picture has all rows once, in order, and then the scene; after sixteen there is nothing to draw", () => {
  for (const ms of [1, 60, 5000]) {
    const refinement = new Refinement();
    const parts = partsOf(refinement, ms);
    for (let sample = 0; sample < SAMPLES; sample++) {
      const own = parts.filter((part) => part.sample === sample);
      const rows = own.slice(0, -1).map((part) => part.rows!);
      assert.equal(own.at(-1)!.rows, null);
      assert.equal(rows[0][0], 0);
      assert.equal(rows.at(-1)![1], 1);
      rows.slice(1).forEach(([from], index) => assert.equal(from, rows[index][1]));
      for (const [from, to] of rows) assert.ok(to > from, `${from} to ${to}`);
    }
    assert.deepEqual([refinement.count, refinement.isComplete, refinement.next()], [SAMPLES, true, null]);
  }
});

test("parts that take long become smaller, quick ones larger, and neither without bounds", () => {
  const last = (ms: number) => partsOf(new Refinement(), ms).filter((part) => part.sample === SAMPLES - 1).length;
  assert.equal(last(1), 2, "all rows at once, and the scene");
  assert.equal(last(5000), 17);
  assert.ok(last(60) > 2 && last(60) < 17);
});

test("a picture counts once it is complete, and a change drops what was drawn", () => {
  const refinement = new Refinement();
  const counts: number[] = [];
  for (let i = 0; i < 8; i++) {
    const part = refinement.next()!;
    counts.push(refinement.count);
    assert.equal(refinement.count, part.sample + (part.rows === null ? 1 : 0));
  }
  assert.ok(counts.at(-1)! > 0 && !refinement.isComplete);
  refinement.drop();
  assert.equal(refinement.count, 0);
  const first = refinement.next()!;
  assert.deepEqual([first.sample, first.rows![0]], [0, 0]);
  // Also half of a picture.
  refinement.drop();
  assert.equal(refinement.next()!.rows![0], 0);
  // And one that was as fine as it becomes.
  partsOf(refinement, 1);
  assert.equal(refinement.next(), null);
  refinement.drop();
  assert.equal(refinement.next()!.sample, 0);
});
