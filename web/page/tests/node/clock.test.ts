import assert from "node:assert/strict";
import { test } from "node:test";
import { Latency, Median, Rate } from "../../src/time/clock.ts";

const NOW_MS = 1_800_000_000_000;

test("from lens to screen is the median of the last sets", () => {
  const latency = new Latency();
  assert.equal(latency.get(), null);
  for (const agoMs of [90, 80, 900]) latency.add((NOW_MS - agoMs) / 1000, NOW_MS);
  assert.ok(Math.abs(latency.get()! - 90) < 1e-3);
});

test("sets of which nothing was asked, as in Off, were captured at no time", () => {
  const latency = new Latency();
  latency.add((NOW_MS - 90) / 1000, NOW_MS);
  latency.add(0, NOW_MS);
  assert.equal(latency.get(), null, "not 57 years");
  latency.add((NOW_MS - 70) / 1000, NOW_MS);
  assert.ok(Math.abs(latency.get()! - 70) < 1e-3);
});

test("rates forget what is older than their window", () => {
  const rate = new Rate(2000);
  for (const at of [0, 500, 1000]) rate.add(at, 2);
  assert.equal(rate.perSecond(1000), 3);
  assert.equal(rate.perSecond(2400), 2);
  assert.equal(rate.perSecond(9000), 0);
});

test("a median is of the last figures alone", () => {
  const median = new Median();
  for (let figure = 0; figure < 100; figure++) median.add(figure);
  assert.equal(median.get(), 84);
});
