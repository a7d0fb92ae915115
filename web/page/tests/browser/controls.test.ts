/** Keys, lists and layers over a film that is known: what a show needs to be relied on. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { BodyText } from "../../src/feed/text.ts";
import { type Feeder, serve } from "../feeder/server.ts";
import { DIST, launch, open, screen, state, until } from "./browser.ts";
import { known } from "./film.ts";

const BOX: BodyText = { id: 3, name: "box", color: [1, 0.1, 0.1], fixed: false, shape: { box: { size: [0.4, 0.4, 0.4] } } };

describe("controls", () => {
  let browser: Browser;
  let feeder: Feeder;
  let page: Page;
  before(async () => {
    browser = await launch();
    const { film } = await known(browser, { bent: false, outside: true, colour: true });
    feeder = await serve(film, DIST, [BOX]);
    ({ page } = await open(browser, `${feeder.address}?token=${feeder.token}#mode=shaded`, { viewport: { width: 960, height: 600 } }));
    await until(page, "a first frame", ({ framesShown, controller }) => framesShown > 0 && controller);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });

  const pixels = () => screen(page);

  /** How many pixels differ left of the panel, below the title and above the timeline. */
  function differing(a: { width: number; rgba: Uint8Array }, b: { rgba: Uint8Array }): number {
    let count = 0;
    for (let y = 60; y < 530; y++) {
      for (let x = 0; x < 620; x++) count += Number(Math.abs(a.rgba[4 * (y * a.width + x)] - b.rgba[4 * (y * a.width + x)]) > 2);
    }
    return count;
  }

  /** Waits for pictures of what is set now: frames go on coming, of a person who stands. */
  async function drawn(): Promise<void> {
    const { pictures } = await state(page);
    await until(page, "some pictures", (now) => now.pictures > pictures + 2);
  }

  test("Space pauses, whatever was clicked before", async () => {
    for (const pressed of [page.getByRole("button", { name: "Top", exact: true }), page.getByRole("checkbox", { name: /Touches/ })]) {
      await pressed.click();
      await page.keyboard.press(" ");
      await until(page, "a pause", ({ paused }) => paused);
      await page.keyboard.press(" ");
      await until(page, "the world goes on", ({ paused }) => !paused);
    }
    await page.keyboard.press("k");
    await until(page, "no touches", ({ layers }) => !layers.includes("touches"));
    // The button's own meaning is no other.
    await page.locator("#pause").click();
    await until(page, "a pause", ({ paused }) => paused);
    await page.keyboard.press(" ");
    await until(page, "the world goes on", ({ paused }) => !paused);
  });

  test("Space presses the button that was reached by key", async () => {
    await page.getByRole("button", { name: "Shaded", exact: true }).focus();
    await page.keyboard.press("Tab");
    await page.keyboard.press(" ");
    await until(page, "the next way to draw", ({ mode, paused }) => mode === "cones" && !paused);
    await page.getByRole("button", { name: "Shaded", exact: true }).click();
  });

  test("letters typed at a focused list choose nothing", async () => {
    const before = feeder.commands().length;
    await page.locator("#scene").focus();
    await page.keyboard.type("lift");
    await page.waitForTimeout(500);
    assert.deepEqual(feeder.commands().slice(before), []);
    assert.equal(await page.locator("#scene").inputValue(), "topple");
    await page.locator("#scene").blur();
  });

  test("a key without a camera says so", async () => {
    await page.keyboard.press("9");
    await page.locator("#toast", { hasText: "There is no camera 9: the rig has 8." }).waitFor({ state: "visible" });
  });

  test("a body stands before the image of the camera that is looked through", async () => {
    await page.keyboard.press(" ");
    await until(page, "a pause", ({ paused }) => paused);
    let found: { camera: number; at: [number, number] } | null = null;
    for (let camera = 0; camera < 8 && !found; camera++) {
      await page.keyboard.press(String(camera + 1));
      await until(page, "a camera with its image", ({ through, hasBackdrop }) => through === camera && hasBackdrop);
      const { bodies } = await state(page);
      const at: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), bodies[0].position);
      if (at && (await page.evaluate((p) => (window as any).hulltouch.bodyAt(p[0], p[1]), at)) === BOX.id) found = { camera, at };
    }
    assert.ok(found, "no camera sees the body");
    await page.locator("#opacity").fill("100");
    await drawn();
    const [r, g, b] = (await pixels()).at(...found.at);
    assert.ok(r > 60 && r > 2 * g && r > 2 * b, `the red box is ${r}, ${g}, ${b}`);
    await page.locator("#opacity").fill("50");
    await page.keyboard.press("Escape");
    // The slider goes, and with the next picture its focus.
    await page.waitForFunction(() => document.activeElement === document.body);
    await page.keyboard.press(" ");
    await until(page, "the world goes on", ({ paused, through }) => !paused && through === null);
  });

  test("Space goes round the frozen moment, until anything is touched", async () => {
    const azimuth = async () => {
      const { eye, target } = await state(page);
      return Math.atan2(eye[0] - target[0], eye[2] - target[2]);
    };
    const stops: Record<string, () => Promise<void>> = {
      pointer: () => page.mouse.click(300, 300),
      wheel: () => page.mouse.wheel(0, 10),
      key: () => page.keyboard.press("x"),
    };
    for (const [input, stop] of Object.entries(stops)) {
      await page.keyboard.press(" ");
      await until(page, "a pause", ({ paused }) => paused);
      let last = await azimuth();
      for (let round = 0; round < 4; round++) {
        const { pictures } = await state(page);
        await until(page, "a picture more", (now) => now.pictures > pictures + 1);
        const next = await azimuth();
        const turned = Math.atan2(Math.sin(next - last), Math.cos(next - last));
        assert.ok(turned > 0, `${input}: turned by ${turned}`);
        last = next;
      }
      await stop();
      await page.waitForTimeout(500);
      const rests = await azimuth();
      await page.waitForTimeout(500);
      assert.equal(await azimuth(), rests, input);
      await page.keyboard.press(" ");
      await until(page, "the world goes on", ({ paused }) => !paused);
    }
    await page.keyboard.press("0");
  });

  test("shadows are there on each level, and can be turned off", async () => {
    await page.keyboard.press(" ");
    await until(page, "a pause", ({ paused }) => paused);
    await page.getByRole("button", { name: "Start view" }).click();
    await page.getByText("Figures", { exact: true }).click();
    // By itself the level may change between two pictures.
    for (const level of ["high", "low"]) {
      await page.locator("#quality").selectOption(level);
      await drawn();
      const on = await pixels();
      await page.keyboard.press("s");
      await until(page, "no shadows", ({ layers }) => !layers.includes("shadows"));
      await drawn();
      const off = await pixels();
      await page.keyboard.press("s");
      await until(page, "shadows", ({ layers }) => layers.includes("shadows"));
      await drawn();
      const again = await pixels();
      const [changed, noise] = [differing(on, off), differing(on, again)];
      assert.ok(changed > 300 && changed > 5 * noise, `${level}: ${changed} pixels differ, ${noise} without a change`);
    }
    await page.keyboard.press(" ");
    await until(page, "the world goes on", ({ paused }) => !paused);
  });

  test("a moment that is looked back at stays, and says when it alone is kept", async () => {
    await until(page, "something to look back at", ({ timelineFrames }) => timelineFrames > 5);
    await page.keyboard.press("[");
    await page.keyboard.press("[");
    const looked = await until(page, "a picture that stands", ({ live, frame, timelineFrame }) => !live && frame === timelineFrame);
    await page.waitForTimeout(300);
    const before = await state(page);
    assert.equal(before.frame, looked.frame);
    await page.locator("#behind", { hasText: "kept" }).waitFor({ state: "visible" });
    const later = await until(page, "a second more", ({ behindMs }) => behindMs > 11_000);
    assert.deepEqual([later.frame, later.bodies], [before.frame, before.bodies]);
    assert.ok(!later.live);
    await page.keyboard.press("l");
    await until(page, "live again", ({ live, frame }) => live && frame > before.frame);
  });

  test("a camera that is gone raises an alarm, which leads to it and its cure", async () => {
    const alarm = page.locator("#cameras-gone");
    assert.ok(await alarm.isHidden());
    feeder.loseCamera(5, "node f: at unix:/tmp/hulltouch-1/5.sock: cannot connect: No such file or directory (os error 2)");
    await alarm.waitFor({ state: "visible" });
    assert.equal(await alarm.textContent(), "7 of 8 cameras");
    await page.getByText("Cameras", { exact: false }).and(page.locator("summary")).click();
    await alarm.click();
    const row = page.locator("#cameras button").nth(5);
    assert.ok(await row.isVisible(), "the list is open");
    assert.ok(await row.evaluate((element) => element !== document.activeElement), "Space still pauses");
    const text = (await row.textContent())!;
    assert.match(text, /gone: node f: cannot connect.*hulltouch doctor/s);
    assert.doesNotMatch((await page.locator("body").innerText()), /os error|\.sock|\/tmp/);
    feeder.loseCamera(null, "");
    await alarm.waitFor({ state: "hidden" });
  });

  test("a token that is refused is said to be", async () => {
    const viewer = await open(browser, `${feeder.address}?token=another-token`, { viewport: { width: 960, height: 600 } });
    await viewer.page.locator("#toast", { hasText: "The token was refused" }).waitFor({ state: "visible" });
    assert.match((await viewer.page.locator("#viewer-note").textContent())!, /^The token was refused/);
    assert.deepEqual(viewer.complaints, []);
    await viewer.page.context().close();
  });
});
