/** Two pages and one body: which of them holds it, and what the other sees. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { launch, open, pauseAtItsFrame, PROGRAM, Program, state, until, type Watched } from "./browser.ts";

interface Body {
  readonly id: number;
  readonly name: string;
  readonly position: [number, number, number];
  readonly grabbed: boolean;
  readonly isElsewhere: boolean;
}

describe("a body that a page holds", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let browser: Browser;
  let program: Program;
  let holder: Watched;
  let other: Watched;
  /** Decodes pictures: what the program's own page may load is bound. */
  let blank: Page;
  let body: Body;
  let at: [number, number];
  before(async () => {
    browser = await launch();
    program = await Program.start(["--response", "paper", "--cameras", "3", "--size", "320x240", "--listen", "127.0.0.1:0"]);
    [holder, other] = [await opened(), await opened()];
    blank = await browser.newPage();
    // Bodies stand, and so do pictures of them.
    await pauseAtItsFrame(holder.page);
    await until(other.page, "the pause", ({ paused, bodies }) => paused && bodies.length > 0);
    ({ body, at } = await aBody(holder.page));
  });
  after(async () => {
    await browser?.close();
    await program?.stop();
  });

  async function opened(): Promise<Watched> {
    const watched = await open(browser, `${program.page}#mode=off&layers=b`, { viewport: { width: 960, height: 600 } });
    await until(watched.page, "bodies", ({ bodies, controller }) => controller && bodies.length > 0);
    return watched;
  }

  async function aBody(page: Page): Promise<{ body: Body; at: [number, number] }> {
    const { bodies } = await state(page);
    const fixed: number[] = await page.evaluate(() => (window as any).hulltouch.fixedBodies());
    for (const each of bodies as Body[]) {
      const place: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), each.position);
      const isFree = place && place[0] > 20 && place[0] < 600 && place[1] > 80 && place[1] < 500;
      if (isFree && !fixed.includes(each.id) && (await page.evaluate((p) => (window as any).hulltouch.bodyAt(p[0], p[1]), place)) === each.id) return { body: each, at: place };
    }
    return assert.fail(`no body is in sight: ${JSON.stringify(bodies)}`);
  }

  const is = (what: keyof Body, expected: boolean) => ({ bodies }: Record<string, any>) => bodies.find(({ id }: Body) => id === body.id)?.[what] === expected;

  async function press(page: Page): Promise<void> {
    await page.mouse.move(...at);
    await page.mouse.down();
    await page.mouse.move(at[0] + 8, at[1] - 8, { steps: 3 });
  }

  /** How blue the middle of the body is on a page, 0 to 255. */
  async function blue(page: Page): Promise<number> {
    const png = (await page.screenshot({ clip: { x: at[0] - 4, y: at[1] - 4, width: 9, height: 9 } })).toString("base64");
    return blank.evaluate(async (data) => {
      const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${data}`)).blob());
      const context = new OffscreenCanvas(1, 1).getContext("2d")!;
      context.drawImage(bitmap, 0, 0, 1, 1);
      return context.getImageData(0, 0, 1, 1).data[2];
    }, png);
  }

  test("is shown as held on others, and cannot be taken from it", async () => {
    const free = await blue(other.page);
    await press(holder.page);
    await until(holder.page, "it is held", is("grabbed", true));
    assert.ok(is("isElsewhere", false)(await state(holder.page)), "by this page itself");
    // The picture of it is drawn in the same round.
    await until(other.page, "it is held elsewhere", is("isElsewhere", true));
    const held = await blue(other.page);
    assert.ok(held > free + 30, `blue ${held}, ${free} while it was free`);
    await press(other.page);
    await other.page.locator("#toast", { hasText: `body \`${body.name}\` is held by another page` }).waitFor({ state: "visible" });
    await other.page.mouse.up();
    assert.ok(is("grabbed", true)(await state(other.page)), "the first page holds it still");
    assert.ok(is("isElsewhere", true)(await state(other.page)));
  });

  test("is free again once it is released", async () => {
    await holder.page.mouse.up();
    await until(other.page, "it is free", is("grabbed", false));
    await press(other.page);
    await until(other.page, "it is held", is("grabbed", true));
    await until(holder.page, "elsewhere, as the first page sees it", is("isElsewhere", true));
    assert.ok(is("isElsewhere", false)(await state(other.page)), "by this page itself");
  });

  test("is released when its page goes", async () => {
    await other.page.context().close();
    await until(holder.page, "it is free", is("grabbed", false));
    assert.deepEqual([...holder.complaints, ...other.complaints], []);
  });
});
