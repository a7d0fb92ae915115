/** The sources' imports, types included: no file needs itself, however many files are between. */
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

const SOURCES = join(dirname(dirname(dirname(dirname(fileURLToPath(import.meta.url))))), "src");

test("there are no circles of imports", () => {
  const files = readdirSync(SOURCES, { recursive: true, encoding: "utf8" }).filter((name) => name.endsWith(".ts"));
  assert.ok(files.length > 40, `${files.length} sources`);
  const imports = new Map(files.map((name) => [name, importsOf(name)]));
  const circles: string[] = [];
  const done = new Set<string>();
  const follow = (name: string, path: readonly string[]): void => {
    if (path.includes(name)) circles.push([...path.slice(path.indexOf(name)), name].join(" > "));
    else if (!done.has(name)) {
      for (const next of imports.get(name) ?? []) follow(next, [...path, name]);
      done.add(name);
    }
  };
  for (const name of files) follow(name, []);
  assert.deepEqual(circles, []);
});

function importsOf(name: string): string[] {
  const text = readFileSync(join(SOURCES, name), "utf8");
  return [...text.matchAll(/(?:from |import\(|new URL\()"(\.[^"]+\.ts)"/g)].map((found) => relative(SOURCES, join(SOURCES, dirname(name), found[1])));
}
