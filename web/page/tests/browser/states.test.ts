/** What the page says of link and run, and how it draws the person meanwhile. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { BodyText } from "../../src/feed/text.ts";
import { type Feeder, INSECURE, serve } from "../feeder/server.ts";
import { DIST, launch, open, state, until } from "./browser.ts";
import { known } from "./film.ts";

const BALL: BodyText = { id: 3, name: "ball", color: [1, 0.5, 0.25], fixed: false, shape: { ball: { radius: 0.15 } } };

describe("the page says how the run is", () => {
  let browser: Browser;
  let feeder: Feeder;
  let page: Page;
  /** Everything on the console. */
  const printed: string[] = [];
  before(async () => {
    browser = await launch();
    const { film } = await known(browser, { bent: false, outside: true, colour: false });
    feeder = await serve(film, DIST, [BALL]);
    ({ page } = await open(browser, "about:blank", { viewport: { width: 960, height: 600 } }));
    page.on("console", (message) => printed.push(message.text()));
    await page.goto(`${feeder.address}?token=${feeder.token}#mode=shaded`);
    await until(page, "a first frame", ({ framesShown, controller }) => framesShown > 0 && controller);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });

  /** Waits for the status line, then tells what else is there. */
  async function said(status: RegExp): Promise<{ behind: string | null; live: string | null; banner: string | null }> {
    await page.locator("#link-text", { hasText: status }).waitFor({ state: "visible" });
    const banner = page.locator("#banner");
    return {
      behind: await page.locator("#behind").textContent(),
      live: await page.locator("#live").getAttribute("aria-pressed"),
      banner: (await banner.isVisible()) ? await page.locator("#banner-text").textContent() : null,
    };
  }

  test("live, and nothing else", async () => {
    assert.deepEqual(await said(/^Live/), { behind: "now", live: "true", banner: null });
  });

  test("without a graphics card nothing is live, and the banner says why", async () => {
    await page.evaluate(() => ((window as any).card = (document.getElementById("view") as HTMLCanvasElement).getContext("webgl2")!.getExtension("WEBGL_lose_context")!).loseContext());
    const { live, banner } = await said(/^No picture$/);
    assert.deepEqual([live, banner], ["false", "The browser lost the graphics card. The picture returns with it; if it does not, load the page again."]);
    await page.evaluate(() => (window as any).card.restoreContext());
    assert.deepEqual(await said(/^Live/), { behind: "now", live: "true", banner: null });
  });

  test("what is not encrypted", async () => {
    assert.equal(await page.locator("#insecure").textContent(), "Not encrypted");
    assert.ok(await page.locator("#insecure").isVisible());
    assert.equal(await page.locator("#insecure").getAttribute("title"), INSECURE);
    assert.equal(await page.locator("#insecure-note").textContent(), `Not encrypted: ${INSECURE}`);
  });

  test("paused, beside which Live and holding are unavailable", async () => {
    await page.getByRole("button", { name: "Pause" }).click();
    assert.deepEqual(await said(/^Paused$/), { behind: "paused", live: "false", banner: null });
    for (const button of ["#live", "#look-back"]) assert.equal(await page.locator(button).getAttribute("aria-disabled"), "true", `${button} would do nothing`);
  });

  test("touches that are wanted while paused are drawn, again and again", async () => {
    const touches = page.getByRole("checkbox", { name: /Touches/ });
    for (let round = 0; round < 3; round++) {
      await touches.check();
      await until(page, "touches", ({ paused, touchesDrawn }) => paused && touchesDrawn > 0);
      await touches.uncheck();
      await until(page, "no touches", ({ touchesDrawn }) => touchesDrawn === 0);
    }
    await page.getByRole("button", { name: "Go on" }).click();
    await said(/^Live/);
  });

  test("in Off nothing is captured, and nothing is said of how long it takes", async () => {
    const latency = async () => (await state(page)).latencyMs as number | null;
    await until(page, "a latency", ({ latencyMs }) => latencyMs !== null);
    await page.getByRole("button", { name: "Off", exact: true }).click();
    await until(page, "none", ({ latencyMs }) => latencyMs === null);
    await page.getByRole("button", { name: "Shaded", exact: true }).click();
    await until(page, "a latency again", ({ latencyMs }) => latencyMs !== null);
    assert.ok((await latency())! < 600_000, `${await latency()} ms`);
  });

  test("without a hull the person that is left is grey, and the banner says what that means", async () => {
    feeder.goBlind("2 of 6 cameras, 3 needed: node a: at unix:/tmp/hulltouch-1/0.sock: the connection broke");
    await until(page, "grey", ({ isGrey }) => isGrey);
    assert.equal((await said(/^Live/)).banner, "Hull unavailable, collisions off: 2 of 6 cameras, 3 needed: node a: the connection broke");
    feeder.goBlind(null);
    await until(page, "not grey", ({ isGrey }) => !isGrey);
    assert.equal((await said(/^Live/)).banner, null);
  });

  test("ended: the person stays as it was while the program is looked for, and no token is printed", async () => {
    await feeder.end("the run has ended");
    const { behind, live, banner } = await said(/^Ended$/);
    assert.deepEqual([behind, live], ["end", "false"]);
    assert.match(banner!, /^The run has ended\./);
    const failed = () => printed.filter((text) => /WebSocket connection to .* failed/.test(text));
    await until(page, "attempts in vain", () => failed().length >= 2);
    assert.equal((await state(page)).isGrey, false);
    assert.equal((await said(/^Ended$/)).banner, banner);
    assert.deepEqual(printed.filter((text) => text.includes(feeder.token)), []);
  });
});
