import assert from "node:assert/strict";
import { test } from "node:test";
import { besideFrame, FilmSlider, lengthText, placeByKey, placeText, SEEK_EVERY_MS } from "../../src/time/film.ts";

const at = (filmS: number, isSeeking = false) => ({ filmS, isSeeking });

test("the slider follows the world until it is moved, and then again once the world is there", () => {
  const slider = new FilmSlider();
  assert.equal(slider.place(at(1.5), 0), 1.5);
  assert.equal(slider.move(8, 1000), 8);
  assert.equal(slider.place(at(1.6), 1100), 8, "the world is not there yet");
  assert.equal(slider.place(at(1.6, true), 5000), 8, "however long a seek takes");
  assert.equal(slider.place(at(8.01), 5100), 8.01);
  assert.equal(slider.place(at(9), 5200), 9);
});

test("a place that the world has passed, or never comes to, is given up", () => {
  const slider = new FilmSlider();
  slider.move(8, 1000);
  assert.equal(slider.place(at(2), 1900), 8);
  assert.equal(slider.place(at(2), 2100), 2);
});

test("while it is dragged ten seeks a second are sent, and the last place always", () => {
  const slider = new FilmSlider();
  slider.hold();
  const sent: [number, number][] = [];
  const note = (ms: number, place: number | null) => place !== null && sent.push([ms, place]);
  for (let ms = 0; ms < 1000; ms += 10) note(ms, slider.move(ms / 100, ms));
  assert.deepEqual(sent.map(([ms]) => ms), [0, 100, 200, 300, 400, 500, 600, 700, 800, 900]);
  assert.equal(slider.place(at(9.9), 995), 9.9, "the viewer has it in hand");
  assert.equal(slider.isHeld, true);
  assert.equal(slider.release(995), 9.9, "the last place is sought at once");
  assert.equal(slider.release(996), null, "once");
  assert.equal(slider.isHeld, false);
});

test("a place that was moved to too soon after another is sought when it is time", () => {
  const slider = new FilmSlider();
  assert.equal(slider.move(1, 0), 1);
  assert.equal(slider.move(2, 20), null);
  assert.equal(slider.move(3, 40), null);
  assert.equal(slider.due(SEEK_EVERY_MS - 1), null);
  assert.equal(slider.due(SEEK_EVERY_MS), 3, "the newest alone");
  assert.equal(slider.due(10 * SEEK_EVERY_MS), null);
});

test("keys move it, and never beyond its ends", () => {
  assert.equal(placeByKey("ArrowRight", 1, 60), 1.5);
  assert.equal(placeByKey("ArrowDown", 1, 60), 0.5);
  assert.equal(placeByKey("ArrowLeft", 0.2, 60), 0);
  assert.equal(placeByKey("PageUp", 58, 60), 60);
  assert.equal(placeByKey("PageDown", 58, 60), 53);
  assert.deepEqual([placeByKey("Home", 3, 60), placeByKey("End", 3, 60.25)], [0, 60.25]);
  assert.equal(placeByKey("a", 3, 60), null);
});

test("a frame back and a frame on are a frame away, wherever in a frame it stands", () => {
  const near = (found: number, expected: number) => assert.ok(Math.abs(found - expected) < 1e-9, `${found}, expected ${expected}`);
  near(besideFrame(1.0, 1, 30, 60), 32 / 30 - 1e-6);
  near(besideFrame(1.02, -1, 30, 60), 30 / 30 - 1e-6);
  near(besideFrame(29 / 30, -1, 30, 60), 29 / 30 - 1e-6);
  assert.deepEqual([besideFrame(0, -1, 30, 60), besideFrame(60, 1, 30, 60)], [0, 60]);
  // A run stands at the last of its 120 steps a second that is not after a place; that step sees the frame of its time.
  for (const fps of [25, 29.97, 30, 50, 60]) {
    const seen = (place: number) => Math.floor((Math.floor(place * 120 + 1e-6) / 120) * fps + 1e-6);
    let place = 0.5;
    for (const direction of [1, 1, 1, -1, -1, -1, -1] as const) {
      const before = seen(place);
      place = Math.floor(besideFrame(place, direction, fps, 60) * 120 + 1e-6) / 120;
      assert.equal(seen(place), before + direction, `${fps} frames/s`);
    }
  }
});

test("times are minutes, seconds and tenths; a length has no tenths", () => {
  assert.deepEqual([0, 0.3, 9.96, 59.99, 60, 61.25, 3600].map(placeText), ["0:00.0", "0:00.3", "0:09.9", "0:59.9", "1:00.0", "1:01.2", "60:00.0"]);
  assert.deepEqual([2.008, 59.7, 125].map(lengthText), ["0:02", "1:00", "2:05"]);
});
