/** What is seen of a touch: a ripple where it begins, and the rim of the body. Contacts and film are known. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, BrowserContextOptions, Page } from "playwright-core";
import { type Feeder, type Film, type Placed, serve } from "../feeder/server.ts";
import { DIST, launch, open, screen, state, until, type Watched } from "./browser.ts";
import { known } from "./film.ts";

type Point = readonly [number, number, number];

const SIDE = 0.5;
const BOX: Placed = { id: 1, name: "box", color: [0.3, 0.5, 0.8], fixed: false, shape: { box: { size: [SIDE, SIDE, SIDE] } }, at: [0, 1.2, 0.6] };
/** The middle of the side of the box that faces the view: its rim is nothing there. */
const ON_BOX: Point = [0, 1.2, 0.6 + SIDE / 2];
const AT_BOX = "eye=0,1.2,2&at=0,1.2,0.85&mode=off&layers=bg";

const RADIUS = 0.25;
const BALL: Placed = { id: 2, name: "ball", color: [0.25, 0.3, 0.35], fixed: false, shape: { ball: { radius: RADIUS } }, at: [1, 1.2, 0.6] };
const AT_BALL = "eye=0.7,1.2,2.2&at=0.7,1.2,0.6&mode=off&layers=bg";

/** On the person's chest. */
const ON_PERSON: Point = [0, 1.2, 0.15];
const AT_PERSON = "eye=0,1.2,1.8&at=0,1.2,0&mode=photo&layers=bg";

/** A picture after a touch began: pixels that differ from the last one before, within 10 cm of the touch and beyond 50 cm. */
interface Seen {
  readonly atMs: number;
  readonly ripples: number;
  readonly near: number;
  readonly far: number;
}

describe("a touch", () => {
  let browser: Browser;
  let film: Film;
  let feeder: Feeder;
  before(async () => {
    browser = await launch();
    ({ film } = await known(browser, { bent: false, outside: true, colour: true }));
    feeder = await serve(film, DIST, [BOX, BALL]);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });

  /** A page that has known for a while that nothing touches. */
  async function opened(address: string, options: BrowserContextOptions = {}): Promise<Watched> {
    const watched = await open(browser, address, { viewport: { width: 960, height: 540 }, deviceScaleFactor: 1, ...options });
    const { step } = await until(watched.page, "bodies", ({ bodies, pictures }) => bodies.length > 0 && pictures > 2);
    await until(watched.page, "half a second of worlds", (now) => now.step > step + 60);
    return watched;
  }

  async function onCanvas(page: Page, point: Point): Promise<[number, number]> {
    const at: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), point);
    assert.ok(at, `${point} is behind the view`);
    return at;
  }

  /**
   * Compares every picture with the last one before the body was touched. The page does it as it draws: a screenshot takes
   * longer than a ripple lasts.
   */
  async function watch(page: Page, contact: Point): Promise<void> {
    const [x, y] = await onCanvas(page, contact);
    const tenCm = (await onCanvas(page, [contact[0] + 0.1, contact[1], contact[2]]))[0] - x;
    await page.evaluate(
      ([x, y, tenCm]) => {
        const canvas = document.getElementById("view") as HTMLCanvasElement;
        const { width, height } = canvas;
        const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
        const pictures: Seen[] = [];
        const found = ((window as any).touchWatch = { hasBefore: false, pictures });
        let before = new Uint8ClampedArray();
        let drawn = (window as any).hulltouch.state().pictures;
        // After the page's own round in each refresh, before the browser takes the picture away.
        const look = () => {
          requestAnimationFrame(look);
          const now = (window as any).hulltouch.state();
          if (now.pictures === drawn) return;
          drawn = now.pictures;
          context.drawImage(canvas, 0, 0);
          const pixels = context.getImageData(0, 0, width, height).data;
          if (!now.bodies.some(({ touching }: { touching: boolean }) => touching)) {
            before = pixels;
            found.hasBefore = true;
            return;
          }
          let [near, far] = [0, 0];
          for (let at = 0; at < pixels.length; at += 4) {
            if (![0, 1, 2].some((i) => Math.abs(pixels[at + i] - before[at + i]) > 2)) continue;
            const away = Math.hypot(((at / 4) % width) + 0.5 - x, Math.floor(at / 4 / width) + 0.5 - y);
            near += Number(away <= tenCm);
            far += Number(away >= 5 * tenCm);
          }
          pictures.push({ atMs: performance.now(), ripples: now.ripples, near, far });
        };
        requestAnimationFrame(look);
      },
      [x, y, tenCm] as const,
    );
    await page.waitForFunction(() => (window as any).touchWatch.hasBefore);
  }

  /** The pictures of the first one and a half seconds of a touch, and one more. */
  async function watched(page: Page): Promise<readonly Seen[]> {
    await page.waitForFunction(() => {
      const { pictures } = (window as any).touchWatch;
      return pictures.length > 2 && pictures.at(-1).atMs > pictures[0].atMs + 1500;
    });
    return page.evaluate(() => (window as any).touchWatch.pictures);
  }

  const told = (pictures: readonly Seen[]) => pictures.map(({ atMs, ripples, near, far }) => `${(atMs - pictures[0].atMs).toFixed(0)} ms: ${ripples} ripples, ${near} near, ${far} far`).join("; ");

  test("is seen within two pictures, near it alone, and no longer after one and a half seconds", async (t) => {
    const { page, complaints } = await opened(`${feeder.address}?clean#${AT_BOX}`);
    await watch(page, ON_BOX);
    feeder.touch(1, { at: ON_BOX, normal: [0, 0, -1] });
    const pictures = await watched(page);
    feeder.touch(1, null);
    t.diagnostic(told(pictures));
    assert.ok(Math.max(pictures[0].near, pictures[1].near) >= 200, told(pictures));
    assert.ok(pictures.every(({ far }) => far <= 5), told(pictures));
    const last = pictures.at(-1)!;
    assert.equal(last.ripples, 0);
    assert.ok(last.near <= 5, told(pictures));
    assert.deepEqual(complaints, []);
    await page.context().close();
  });

  test("has no ripple where motion is to be reduced", async (t) => {
    const { page } = await opened(`${feeder.address}?clean#${AT_BOX}`, { reducedMotion: "reduce" });
    await watch(page, ON_BOX);
    feeder.touch(1, { at: ON_BOX, normal: [0, 0, -1] });
    const pictures = await watched(page);
    feeder.touch(1, null);
    t.diagnostic(told(pictures));
    assert.ok(pictures.every(({ ripples, near, far }) => ripples === 0 && near <= 5 && far <= 5), told(pictures));
    await page.context().close();
  });

  test("is seen on the person too", async (t) => {
    const own = await serve(film, DIST, [BALL]);
    t.after(() => own.close());
    const { page } = await opened(`${own.address}#${AT_PERSON}`);
    // The person is drawn alike in all pictures.
    await page.locator("#quality").selectOption("low");
    const { framesShown } = await state(page);
    await until(page, "the person", (now) => now.framesShown > framesShown + 2);
    const [x, y] = await onCanvas(page, ON_PERSON);
    assert.equal(await page.evaluate(([px, py]) => (window as any).hulltouch.placeAt(px, py), [x, y] as const), "person");
    await watch(page, ON_PERSON);
    own.touch(2, { at: ON_PERSON, normal: [0, 0, 1] });
    const pictures = await watched(page);
    t.diagnostic(told(pictures));
    assert.ok(Math.max(pictures[0].near, pictures[1].near) >= 200, told(pictures));
    assert.ok(pictures.at(-1)!.near <= 5, told(pictures));
    await page.context().close();
  });

  test("gives its body a rim, and changes no other body", async (t) => {
    const { page } = await opened(`${feeder.address}?clean#${AT_BALL}`);
    const [x, y, z] = BALL.at!;
    const rim = await onCanvas(page, [x + 0.92 * RADIUS, y, z]);
    const middle = await onCanvas(page, [x, y, z]);
    const box = await onCanvas(page, [0.1, 1.1, ON_BOX[2]]);
    const free = await screen(page);
    feeder.touch(2, { at: [x, y + RADIUS, z], normal: [0, -1, 0] });
    await until(page, "the touch", ({ bodies }) => bodies.some(({ id, touching }: { id: number; touching: boolean }) => id === 2 && touching));
    await page.waitForTimeout(1000);
    const { pictures } = await state(page);
    await until(page, "the ripple is over", (now) => now.ripples === 0 && now.pictures > pictures + 1);
    const touched = await screen(page);
    feeder.touch(2, null);
    t.diagnostic(`rim ${free.at(...rim)} to ${touched.at(...rim)}, middle ${free.at(...middle)} to ${touched.at(...middle)}`);
    assert.ok(touched.at(...rim)[0] >= free.at(...rim)[0] + 15, "the rim");
    for (let i = 0; i < 3; i++) assert.ok(Math.abs(touched.at(...middle)[i] - free.at(...middle)[i]) <= 2, "the middle");
    assert.deepEqual(touched.at(...box), free.at(...box));
    await page.context().close();
  });
});
