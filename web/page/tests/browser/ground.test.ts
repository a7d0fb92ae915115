/** Floor, sky and shadows: what is seen on a wall in a lit room. Contrast is that of two luminances, (a + 0.05) / (b + 0.05). */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { type Feeder, type Placed, serve } from "../feeder/server.ts";
import { contrast, DIST, launch, loseCard, luminance, open, screen, type Screen, state, until } from "./browser.ts";
import { known } from "./film.ts";

const SIDE = 0.24;
/** Rests on the floor, right of the person, where no shadow of the person falls. */
const BOX: Placed = { id: 1, name: "box", color: [0.9, 0.6, 0.2], fixed: false, shape: { box: { size: [SIDE, SIDE, SIDE] } }, at: [0.9, SIDE / 2, -0.2] };
/** Between the light and the person's head and shoulders. */
const ROOF: Placed = { id: 2, name: "roof", color: [0.2, 0.5, 0.9], fixed: true, shape: { box: { size: [0.5, 0.04, 0.5] } }, at: [0.3, 2.3, 0.33] };

type Point = readonly [number, number, number];

describe("the room", () => {
  let browser: Browser;
  let feeder: Feeder;
  let page: Page;
  before(async () => {
    browser = await launch();
    const { film } = await known(browser, { bent: false, outside: true, colour: true });
    feeder = await serve(film, DIST, [BOX, ROOF]);
    ({ page } = await open(browser, `${feeder.address}?clean`, { viewport: { width: 960, height: 540 }, deviceScaleFactor: 1 }));
    await until(page, "a person", ({ framesShown, pictures }) => framesShown > 2 && pictures > 4);
  });
  after(async () => {
    await browser?.close();
    await feeder?.close();
  });

  const seen = async (point: Point): Promise<readonly [number, number]> => {
    const at: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), point);
    assert.ok(at, `${point} is behind the view`);
    return at;
  };

  /** The mean luminance of three by three pixels. */
  const lumaAt = (shot: Screen, [x, y]: readonly [number, number]): number => {
    let sum = 0;
    for (let i = 0; i < 9; i++) sum += luminance(shot.at(x + (i % 3) - 1, y + Math.floor(i / 3) - 1)) / 9;
    return sum;
  };

  async function look(view: string): Promise<Screen> {
    await page.evaluate((hash) => (location.hash = hash), view);
    const { pictures } = await state(page);
    await until(page, "pictures of this view", (now) => now.pictures > pictures + 3);
    return screen(page);
  }

  test("little of the first view is nearly black, and the horizon is seen", async (t) => {
    const shot = await screen(page);
    let dark = 0;
    for (let i = 0; i < shot.rgba.length; i += 4) dark += Number(luminance(shot.rgba.subarray(i, i + 3) as unknown as number[]) < 0.012);
    const share = dark / (shot.rgba.length / 4);
    const { eye, target } = await state(page);
    const ahead = [target[0] - eye[0], target[2] - eye[2]];
    // At the left edge of the picture, beside the person.
    const far: Point = [eye[0] + 1000 * ahead[0], eye[1], eye[2] + 1000 * ahead[1]];
    const y = (await seen(far))[1];
    const [floor, sky] = [lumaAt(shot, [20, y + 6]), lumaAt(shot, [20, y - 6])];
    t.diagnostic(`${(100 * share).toFixed(1)} % nearly black; floor to sky ${contrast(floor, sky).toFixed(2)}`);
    assert.ok(share <= 0.4, `${(100 * share).toFixed(1)} % of the picture are nearly black`);
    assert.ok(contrast(floor, sky) >= 1.15, `floor ${floor.toFixed(3)}, sky ${sky.toFixed(3)}`);
  });

  test("a body that rests on the floor has a shadow and a dark rim", async (t) => {
    const shot = await look("eye=2.6,1.6,1.4&at=0.9,0.1,-0.2&mode=photo&layers=bgs");
    const [x, z] = [BOX.at![0], BOX.at![2]];
    const rim = lumaAt(shot, await seen([x + SIDE / 2 + 0.015, 0, z]));
    const floor = lumaAt(shot, await seen([x + SIDE / 2 + 0.3, 0, z]));
    // Behind the box, away from the light.
    const over = await look("eye=0.6,2.6,-1.4&at=0.8,0,-0.3&mode=photo&layers=bgs");
    const shadow = lumaAt(over, await seen([x - SIDE / 2 - 0.06, 0, z - SIDE / 2 - 0.06]));
    const lit = lumaAt(over, await seen([x + SIDE / 2 + 0.4, 0, z - 0.4]));
    t.diagnostic(`rim ${(rim / floor).toFixed(2)} of the floor; floor to shadow ${contrast(lit, shadow).toFixed(2)}`);
    assert.ok(rim <= 0.9 * floor, `rim ${rim.toFixed(3)}, floor ${floor.toFixed(3)}`);
    assert.ok(contrast(lit, shadow) >= 1.5, `floor ${lit.toFixed(3)}, shadow ${shadow.toFixed(3)}`);
  });

  test("a body shades the person, and changes nothing of the rest of the person", async (t) => {
    const view = "eye=1.2,2.2,2.2&at=0,1.3,0&mode=photo";
    const [shaded, plain] = [await look(`${view}&layers=bgs`), await look(`${view}&layers=bg`)];
    const head = await seen([0, 1.66, 0.11]);
    const shin = await seen([0.14, 0.4, 0.06]);
    const [dark, bright] = [lumaAt(shaded, head), lumaAt(plain, head)];
    t.diagnostic(`in the shadow ${(dark / bright).toFixed(2)} of the light`);
    assert.ok(dark <= 0.85 * bright, `${dark.toFixed(3)} of ${bright.toFixed(3)}`);
    // Also after the graphics card was away.
    await loseCard(page, 100);
    const { framesShown } = await state(page);
    await until(page, "frames of the new card", (now) => now.framesShown > framesShown + 1);
    const again = lumaAt(await look(`${view}&layers=bgs`), head);
    assert.ok(Math.abs(again - dark) <= 0.05 * dark, `${again.toFixed(3)}, before ${dark.toFixed(3)}`);
    const [there, before] = [shaded.at(...(shin as [number, number])), plain.at(...(shin as [number, number]))];
    for (let c = 0; c < 3; c++) assert.ok(Math.abs(there[c] - before[c]) <= 1, `${there} beside ${before}`);
  });
});
