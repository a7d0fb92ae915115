import assert from "node:assert/strict";
import { test } from "node:test";
import { REFUSAL_MS, WholeSets } from "../../src/time/whole.ts";

function ofEight(): WholeSets {
  const sets = new WholeSets();
  sets.setup(8);
  return sets;
}

test("a first set that lacks cameras is refused: of five cameras it is another person", () => {
  const sets = ofEight();
  assert.equal(sets.accepts(5, 1_000_000), false);
  assert.equal(sets.accepts(8, 1_000_100), true);
  assert.equal(sets.accepts(7, 1_000_200), false);
});

test("cameras that stay away for long are no longer waited for", () => {
  const sets = ofEight();
  assert.deepEqual([0, 0.5, 0.99, 1, 2].map((share) => sets.accepts(6, 50 + share * REFUSAL_MS)), [false, false, false, true, true]);
  const later = 50 + 3 * REFUSAL_MS;
  assert.equal(sets.accepts(8, later), true);
  assert.equal(sets.accepts(6, later + 1), false, "they are back, and are waited for again");
});

test("every connection starts over", () => {
  const sets = ofEight();
  sets.accepts(4, 0);
  assert.equal(sets.accepts(4, REFUSAL_MS), true);
  sets.setup(8);
  assert.equal(sets.accepts(4, REFUSAL_MS + 1), false);
});

test("a set without cameras tells its frame's number, whenever it comes", () => {
  const sets = ofEight();
  assert.equal(sets.accepts(0, 0), true);
  assert.equal(sets.accepts(3, 10), false);
});
