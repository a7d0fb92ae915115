/** A recorded run on the page: the person and the bodies that were recorded, how it is played, and how it ends. */
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { goOn, launch, open, picture, PROGRAM, Program, state, steer, until, untilStanding, type Watched } from "./browser.ts";

/** What browsers say of a server that is gone. */
const GONE = [/WebSocket connection to/, /ERR_CONNECTION_REFUSED/];
const SECONDS = 5;

interface Recorded {
  readonly name: string;
  readonly end: readonly number[];
}

const distance = (a: readonly number[], b: readonly number[]) => Math.hypot(...a.map((n, i) => n - b[i]));

/** The share of a picture from the page's own view that shows the person. */
async function personShare(page: Page): Promise<number> {
  const { mask } = await picture(page, { camera: 0 }, 160, 120, "photo");
  return mask.reduce((sum, one) => sum + one, 0) / mask.length;
}

/** Records a run in a folder; its file, and the bodies that it ended with. */
function record(folder: string): { file: string; bodies: Recorded[] } {
  const [file, json] = [join(folder, "run.mcap"), join(folder, "run.json")];
  const made = spawnSync(PROGRAM!, ["record", file, "--seconds", String(SECONDS), "--unpaced", "--colour", "--json", json], { encoding: "utf8" });
  assert.equal(made.status, 0, `${made.error ?? made.stderr}`);
  return { file, bodies: JSON.parse(readFileSync(json, "utf8")).bodies };
}

/** A replay that is held before there is a browser, at a step that has seen film. */
async function replay(...args: string[]): Promise<Program> {
  const program = await Program.start([...args, "--listen", "127.0.0.1:0"], "replay");
  await steer(program, "pause");
  await steer(program, "step", { steps: 12 });
  return program;
}

/** The bodies on the page are where they were recorded at the end. */
function areAtEnd(bodies: readonly { name: string; position: readonly number[] }[], recorded: readonly Recorded[]): void {
  for (const { name, end } of recorded) {
    const body = bodies.find((each) => each.name === name);
    assert.ok(body && distance(body.position, end) < 0.1, `${name} is at ${body?.position}, was at ${end}`);
  }
}

async function exitCode(program: Program): Promise<number | null> {
  return program.child.exitCode ?? new Promise((done) => program.child.once("exit", done));
}

describe("a recording", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let folder: string;
  let recorded: Recorded[];
  let browser: Browser;
  let program: Program;
  let watched: Watched;
  let page: Page;
  const place = () => page.getByRole("slider", { name: "Place in the recording" });
  const loop = () => page.getByRole("button", { name: "Begin again at the end" });
  /** Moves the slider, and waits until the world and the person of there are shown. */
  const seek = async (filmS: number) => {
    await place().fill(String(filmS));
    await until(page, `the world at ${filmS} s`, ({ step, paused }) => paused && step === Math.round(120 * filmS));
    return untilStanding(page);
  };
  before(async () => {
    folder = mkdtempSync(join(tmpdir(), "hulltouch-replay-"));
    const made = record(folder);
    recorded = made.bodies;
    browser = await launch();
    program = await replay(made.file);
    watched = await open(browser, program.page, { viewport: { width: 960, height: 600 } }, GONE);
    page = watched.page;
  });
  after(async () => {
    await browser?.close();
    await program?.stop();
    if (folder) rmSync(folder, { recursive: true });
  });

  test("is held and gone on with, and takes no other command", async () => {
    const held = await until(page, "a person, standing", ({ framesShown, paused, bodies }) => framesShown > 0 && paused && bodies.length > 0);
    assert.deepEqual(new Set(held.bodies.map(({ name }: { name: string }) => name)), new Set(recorded.map(({ name }) => name)));
    const told = () => page.locator("#figures dt, #figures dd").allTextContents();
    let figures = await told();
    for (; !figures[figures.indexOf("Film") + 1]?.endsWith(" s"); figures = await told()) await page.waitForTimeout(50);
    assert.equal(figures[0], "From lens to screen");
    for (const live of ["From lens to screen", "From lens to step", "Frames missed", "Late steps"]) {
      assert.equal(figures[figures.indexOf(live) + 1], "–", `a recording has no ${live}`);
    }
    assert.ok(await page.getByText("A recorded run").isVisible());
    assert.ok(await page.getByRole("button", { name: "Restart" }).isDisabled());
    assert.ok(await page.getByRole("button", { name: "Drop from above" }).isDisabled());
    await page.getByRole("button", { name: "Step" }).click();
    await until(page, "one step", ({ step }) => step === held.step + 1);
    // As many by key as are made of two frames: the person goes on with the bodies.
    for (let more = 2; more < 10; more++) {
      await page.keyboard.press(".");
      await until(page, "a step more", ({ step }) => step === held.step + more);
    }
    const stepped = await untilStanding(page);
    assert.ok(stepped.frame > held.frame, `frame ${stepped.frame} of the person, ${held.frame} before nine steps`);
    // It waits for no page, however slow: it goes on as far as is looked at.
    for (let part = 0; part < 6; part++) {
      const { step } = await untilStanding(page);
      await steer(program, "step", { steps: 20 });
      await until(page, "twenty steps", (now) => now.step === step + 20);
    }
    const there = await untilStanding(page);
    assert.ok(there.frame > held.frame + 20 && there.framesShown > held.framesShown + 3);
    assert.ok(there.cameras === 8 && (await personShare(page)) > 0.02, "the person is there");
  });

  test("is a slider from its beginning to its end, and is as it was wherever that is moved", async () => {
    assert.ok(await page.locator("#live").isHidden(), "nothing of it is live");
    const early = await seek(0.5);
    await page.locator("#behind", { hasText: "0:00.5 / 0:05" }).waitFor();
    const late = await seek(3);
    await page.locator("#behind", { hasText: "0:03.0 / 0:05" }).waitFor();
    assert.ok(late.frame > early.frame + 60 && (await personShare(page)) > 0.02, "the person of then");
    const again = await seek(0.5);
    assert.ok(again.generation > late.generation, "the run was begun again");
    assert.equal(again.frame, early.frame);
    const positions = ({ bodies }: Record<string, any>) => bodies.map(({ position }: { position: number[] }) => position);
    assert.deepEqual(positions(again), positions(early));
    assert.notDeepEqual(positions(late), positions(early));
  });

  test("is sought by keys, half a second or a frame at a time", async () => {
    await seek(0.5);
    await place().focus();
    await page.keyboard.press("ArrowRight");
    await until(page, "half a second on", ({ step }) => step === 120);
    assert.equal(await place().getAttribute("aria-valuetext"), "0:01.0 of 0:05");
    await page.keyboard.press("]");
    await until(page, "a frame on", ({ step }) => step === 127);
    await page.keyboard.press("[");
    await until(page, "a frame back", ({ step }) => step === 123);
    await page.keyboard.press("Home");
    await until(page, "the first step", ({ step }) => step === 1);
  });

  test("is played as fast as is chosen, again and again", async () => {
    const { generation } = await seek(3);
    await page.getByLabel("Speed", { exact: true }).selectOption("4");
    await loop().click();
    await page.locator("#loop[aria-pressed=true]").waitFor();
    await goOn(page);
    await until(page, "it begins again", (now) => now.generation > generation && now.step < 500 && !now.paused);
    const since = performance.now();
    const from = await state(page);
    const on = await until(page, "a second of film", ({ step, generation: now }) => step > from.step + 120 || now > from.generation);
    assert.ok(on.paused === false && performance.now() - since < 60_000);
    await loop().click();
    await page.locator("#loop[aria-pressed=false]").waitFor();
  });

  test("stays at its end while its page is open, says so, and is played again", async () => {
    await page.locator("#banner", { hasText: "The recording has ended. It can be played again." }).waitFor({ state: "visible" });
    assert.equal(await page.locator("#link-text").textContent(), "Ended");
    const end = await untilStanding(page);
    assert.equal(end.step, 120 * SECONDS);
    areAtEnd(end.bodies, recorded);
    assert.ok((await personShare(page)) > 0.02, "the person is still there");
    await page.waitForTimeout(4000);
    assert.equal(program.child.exitCode, null, "its page is open");
    await page.getByLabel("Speed", { exact: true }).selectOption("0.5");
    await page.getByRole("button", { name: "Play the recording" }).click();
    await until(page, "it is played again", ({ step, paused }) => step < 120 * SECONDS && !paused);
    await page.locator("#banner").waitFor({ state: "hidden" });
  });

  test("is over when its page has gone", async () => {
    assert.deepEqual(watched.complaints, []);
    await page.close();
    assert.equal(await exitCode(program), 0, "each step was as recorded");
  });
});

describe("a recording that is played once, for a viewer", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let folder: string;
  let recorded: Recorded[];
  let browser: Browser;
  let program: Program;
  let watched: Watched;
  let page: Page;
  /** Everything on the console. */
  const printed: string[] = [];
  before(async () => {
    folder = mkdtempSync(join(tmpdir(), "hulltouch-once-"));
    const made = record(folder);
    recorded = made.bodies;
    browser = await launch();
    program = await replay(made.file, "--once");
    watched = await open(browser, program.viewers, { viewport: { width: 960, height: 600 } }, GONE);
    page = watched.page;
    page.on("console", (message) => printed.push(message.text()));
  });
  after(async () => {
    await browser?.close();
    await program?.stop();
    if (folder) rmSync(folder, { recursive: true });
  });

  test("is looked back at while it goes on", async () => {
    for (let part = 0; part < 6; part++) {
      const { step } = await untilStanding(page);
      await steer(program, "step", { steps: 20 });
      await until(page, "twenty steps", (now) => now.step === step + 20);
    }
    const before = await until(page, "something to look back at", ({ timelineFrames }) => timelineFrames > 4);
    assert.ok(await page.locator("#loop").isHidden(), "a viewer plays nothing");
    const texts = await page.evaluateHandle(() => {
      const said: string[] = [];
      const line = document.getElementById("link-text")!;
      new MutationObserver(() => said.push(line.textContent!)).observe(line, { childList: true, characterData: true, subtree: true });
      return said;
    });
    await steer(program, "resume");
    await until(page, "it goes on", ({ step }) => step > before.step);
    await page.locator("#scrub").fill("-1000");
    await until(page, "the past", ({ live, frame }) => !live && frame < before.frame);
    await until(page, "the recording goes on meanwhile", ({ step }) => step > before.step + 60);
    await page.getByRole("button", { name: "Live", exact: true }).click();
    await until(page, "the newest again", ({ live, frame }) => live && frame > before.frame);
    const said = await texts.jsonValue();
    assert.ok(said.some((text) => text.startsWith("Recorded")), `it said ${said.join(", ")}`);
  });

  test("says that it is over, and leaves its last picture", async () => {
    await page.locator("#banner", { hasText: "The recording has ended." }).waitFor({ state: "visible" });
    assert.equal(await page.locator("#link-text").textContent(), "Ended");
    assert.equal(await exitCode(program), 0, "each step was as recorded");
    // A busy machine is behind with drawing.
    const end = await until(page, "its last picture", ({ link, frame, timelineFrame }) => !link && frame === timelineFrame);
    areAtEnd(end.bodies, recorded);
    assert.ok((await personShare(page)) > 0.02, "the person is still there");
  });

  test("can be looked back at when it is over", async () => {
    const end = await state(page);
    await page.locator("#scrub").fill("-1000");
    await until(page, "the past", ({ live, frame }) => !live && frame < end.frame);
    assert.ok((await personShare(page)) > 0.02, "the person of then");
    // Trying to find the program again must not hide how it ended.
    const failed = () => printed.filter((text) => /WebSocket connection to .* failed/.test(text)).length;
    await until(page, "attempts in vain", () => failed() >= 2);
    assert.match((await page.locator("#banner").textContent())!, /^The recording has ended/);
    await page.getByRole("button", { name: "Live", exact: true }).click();
    await until(page, "the last picture again", ({ live, frame, isGrey }) => live && frame === end.frame && !isGrey);
  });

  test("nothing was complained of", () => assert.deepEqual(watched.complaints, []));
});
