/** A picture that stands: its outlines against the truth, and that nothing is drawn once it is as fine as it becomes. */
import assert from "node:assert/strict";
import { after, before, beforeEach, describe, test } from "node:test";
import type { Browser, BrowserContextOptions, Page } from "playwright-core";
import type { View } from "../../src/debug.ts";
import { SAMPLES } from "../../src/draw/refinement.ts";
import { type Feeder, type Film, type Placed, serve } from "../feeder/server.ts";
import { DIST, launch, loseCard, open, picture, screen, state, until, type Watched } from "./browser.ts";
import { known } from "./film.ts";

const SIZE: [number, number, number] = [0.5, 0.4, 0.3];
const BOX: Placed = { id: 1, name: "box", color: [0.9, 0.6, 0.2], fixed: true, shape: { box: { size: SIZE } }, at: [0.75, 0.7, 0.2] };
const VIEW = "eye=0.9,1.5,3.1&at=0.2,0.85,0";
/** Small, because software draws it. Nothing moves by itself. */
const CONTEXT: BrowserContextOptions = { viewport: { width: 320, height: 200 }, deviceScaleFactor: 1, reducedMotion: "reduce" };
const MOST_ERROR_PX = 0.15;
/** The truth has so many samples a side of a pixel. */
const FINE = 4;
/** How much a body's edges cover, which are one pixel wide. */
const EDGE_OPACITY = 0.55;

type Point = readonly [number, number, number];
type Spot = readonly [number, number];

describe("a picture that stands", () => {
  let browser: Browser;
  let film: Film;
  let feeder: Feeder;
  before(async () => {
    browser = await launch();
    film = { ...(await known(browser, { bent: false, outside: true, colour: true })).film, waits: true };
    feeder = await serve(film, DIST, [BOX]);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });
  // Also after a test that failed while the world stood.
  beforeEach(() => feeder.pause(false));

  async function opened(query: string, hash: string): Promise<Watched> {
    const watched = await open(browser, `${feeder.address}?${query}#${hash}&${VIEW}`, CONTEXT, [/CONTEXT_LOST|Context Lost|Context Restored/i]);
    await until(watched.page, "a person", ({ framesShown, pictures, bodies }) => framesShown > 1 && pictures > 2 && bodies.length > 0);
    return watched;
  }

  /** Waits until a picture is refined that was begun after so many others, and then for three seconds in which none is drawn. */
  async function idle(page: Page, after = 0): Promise<Record<string, any>> {
    const refined = await until(page, "a refined picture", (now) => now.refined === SAMPLES && now.pictures > after + SAMPLES);
    await page.waitForTimeout(3000);
    const { pictures } = await state(page);
    assert.equal(pictures, refined.pictures, "no picture is drawn afterwards");
    return refined;
  }

  const viewOf = (page: Page): Promise<View> => page.evaluate(() => (window as any).hulltouch.view());

  /** How much of each pixel of the canvas is covered, where there is nothing behind the scene. */
  async function coverage(page: Page): Promise<{ width: number; height: number; found: Float64Array }> {
    const { width, height, rgba } = await screen(page);
    return { width, height, found: Float64Array.from({ length: width * height }, (_, i) => rgba[4 * i + 3] / 255) };
  }

  /** The mean and the largest error at pixels that an outline crosses or that are wrong, and how many these are. */
  function errorsAtEdges(found: Float64Array, truth: Float64Array): { mean: number; most: number; edges: number } {
    let [sum, most, edges] = [0, 0, 0];
    for (let i = 0; i < truth.length; i++) {
      const error = Math.abs(found[i] - truth[i]);
      const isEdge = (truth[i] > 0 && truth[i] < 1) || error > 0.05;
      if (!isEdge) continue;
      sum += error;
      most = Math.max(most, error);
      edges++;
    }
    return { mean: sum / Math.max(1, edges), most, edges };
  }

  test("the person's and a box's outlines are those of sixteen samples a pixel, and no picture is drawn afterwards", async (t) => {
    const { page, complaints } = await opened("clean&background=transparent", "mode=shaded&layers=");
    feeder.pause(true);
    const stood = await idle(page);
    const { width, height, found } = await coverage(page);
    const view = await viewOf(page);
    const [fx, fy, cx, cy] = view.pinhole;
    const at = (centre: number, scale: number) => (centre + 0.5) * scale - 0.5;
    // Pictures of the person alone change nothing on the screen, but are followed by a new one there.
    const fine = await picture(page, { ...view, pinhole: [fx * FINE, fy * FINE, at(cx, FINE), at(cy, FINE)] }, width * FINE, height * FINE, "shaded");
    const coarse = await picture(page, view, width, height, "shaded");
    assert.deepEqual([fine.frame, coarse.frame], [stood.frame, stood.frame]);
    const truth = new Float64Array(width * height);
    fine.mask.forEach((covered, i) => (truth[Math.floor(i / (width * FINE) / FINE) * width + Math.floor((i % (width * FINE)) / FINE)] += covered / FINE ** 2));
    const [person, jagged] = [errorsAtEdges(found, truth), errorsAtEdges(Float64Array.from(coarse.mask), truth)];
    t.diagnostic(`person: ${person.mean.toFixed(3)} px in the mean, ${person.most.toFixed(2)} at most, at ${person.edges} pixels; ${jagged.mean.toFixed(3)} without refining`);
    assert.ok(person.edges > 150, `${person.edges} pixels at the outline`);
    assert.ok(person.mean <= MOST_ERROR_PX && person.mean < 0.7 * jagged.mean, `person: ${person.mean} px, ${jagged.mean} without refining`);

    const { pictures } = await state(page);
    await page.evaluate((hash) => (location.hash = hash), `mode=off&layers=b&${VIEW}`);
    await until(page, "the box alone", ({ mode, layers }) => mode === "off" && layers.includes("bodies"));
    await idle(page, pictures);
    const box = errorsAtEdges((await coverage(page)).found, boxCoverage(await viewOf(page), width, height));
    t.diagnostic(`box: ${box.mean.toFixed(3)} px in the mean, ${box.most.toFixed(2)} at most, at ${box.edges} pixels`);
    assert.ok(box.edges > 80, `${box.edges} pixels at the outline`);
    assert.ok(box.mean <= MOST_ERROR_PX, `box: ${box.mean} px`);
    assert.deepEqual(complaints, []);
    await page.context().close();
  });

  test("refining changes no colour where nothing but a slow change is seen", async () => {
    const { page, complaints } = await opened("clean", "mode=off&layers=g");
    feeder.pause(true);
    await until(page, "a picture more", ({ paused, refined }) => paused && refined === 0);
    const before = await screen(page);
    await idle(page);
    const after = await screen(page);
    let most = 0;
    // Sky.
    for (let i = 0; i < after.width * 40 * 4; i++) most = Math.max(most, Math.abs(after.rgba[i] - before.rgba[i]));
    assert.ok(most <= 2, `a colour changes by ${most}`);
    for (let i = 3; i < after.rgba.length; i += 4) assert.equal(after.rgba[i], 255);
    assert.deepEqual(complaints, []);
    await page.context().close();
  });

  test("keys, drags and the world are answered by a new picture at once, and film that goes on is not refined", async (t) => {
    const { page, complaints } = await opened(`token=${feeder.token}`, "mode=photo&layers=bgs");
    await page.locator("#view").focus();
    await page.keyboard.press(" ");
    await until(page, "a pause", ({ paused }) => paused);
    // The page looks at itself: from here the next picture might be missed.
    const answer = await page.evaluate(async () => {
      const now = () => (window as any).hulltouch.state();
      const press = (key: string) => document.getElementById("view")!.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
      const refresh = () => new Promise((next) => requestAnimationFrame(next));
      press("ArrowRight");
      await refresh();
      while (now().refined !== 1) await refresh();
      const before = now();
      const began = performance.now();
      press("ArrowLeft");
      while (now().pictures === before.pictures) await refresh();
      const { pictures, refined, eye } = now();
      return { drawn: pictures - before.pictures, refined, turned: Math.hypot(...eye.map((n: number, i: number) => n - before.eye[i])), ms: performance.now() - began };
    });
    t.diagnostic(`a key is answered after ${answer.ms.toFixed(0)} ms`);
    assert.deepEqual([answer.drawn, answer.refined], [1, 0], "the next picture is of the new view");
    assert.ok(answer.turned > 0.05);

    await until(page, "refining again", ({ refined }) => refined > 0);
    const still = await state(page);
    await page.evaluate(() => {
      const seen: [number, number, number][] = ((window as any).seen = []);
      const look = () => {
        const { pictures, refined, eye } = (window as any).hulltouch.state();
        if (seen.push([pictures, refined, eye[0]]) < 2000) requestAnimationFrame(look);
      };
      look();
    });
    await page.mouse.move(60, 90);
    await page.mouse.down();
    await page.mouse.move(110, 95, { steps: 4 });
    await page.mouse.up();
    await until(page, "a new view", ({ eye, pictures }) => Math.abs(eye[0] - still.eye[0]) > 0.05 && pictures > still.pictures + 1);
    const seen: [number, number, number][] = await page.evaluate(() => (window as any).seen);
    const moved = seen.findIndex(([, , eye]) => Math.abs(eye - still.eye[0]) > 1e-6);
    const next = seen.slice(moved).find(([pictures]) => pictures > seen[moved - 1][0])!;
    assert.equal(next[1], 0, "the first picture after a drag is a new one");
    await until(page, "a refined picture", ({ refined }) => refined === SAMPLES);

    await page.keyboard.press(" ");
    const { framesShown } = await until(page, "the world goes on", ({ paused, refined }) => !paused && refined === 0);
    await until(page, "frames", (now) => now.framesShown > framesShown + 3);
    assert.equal((await state(page)).refined, 0, "film that goes on is not refined");

    // What is looked back at stands, though the world goes on.
    await page.keyboard.press("[");
    await until(page, "what is looked back at", ({ live }) => !live);
    await idle(page);
    await page.keyboard.press("l");
    await until(page, "live again", ({ live, refined }) => live && refined === 0);
    assert.deepEqual(complaints, []);
    await page.context().close();
  });

  test("a picture is refined again after the card was lost, the window changed and the run ended", async () => {
    const own = await serve(film, DIST, [BOX]);
    const { page, complaints } = await open(browser, `${own.address}?clean#mode=shaded&layers=bgs&${VIEW}`, CONTEXT, [/CONTEXT_LOST|Context Lost|Context Restored/i, /WebSocket|ERR_/]);
    try {
      await until(page, "a person", ({ framesShown }) => framesShown > 1);
      own.pause(true);
      await idle(page);
      let { pictures } = await state(page);
      await loseCard(page, 100);
      await until(page, "the person again", ({ box, pictures: now }) => box && now > pictures);
      await idle(page, pictures);
      ({ pictures } = await state(page));
      await page.setViewportSize({ width: 280, height: 180 });
      await idle(page, pictures);
      own.pause(false);
      await until(page, "the world goes on", ({ paused, refined }) => !paused && refined === 0);
      await own.end("the run has ended");
      await until(page, "the end", ({ link }) => !link);
      // Also while the page looks for the run again.
      await idle(page);
      await page.waitForTimeout(5000);
      assert.equal((await state(page)).refined, SAMPLES);
      assert.deepEqual(complaints, []);
    } finally {
      await page.context().close();
      await own.close().catch(() => undefined);
    }
  });
});

/** How much of each pixel the box covers, with its edges: rays through many points of each pixel. */
function boxCoverage({ rotation, translation, pinhole }: View, width: number, height: number): Float64Array {
  const [fx, fy, cx, cy] = pinhole;
  const toCamera = (p: Point) => rotation.map((r, i) => r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + translation[i]);
  // A pixel's centre is at a half here.
  const toPixel = (p: Point): Spot => {
    const [x, y, z] = toCamera(p);
    return [(fx * x) / z + cx + 0.5, (fy * y) / z + cy + 0.5];
  };
  const eye = [0, 1, 2].map((i) => -(rotation[0][i] * translation[0] + rotation[1][i] * translation[1] + rotation[2][i] * translation[2]));
  const [low, high] = [BOX.at!.map((n, i) => n - SIZE[i] / 2), BOX.at!.map((n, i) => n + SIZE[i] / 2)];
  const corners = Array.from({ length: 8 }, (_, corner): Point => [0, 1, 2].map((i) => ((corner >> i) & 1 ? high[i] : low[i])) as unknown as Point);
  const edges = corners.flatMap((from, corner) => [1, 2, 4].filter((bit) => !(corner & bit)).map((bit): readonly [Spot, Spot] => [toPixel(from), toPixel(corners[corner | bit])]));
  const isInside = (x: number, y: number): boolean => {
    const n = [(x - cx - 0.5) / fx, (y - cy - 0.5) / fy];
    let [near, far] = [0, Infinity];
    for (let i = 0; i < 3; i++) {
      const d = rotation[0][i] * n[0] + rotation[1][i] * n[1] + rotation[2][i];
      const [a, b] = [(low[i] - eye[i]) / d, (high[i] - eye[i]) / d];
      [near, far] = [Math.max(near, Math.min(a, b)), Math.min(far, Math.max(a, b))];
    }
    return near <= far;
  };
  // As cards draw thin lines: half a pixel to both sides across, upwards or sideways as the line runs.
  const isOnEdge = (x: number, y: number): boolean =>
    edges.some(([[ax, ay], [bx, by]]) => {
      const isFlat = Math.abs(bx - ax) >= Math.abs(by - ay);
      const share = isFlat ? (x - ax) / (bx - ax) : (y - ay) / (by - ay);
      return share >= 0 && share <= 1 && (isFlat ? Math.abs(ay + share * (by - ay) - y) : Math.abs(ax + share * (bx - ax) - x)) <= 0.5;
    });
  const spots = corners.map(toPixel);
  const bounds = [0, 1].map((axis) => [Math.floor(Math.min(...spots.map((spot) => spot[axis]))) - 2, Math.ceil(Math.max(...spots.map((spot) => spot[axis]))) + 2]);
  const found = new Float64Array(width * height);
  for (let y = Math.max(0, bounds[1][0]); y < Math.min(height, bounds[1][1]); y++) {
    for (let x = Math.max(0, bounds[0][0]); x < Math.min(width, bounds[0][1]); x++) {
      for (let i = 0; i < FINE * FINE; i++) {
        const [u, v] = [x + ((i % FINE) + 0.5) / FINE, y + (Math.floor(i / FINE) + 0.5) / FINE];
        found[y * width + x] += (isInside(u, v) ? 1 : isOnEdge(u, v) ? EDGE_OPACITY : 0) / FINE ** 2;
      }
    }
  }
  return found;
}
