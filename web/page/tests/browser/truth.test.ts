/** The page's person against the studio's own truth, from views that no camera has, live. */
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import type { CameraText } from "../../src/view/lens.ts";
import { looking, overlap } from "../feeder/person.ts";
import { launch, open, picture, PROGRAM, Program, state, steer, until, type Watched, within } from "./browser.ts";

const SIDE = 240;
const FOCAL = 300;
const FPS = 10;
/** Between cameras: they stand every 45 degrees. */
const VIEWS = [0.39, 2.75, 4.32].map((angle, index) => ({
  name: `between_${index}`,
  ...looking([2.6 * Math.sin(angle), 1.0 + 0.3 * index, 2.6 * Math.cos(angle)], [0, 0.95, 0]),
}));

let browser: Browser;
let program: Program;
let watched: Watched;
before(async () => {
  browser = await launch();
  program = await Program.start(["--headless", "--listen", "127.0.0.1:0", "--fps", String(FPS), "--scene", "topple"]);
  watched = await open(browser, `${program.viewers}#mode=photo`);
  // A busy machine without a graphics card would settle for half the colours.
  await watched.page.evaluate(() => {
    const quality = document.querySelector<HTMLSelectElement>("#quality")!;
    quality.value = "high";
    quality.dispatchEvent(new Event("change"));
  });
  await until(watched.page, "frames with all colours", ({ framesShown, colours }) => framesShown > 5 && colours === "full");
  const shown = (await state(watched.page)).framesShown;
  await until(watched.page, "some more of them", ({ framesShown }) => framesShown > shown + 5);
});
after(async () => {
  await browser?.close();
  await program?.stop();
});

type Mat3 = readonly (readonly number[])[];

/** The axis times the angle of a rotation. */
function rodrigues(r: Mat3): number[] {
  const axis = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
  const sine = Math.hypot(...axis) / 2;
  const angle = Math.atan2(sine, (r[0][0] + r[1][1] + r[2][2] - 1) / 2);
  assert.ok(sine > 1e-6, "a view that is neither straight nor turned about");
  return axis.map((part) => (part / (2 * sine)) * angle);
}

/** What the truth's program is told of a view. */
interface Section {
  readonly name: string;
  readonly size: readonly [number, number];
  readonly matrix: Mat3;
  readonly distortions: readonly number[];
  readonly rotation: Mat3;
  readonly translation: readonly number[];
}

/** The studio's truth of a frame: masks and colours of all views. */
function truth(frame: number, views: readonly Section[]): { mask: Uint8Array; rgb: Uint8Array }[] {
  const folder = mkdtempSync(join(tmpdir(), "hulltouch-truth-"));
  try {
    const sections = views.map(
      (view) =>
        `[${view.name}]\nname = "${view.name}"\nsize = [${view.size.join(", ")}]\nmatrix = ${floats(view.matrix)}\ndistortions = ${floats(view.distortions)}\nrotation = ${floats(rodrigues(view.rotation))}\ntranslation = ${floats(view.translation)}\n`,
    );
    writeFileSync(join(folder, "rig.toml"), sections.join("\n"));
    const program = join(dirname(PROGRAM!), "examples", "truth");
    const made = spawnSync(program, [join(folder, "rig.toml"), folder, "sweep", String(FPS), String(frame)], { encoding: "utf8" });
    assert.equal(made.status, 0, `${program}: ${made.error ?? made.stderr}`);
    const read = (name: string, ending: string) => new Uint8Array(readFileSync(join(folder, `${name}.${ending}`)));
    return views.map(({ name }) => ({ mask: read(name, "mask").map((value) => (value ? 1 : 0)), rgb: read(name, "rgb") }));
  } finally {
    rmSync(folder, { recursive: true });
  }
}

/** As TOML has them: numbers with a point. */
function floats(value: readonly number[] | Mat3): string {
  return JSON.stringify(value, (_, part) => (typeof part === "number" ? `#${part.toFixed(12)}#` : part)).replaceAll('"#', "").replaceAll('#"', "");
}

/** The share that both have of what either has, and the mean difference of colours where both are, of 255. */
function compare(shown: { mask: Uint8Array; rgba: Uint8Array }, { mask: person, rgb }: { mask: Uint8Array; rgb: Uint8Array }): { overlapped: number; error: number } {
  let [sum, count] = [0, 0];
  for (let i = 0; i < person.length; i++) {
    if (!person[i] || !shown.mask[i]) continue;
    for (let c = 0; c < 3; c++) sum += Math.abs(rgb[i * 3 + c] - shown.rgba[i * 4 + c]);
    count += 3;
  }
  return { overlapped: overlap(shown.mask, person), error: sum / Math.max(count, 1) };
}

test("from every side the outline and the colours are the person's", async (t) => {
  // The run stands at one frame, so that all pictures are of it however long they take. A busy machine may drop a frame before it was fetched.
  for (let tries = 0; ; tries++) {
    assert.ok(tries < 10, "the page never shows the frame at which the run is paused");
    await steer(program, "pause");
    if (await within(watched.page, 10_000, ({ paused, frame, worldFrame }) => paused && frame !== null && frame === worldFrame)) break;
    await steer(program, "resume");
    await until(watched.page, "the world goes on", ({ paused }) => !paused);
  }
  const between = VIEWS.map((view): Section => ({
    name: view.name,
    size: [SIDE, SIDE],
    matrix: [[FOCAL, 0, (SIDE - 1) / 2], [0, FOCAL, (SIDE - 1) / 2], [0, 0, 1]],
    distortions: [0, 0, 0, 0, 0],
    rotation: view.rotation as Mat3,
    translation: view.translation,
  }));
  const pinhole = [FOCAL, FOCAL, (SIDE - 1) / 2, (SIDE - 1) / 2];
  const rig: readonly CameraText[] = await watched.page.evaluate(() => (window as any).hulltouch.rig());
  const cameras = rig.map((camera): Section => ({ ...camera, size: [camera.width, camera.height] }));
  const taken: Awaited<ReturnType<typeof picture>>[] = [];
  for (const [index, { size }] of cameras.entries()) taken.push(await picture(watched.page, { camera: index }, size[0], size[1]));
  for (const view of between) taken.push(await picture(watched.page, { rotation: view.rotation, translation: view.translation, pinhole }, SIDE, SIDE));
  assert.ok(taken.every(({ frame }) => frame !== null && frame === taken[0].frame), "pictures of one frame");
  // The cameras first: then the truth has their very noise.
  const views = [...cameras, ...between];
  const truths = truth(taken[0].frame!, views);
  for (const [index, { name }] of views.entries()) {
    const { overlapped, error } = compare(taken[index], truths[index]);
    t.diagnostic(`${name}: overlap ${overlapped.toFixed(4)}, colours differ by ${error.toFixed(2)} of 255`);
    const isCamera = index < cameras.length;
    assert.ok(overlapped >= (isCamera ? 0.98 : 0.9), `${name}: overlap ${overlapped.toFixed(4)}`);
    assert.ok(error <= (isCamera ? 10 : 12), `${name}: colours differ by ${error.toFixed(2)}`);
  }
});
