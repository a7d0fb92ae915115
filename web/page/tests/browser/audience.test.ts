/** A page before an audience: nothing but the picture, over whatever is behind it, whatever becomes of the run. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { type Feeder, type Film, serve } from "../feeder/server.ts";
import { DIST, launch, open, screen, state, until } from "./browser.ts";
import { known } from "./film.ts";

const VIEW = "mode=shaded&eye=0,1.4,4&at=0,0.9,0";

describe("before an audience", () => {
  let browser: Browser;
  let film: Film;
  let feeder: Feeder;
  before(async () => {
    browser = await launch();
    ({ film } = await known(browser, { bent: false, outside: true, colour: true }));
    feeder = await serve(film, DIST);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });

  async function opened(query: string): Promise<Page> {
    const { page } = await open(browser, `${feeder.address}?${query}#${VIEW}`, { viewport: { width: 480, height: 320 } }, [/WebSocket/, /ERR_/]);
    await until(page, "a person", ({ framesShown, pictures }) => framesShown > 0 && pictures > 2);
    return page;
  }

  /** What is seen beside the picture. */
  const others = (page: Page) =>
    page.evaluate(() =>
      [...document.body.querySelectorAll("*")]
        .filter((element) => element.tagName !== "CANVAS" && element.tagName !== "MAIN" && element.checkVisibility() && element.getBoundingClientRect().width > 0)
        .map(({ tagName, id }) => `${tagName}#${id}`),
    );

  test("the picture is alone, without pointer, controls, cameras or token", async () => {
    const page = await opened(`clean&token=${feeder.token}`);
    assert.deepEqual(await others(page), []);
    assert.equal(await page.locator("#view").evaluate((canvas) => getComputedStyle(canvas).cursor), "none");
    const { controller, layers } = await state(page);
    assert.ok(!controller && !layers.includes("cameras"));
    assert.doesNotMatch(page.url(), /token/);
    const { eye } = await state(page);
    await page.mouse.move(200, 160);
    await page.mouse.down();
    assert.equal(await page.locator("#view").evaluate((canvas) => getComputedStyle(canvas).cursor), "none");
    await page.mouse.up();
    await page.mouse.wheel(0, 500);
    await page.keyboard.press("t");
    await page.waitForTimeout(300);
    assert.deepEqual((await state(page)).eye, eye);
    await page.context().close();
  });

  test("a run that goes and comes again is followed without a word", async (t) => {
    const own = await serve(film, DIST);
    let again: Feeder | null = null;
    t.after(() => again?.close());
    const port = Number(new URL(own.address).port);
    const { page } = await open(browser, `${own.address}?clean#${VIEW}`, {}, [/WebSocket/, /ERR_/]);
    await until(page, "a person", ({ framesShown }) => framesShown > 0);
    await own.close();
    await until(page, "the run is gone", ({ link }) => !link);
    assert.deepEqual(await others(page), []);
    // It comes with another rig, and the view stays that of the address.
    const { eye } = await state(page);
    again = await serve({ ...film, volume: { low: [-2, 0, -2], high: [2, 2.4, 2] } }, DIST, [], port);
    const { framesShown } = await state(page);
    await until(page, "the person again", (now) => now.link && now.framesShown > framesShown);
    assert.deepEqual(await others(page), []);
    assert.deepEqual((await state(page)).eye, eye);
    assert.match(page.url(), /#mode=shaded&eye=0,1\.4,4&at=0,0\.9,0$/);
    await page.context().close();
  });

  test("what is behind the scene is nothing, or exactly a colour", async () => {
    const clear = await opened("clean&background=transparent");
    const seen = await screen(clear);
    const corners = ({ width, height, at }: typeof seen) => [at(0, 0), at(width - 1, 0), at(0, height - 1), at(width - 1, height - 1)];
    for (const corner of corners(seen)) assert.equal(corner[3], 0);
    assert.equal(seen.at(seen.width / 2, seen.height / 2)[3], 255, "the person covers what is behind");
    await clear.context().close();
    const green = await opened("clean&background=00ff00");
    for (const corner of corners(await screen(green))) assert.deepEqual(corner, [0, 255, 0, 255]);
    await green.context().close();
  });

  test("a background that makes no sense is named, and the room is drawn", async () => {
    const page = await opened("background=plaid");
    await page.locator("#toast", { hasText: "background=plaid: expected transparent" }).waitFor();
    await page.context().close();
  });
});
