import assert from "node:assert/strict";
import { test } from "node:test";
import { hullBox } from "../../src/decode/hull_box.ts";
import { distanceField, Scratch } from "../../src/feed/distance.ts";
import { decodeRuns } from "../../src/feed/runs.ts";
import { camera, type CameraText, normalised, pointAt, project } from "../../src/view/lens.ts";
import { ringOfCameras, silhouetteOf } from "../feeder/person.ts";
import { encodeRuns } from "../feeder/write.ts";

const wide: CameraText = {
  name: "wide",
  width: 640,
  height: 480,
  matrix: [[400, 2, 330], [0, 405, 236], [0, 0, 1]],
  distortions: [-0.28, 0.09, 0.001, -0.0015, -0.01],
  rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  translation: [0, 0, 2],
  max_radius: null,
};

test("pixels become rays and rays the same pixels", () => {
  const made = camera(wide, 0);
  for (let u = 10; u < 640; u += 60) {
    for (let v = 10; v < 480; v += 50) {
      const n = normalised(made, u, v);
      assert.ok(n);
      const [x, y, depth] = project(made, ...pointAt(made, n[0], n[1], 3.5))!;
      assert.ok(Math.abs(x - u) < 1e-6 && Math.abs(y - v) < 1e-6 && Math.abs(depth - 3.5) < 1e-9, `${u}, ${v}: ${x}, ${y}`);
    }
  }
});

test("nothing is seen behind the camera or beyond the lens's fold", () => {
  const made = camera({ ...wide, distortions: [-0.3, 0, 0, 0, 0], max_radius: Math.sqrt(1 / 0.9) }, 0);
  assert.equal(project(made, 0, 0, -3), null);
  assert.equal(project(made, 6, 0, 1), null);
  assert.ok(project(made, 0.5, 0, 1));
});

test("no two points move farther apart in the image than the bound says", () => {
  const made = camera(wide, 0);
  for (let u = 20; u < 640; u += 37) {
    for (let v = 20; v < 480; v += 41) {
      const a = normalised(made, u, v)!;
      for (const [du, dv] of [[3, 0], [0, 3], [2, 2]]) {
        const b = normalised(made, u + du, v + dv)!;
        const moved = Math.hypot(du, dv);
        assert.ok(moved <= made.pixelsPerUnit * Math.hypot(b[0] - a[0], b[1] - a[1]) * 1.0001, `${u}, ${v}`);
      }
    }
  }
});

test("the box around the hull holds the person, and is not much larger", () => {
  const cameras = ringOfCameras(6, 320, 240).map(camera);
  const seen = cameras.map((each) => {
    const runs = decodeRuns(encodeRuns(silhouetteOf(each, 0), each.width, each.height), each.width, each.height);
    return { camera: each, field: distanceField(runs, true, 1, new Scratch()) };
  });
  const box = hullBox({ low: [-1.5, 0, -1.5], high: [1.5, 2.2, 1.5] }, seen, true)!;
  // The person's own extent, and what a hull of six cameras adds to it.
  assert.ok(box.high[1] > 1.7 && box.high[1] < 2.0, `top ${box.high[1]}`);
  assert.ok(box.low[0] < -0.25 && box.low[0] > -1.1 && box.high[0] > 0.25 && box.high[0] < 1.1, `${box.low[0]} to ${box.high[0]}`);
});

test("there is no box where a camera sees no person", () => {
  const cameras = ringOfCameras(2, 320, 240).map(camera);
  const seen = cameras.map((each, index) => {
    const runs = decodeRuns(encodeRuns(silhouetteOf(each, 0), each.width, each.height), each.width, each.height);
    return { camera: each, field: index === 0 ? null : distanceField(runs, true, 1, new Scratch()) };
  });
  assert.equal(hullBox({ low: [-1.5, 0, -1.5], high: [1.5, 2.2, 1.5] }, seen, true), null);
});
