import assert from "node:assert/strict";
import { test } from "node:test";
import { Growth, LastMinute } from "../../src/time/last_minute.ts";

const values = (last: LastMinute) => last.pieces().map((piece) => piece.map(({ value }) => value));

test("what is older than a minute is forgotten, and no longer the greatest", () => {
  const last = new LastMinute();
  assert.equal(last.most(), null);
  last.add(0, 90);
  for (let atMs = 250; atMs <= 60_000; atMs += 250) last.add(atMs, 3);
  assert.equal(last.most(), 90);
  last.add(60_250, 4);
  assert.equal(last.most(), 4);
  assert.equal(last.pieces().length, 1);
});

test("where nothing was known, and where nothing came, there is a gap", () => {
  const last = new LastMinute();
  for (const [atMs, value] of [[0, 1], [250, 2], [500, null], [750, 3], [5000, 4], [5250, null]] as const) last.add(atMs, value);
  assert.deepEqual(values(last), [[1, 2], [3], [4]]);
});

test("a count grows by what was added, and by nothing when it begins again", () => {
  const growth = new Growth();
  assert.deepEqual([7, 7, 9, null, 9, 12, 2, 3].map((count) => growth.of(count)), [0, 0, 2, null, 0, 3, 0, 1]);
});
