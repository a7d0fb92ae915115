import assert from "node:assert/strict";
import { test } from "node:test";
import { Growth, LastMinute } from "../../src/time/last_minute.ts";

const values = (last: LastMinute, nowMs: number) => last.pieces(nowMs).map((piece) => piece.map(({ value }) => value));

test("what is older than a minute is forgotten, and no longer the greatest", () => {
  const last = new LastMinute();
  assert.equal(last.most(0), null);
  last.add(0, 90);
  for (let atMs = 250; atMs <= 60_000; atMs += 250) last.add(atMs, 3);
  assert.equal(last.most(60_000), 90);
  assert.equal(last.most(60_100), 3);
  assert.equal(last.pieces(60_100).length, 1);
  assert.equal(last.most(120_001), null, "nothing came for a minute");
});

test("where nothing was known, and where nothing came, there is a gap", () => {
  const last = new LastMinute();
  for (const [atMs, value] of [[0, 1], [250, 2], [500, null], [750, 3], [5000, 4], [5250, null]] as const) last.add(atMs, value);
  assert.deepEqual(values(last, 5250), [[1, 2], [3], [4]]);
  last.clear();
  assert.deepEqual(values(last, 5250), []);
});

const increases = (growth: Growth, counts: (number | null)[]) => counts.map((count) => growth.increase(count));

test("a count grows by what was added, once it has settled", () => {
  assert.deepEqual(increases(new Growth(), [7, 7, 7, 7, 9, 9, 9, 9]), [null, null, null, 0, 0, 0, 2, 0]);
});

test("a frame that is late and then used was not missed", () => {
  assert.deepEqual(increases(new Growth(), [7, 7, 7, 7, 8, 8, 7, 8, 7, 7]), [null, null, null, 0, 0, 0, 0, 0, 0, 0]);
});

test("what was missed while the page did not look is not of one moment", () => {
  const growth = new Growth();
  increases(growth, [7, 7, 7, 7]);
  growth.restart();
  // The first status is of before.
  assert.deepEqual(increases(growth, [7, 90, 90, 90, 91, 91, 91]), [null, null, null, 0, 0, 0, 1]);
});

test("a count that begins again has not grown", () => {
  assert.deepEqual(increases(new Growth(), [90, 90, 90, 90, 2, 2, 2, 3, 3, 3]), [null, null, null, 0, 0, 0, 0, 0, 0, 1]);
});
