/** The page's person against the program's own pictures: one recorded run, its frames, the same viewpoint. */
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { overlap } from "../feeder/person.ts";
import { decoded, launch, open, picture, PROGRAM, Program, state, steer, until } from "./browser.ts";

/** Physics steps a second. */
const STEPS_PER_S = 120;
/** Everything but the person is blue in the program's pictures, bodies too: a person is where red wins. */
const SCENE = `
[stage]
motion = "sweep"
props = []

[floor]
height = 0.0

[[bodies]]
name = "away"
shape.box.size = [0.2, 0.2, 0.2]
place.stack.foot = [-1.9, 0.0, -1.9]
density = 80.0
color = [0.2, 0.3, 0.6]
`;

/** A picture that the program took: from where, and of which frame. */
interface Taken {
  readonly film_s: number;
  readonly frame: number;
  readonly view: { readonly size: [number, number]; readonly matrix: number[][]; readonly rotation: number[][]; readonly translation: number[] };
  readonly png: Buffer;
}

let folder: string;
let browser: Browser;
let program: Program | undefined;
let pictures: Taken[];

before(async () => {
  if (!PROGRAM) return;
  folder = mkdtempSync(join(tmpdir(), "hulltouch-march-"));
  const path = (name: string) => join(folder, name);
  writeFileSync(path("scene.toml"), SCENE);
  run("record", path("run.mcap"), "--scene", path("scene.toml"), "--seconds", "3", "--unpaced", "--colour");
  run("replay", path("run.mcap"), "--unpaced", "--headless", "--snapshot", path("pictures"), "--json", path("run.json"));
  const files = readdirSync(path("pictures")).sort();
  const told: Omit<Taken, "png">[] = JSON.parse(readFileSync(path("run.json"), "utf8")).hull_overlap;
  assert.equal(files.length, told.length);
  pictures = told.map((each, index) => ({ ...each, png: readFileSync(join(path("pictures"), files[index])) }));
  browser = await launch();
  program = await Program.start([path("run.mcap"), "--listen", "127.0.0.1:0"], "replay");
  // Before a browser is there: the recording is short.
  await steer(program, "pause");
});
after(async () => {
  await browser?.close();
  await program?.stop();
  if (folder) rmSync(folder, { recursive: true });
});

function run(...args: string[]): void {
  const done = spawnSync(PROGRAM!, args, { encoding: "utf8" });
  assert.equal(done.status, 0, `${args.join(" ")}: ${done.error ?? done.stderr}`);
}

/** Where the person is in a picture of the program. */
async function personIn(page: Page, taken: Taken): Promise<Uint8Array> {
  const { rgba, width, height } = await decoded(page, taken.png);
  return Uint8Array.from({ length: width * height }, (_, i) => (rgba[i * 4] > rgba[i * 4 + 2] ? 1 : 0));
}

test("the page's outline is that of the program's own ray-march", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, async (t) => {
  const { page, complaints } = await open(browser, program!.viewers);
  const blank = await browser.newPage();
  for (const taken of pictures) {
    const { step } = await until(page, "a world that stands", ({ step, paused }) => step !== null && paused);
    const ahead = Math.round(taken.film_s * STEPS_PER_S) - step;
    assert.ok(ahead > 0, `the replay was held too late: at step ${step}`);
    await steer(program!, "step", { steps: ahead });
    await until(page, `frame ${taken.frame}`, ({ frame }) => frame === taken.frame);
    const { size, matrix, rotation, translation } = taken.view;
    const from = { rotation, translation, pinhole: [matrix[0][0], matrix[1][1], matrix[0][2], matrix[1][2]] };
    const shown = await picture(page, from, size[0], size[1], "shaded");
    assert.equal(shown.frame, taken.frame);
    const drawn = await personIn(blank, taken);
    const share = drawn.reduce((sum, one) => sum + one, 0) / drawn.length;
    assert.ok(share > 0.02 && share < 0.6, `the program's picture shows a person on ${share} of it`);
    const found = overlap(shown.mask, drawn);
    t.diagnostic(`frame ${taken.frame}: overlap ${found.toFixed(4)}`);
    assert.ok(found >= 0.98, `frame ${taken.frame}: overlap ${found.toFixed(4)}`);
  }
  assert.deepEqual((await state(page)).paused, true);
  assert.deepEqual(complaints, []);
});
