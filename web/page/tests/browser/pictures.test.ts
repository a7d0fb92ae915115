/** The page's person against a film whose truth is known: outlines, depths and colours, from all sides. */
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { camera, type Camera } from "../../src/view/lens.ts";
import { hullMask, limbs, looking, meet, overlap, pictureOf, rayOf } from "../feeder/person.ts";
import { type Feeder, serve } from "../feeder/server.ts";
import { DIST, launch, open, picture, until, type Watched } from "./browser.ts";
import { known, type Known } from "./film.ts";

/** Views between the cameras. */
const NOVEL: Camera[] = [0.75, 2.3, 4.1].map((angle, index) =>
  camera(
    {
      name: `novel ${index}`,
      width: 160,
      height: 160,
      matrix: [[200, 0, 79.5], [0, 200, 79.5], [0, 0, 1]],
      distortions: [0, 0, 0, 0, 0],
      ...looking([2.4 * Math.sin(angle), 1.1 + 0.4 * index, 2.4 * Math.cos(angle)], [0, 0.95, 0]),
      max_radius: null,
    },
    index,
  ),
);
const from = (view: Camera) => ({ rotation: view.rotation, translation: view.translation, pinhole: [view.matrix[0][0], view.matrix[1][1], view.matrix[0][2], view.matrix[1][2]] });

let browser: Browser;
before(async () => {
  browser = await launch();
});
after(async () => browser?.close());

/** The mean difference of colours where both have some, of 255. */
function colourError(found: Uint8Array, truth: Uint8Array, mask: Uint8Array, foundMask: Uint8Array): number {
  let [sum, count] = [0, 0];
  for (let i = 0; i < mask.length; i++) {
    if (!mask[i] || !foundMask[i]) continue;
    for (let c = 0; c < 3; c++) sum += Math.abs(found[i * 4 + c] - truth[i * 3 + c]);
    count += 3;
  }
  return sum / Math.max(1, count);
}

/** One film on one page. */
function filmed(name: string, options: Parameters<typeof known>[1], tests: (get: () => { film: Known; page: Page; watched: Watched }) => void): void {
  describe(name, () => {
    let film: Known;
    let feeder: Feeder;
    let watched: Watched;
    before(async () => {
      film = await known(browser, options);
      feeder = await serve(film.film, DIST);
      watched = await open(browser, `${feeder.address}#mode=${options.colour ? "photo" : "shaded"}`);
      await until(watched.page, "a first frame", ({ framesShown }) => framesShown > 0);
    });
    after(async () => {
      await watched?.page.context().close();
      await feeder?.close();
    });
    tests(() => ({ film, page: watched.page, watched }));
    test("the page complains of nothing", () => assert.deepEqual(watched.complaints, []));
  });
}

for (const bent of [false, true]) {
  filmed(bent ? "through bent lenses" : "through straight lenses", { bent, outside: true, colour: true }, (get) => {
    test("every camera sees its own silhouette and its own colours", async (t) => {
      const { film, page } = get();
      for (const [index, view] of film.cameras.entries()) {
        const { mask, rgba } = await picture(page, { camera: index }, view.width, view.height);
        const found = overlap(mask, film.masks[index]);
        assert.ok(found >= 0.99, `${view.name}: overlap ${found.toFixed(4)}`);
        const error = colourError(rgba, film.colours[index], film.masks[index], mask);
        t.diagnostic(`${view.name}: overlap ${found.toFixed(4)}, colours ${error.toFixed(2)}`);
        assert.ok(error <= 7, `${view.name}: colours differ by ${error.toFixed(2)}`);
      }
    });

    test("between cameras the outline is the hull's, and near the person's", async (t) => {
      const { film, page } = get();
      for (const view of NOVEL) {
        const { mask } = await picture(page, from(view), view.width, view.height);
        const hull = overlap(mask, hullMask(view, film.cameras, film.masks, 2, true));
        assert.ok(hull >= 0.97, `${view.name}: overlap with the hull ${hull.toFixed(4)}`);
        const person = overlap(mask, pictureOf(view, 0.4).mask);
        t.diagnostic(`${view.name}: overlap with the hull ${hull.toFixed(4)}, the person ${person.toFixed(4)}`);
        assert.ok(person >= 0.88, `${view.name}: overlap with the person ${person.toFixed(4)}`);
      }
    });

    test("between cameras colours and depths are the person's", async (t) => {
      const { page } = get();
      const parts = limbs(0.4);
      for (const view of NOVEL) {
        const { mask, rgba, depthM } = await picture(page, from(view), view.width, view.height);
        const truth = pictureOf(view, 0.4);
        const error = colourError(rgba, truth.rgb, truth.mask, mask);
        assert.ok(error <= 12, `${view.name}: colours differ by ${error.toFixed(2)}`);
        const deviations: number[] = [];
        for (let i = 0; i < mask.length; i += 7) {
          const dir = mask[i] ? rayOf(view, i % view.width, Math.floor(i / view.width)) : null;
          const hit = dir && meet(parts, view.centre, dir);
          if (!hit) continue;
          const r = view.rotation[2];
          deviations.push(hit.t * (r[0] * dir[0] + r[1] * dir[1] + r[2] * dir[2]) - depthM[i]);
        }
        deviations.sort((a, b) => a - b);
        const median = deviations[deviations.length >> 1];
        t.diagnostic(`${view.name}: colours ${error.toFixed(2)}, met ${(median * 1000).toFixed(1)} mm before`);
        // The hull encloses the person, so it is met first.
        assert.ok(median > -0.012 && median < 0.06, `${view.name}: the hull is met ${(median * 1000).toFixed(1)} mm before the person`);
      }
    });
  });
}

filmed("cameras that see a part only", { bent: true, outside: false, colour: false, shift: true }, (get) => {
  test("are silent about the rest, as the rule says", async () => {
    const { film, page } = get();
    for (const view of NOVEL) {
      const { mask } = await picture(page, from(view), view.width, view.height, "shaded");
      const hull = overlap(mask, hullMask(view, film.cameras, film.masks, 2, false));
      assert.ok(hull >= 0.96, `${view.name}: overlap with the hull ${hull.toFixed(4)}`);
    }
  });
});

for (const [outside, minViews] of [[true, 2], [true, 8], [false, 4]] as const) {
  filmed(`something before a camera, ${minViews} views needed, ${outside ? "outside" : "abstain"}`, { bent: false, outside, colour: false, shift: !outside, pillar: true, minViews }, (get) => {
    test("the hull is that of the rule, in which this camera is silent there", async (t) => {
      const { film, page } = get();
      for (const view of NOVEL) {
        const { mask } = await picture(page, from(view), view.width, view.height, "shaded");
        const hull = hullMask(view, film.cameras, film.masks, minViews, outside);
        const [found, share] = [overlap(mask, hull), hull.reduce((sum, one) => sum + one, 0) / hull.length];
        t.diagnostic(`${view.name}: overlap with the hull ${found.toFixed(4)}, which is on ${share.toFixed(4)} of it`);
        assert.ok(found >= 0.96, `${view.name}: overlap with the hull ${found.toFixed(4)}`);
      }
    });
  });
}

test("sets that lack cameras, of nodes that are busy, change nothing", async () => {
  const film = await known(browser, { bent: false, outside: true, colour: false });
  let sent = 0;
  // The first of all lacks some, as on a page that joins a paused run.
  const some = { ...film.film, frame: () => (sent++ % 2 === 1 ? film.film.frame(0) : film.film.frame(0).slice(0, 5)) };
  const feeder = await serve(some, DIST);
  const { page, complaints } = await open(browser, `${feeder.address}#mode=shaded`);
  try {
    await until(page, "a first frame", ({ framesShown }) => framesShown > 0);
    const view = NOVEL[0];
    const truth = hullMask(view, film.cameras, film.masks, 2, true);
    for (let round = 0; round < 12; round++) {
      const before = sent;
      const { mask } = await picture(page, from(view), view.width, view.height, "shaded");
      assert.ok(overlap(mask, truth) >= 0.97, `round ${round}: overlap with the hull ${overlap(mask, truth).toFixed(4)}`);
      await until(page, "more sets", () => sent > before + 1);
    }
    assert.deepEqual(complaints, []);
  } finally {
    await page.context().close();
    await feeder.close();
  }
});
