/** The built page as it travels. */
import assert from "node:assert/strict";
import { readdirSync, readFileSync, statSync } from "node:fs";
import { dirname, join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { brotliDecompressSync, gunzipSync } from "node:zlib";

const DIST = join(dirname(dirname(dirname(dirname(fileURLToPath(import.meta.url))))), "dist");
/** A first visit over a link of 400 kbit/s is to leave time for a person within six seconds. */
const MOST_BYTES = 190_000;

const files = readdirSync(DIST, { recursive: true, encoding: "utf8" }).filter((name) => statSync(join(DIST, name)).isFile());
const plain = files.filter((name) => !/\.(br|gz)$/.test(name));

test("every file of the page lies compressed beside it, and nothing else does", () => {
  assert.ok(plain.includes("index.html"));
  assert.deepEqual(files.toSorted(), plain.flatMap((name) => [name, `${name}.br`, `${name}.gz`]).toSorted());
  for (const name of plain) {
    const bytes = readFileSync(join(DIST, name));
    assert.ok(brotliDecompressSync(readFileSync(join(DIST, `${name}.br`))).equals(bytes), `${name}.br is of another build`);
    assert.ok(gunzipSync(readFileSync(join(DIST, `${name}.gz`))).equals(bytes), `${name}.gz is of another build`);
  }
});

test("a first visit transfers little", () => {
  const visited = plain.filter((name) => name !== "licences.txt");
  const bytes = visited.reduce((sum, name) => sum + statSync(join(DIST, `${name}.br`)).size, 0);
  assert.ok(bytes < MOST_BYTES, `${bytes} bytes, expected fewer than ${MOST_BYTES}`);
});
