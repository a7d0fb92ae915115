/** What is drawn of the person's surface at bodies. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { type InstancedMesh, Matrix4, Vector3 } from "three";
import type { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { Patches } from "../../src/draw/patches.ts";

const near = (a: Vector3, b: readonly number[]) => assert.ok(a.distanceTo(new Vector3(...b)) < 1e-6, `${a.toArray()}, expected ${b}`);
const numbers = (normal: readonly number[], velocity: readonly number[], radius: number) => [3, 25, 1, 2, 3, ...normal, ...velocity, 0.001, radius];

function drawn(...patches: number[][]) {
  const shown = new Patches();
  shown.show(Float32Array.from(patches.flat()));
  const [discs, normals, arrows] = shown.group.children as [InstancedMesh, LineSegments2, LineSegments2];
  const end = (lines: LineSegments2, at: number) => new Vector3().fromBufferAttribute(lines.geometry.getAttribute(at % 2 === 0 ? "instanceStart" : "instanceEnd"), Math.floor(at / 2));
  const onDisc = (disc: number, x: number, y: number) => {
    const place = new Matrix4();
    discs.getMatrixAt(disc, place);
    return new Vector3(x, y, 0).applyMatrix4(place);
  };
  return { shown, discs, normals, arrows, end, onDisc };
}

test("a disc lies in the surface, as wide as its samples", () => {
  for (const normal of [[0, 1, 0], [1, 0, 0], [0.6, 0, -0.8], [0, -0.8, 0.6]]) {
    const { discs, onDisc } = drawn(numbers(normal, [0, 0, 0], 0.125));
    assert.equal(discs.count, 1);
    near(onDisc(0, 0, 0), [1, 2, 3]);
    for (const [x, y] of [[1, 0], [0, 1], [-0.6, 0.8]]) {
      const rim = onDisc(0, x, y).sub(new Vector3(1, 2, 3));
      assert.ok(Math.abs(rim.length() - 0.125) < 1e-6 && Math.abs(rim.dot(new Vector3(...normal))) < 1e-6, `${normal}: ${rim.toArray()}`);
    }
  }
});

test("a disc of one sample is eight centimetres wide, and none is without bounds", () => {
  const { onDisc } = drawn(numbers([0, 1, 0], [0, 0, 0], 0), numbers([0, 1, 0], [0, 0, 0], 1e30));
  const radius = (disc: number) => onDisc(disc, 1, 0).distanceTo(onDisc(disc, 0, 0));
  assert.deepEqual([radius(0).toFixed(6), radius(1).toFixed(6)], ["0.040000", "1.000000"]);
});

test("normals are eight centimetres long, speeds a quarter of a second", () => {
  const { shown, normals, arrows, end } = drawn(numbers([0, 1, 0], [0, 0, 0], 0.1), numbers([0, 0, 1], [0.5, 0, 0.2], 0.1));
  assert.deepEqual([shown.count, normals.geometry.instanceCount, arrows.geometry.instanceCount], [2, 2, 3]);
  near(end(normals, 1), [1, 2.08, 3]);
  near(end(normals, 3), [1, 2, 3.08]);
  near(end(arrows, 0), [1, 2, 3]);
  near(end(arrows, 1), [1.125, 2, 3.05]);
});

test("without patches nothing is drawn", () => {
  const { shown, discs, normals, arrows } = drawn(numbers([0, 1, 0], [1e20, 0, 0], 0.1));
  shown.show(new Float32Array(0));
  assert.deepEqual([shown.count, discs.count, normals.geometry.instanceCount, arrows.geometry.instanceCount], [0, 0, 0, 0]);
  assert.equal((shown.group.children[3] as InstancedMesh).count, 0, "rims");
});
