/** The whole page over the real program: what people do with it, and what it must survive. */
import assert from "node:assert/strict";
import { createServer } from "node:net";
import { dirname, join } from "node:path";
import { after, before, beforeEach, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { overlap } from "../feeder/person.ts";
import { DIST, goOn, launch, loseCard, open, pauseAtItsFrame, picture, Program, PROGRAM, state, TIMEOUT_MS, TOKEN, until, untilStanding, type Watched, within } from "./browser.ts";

/** What browsers say of a server that is gone on purpose. */
const GONE = [/WebSocket connection to/, /ERR_CONNECTION_REFUSED/];
// Contacts ask for more than a debug build answers in time for eight cameras; contacts.test.ts is about them.
const DEMO = ["--response", "paper", "--cameras", "8", "--size", "640x480"];

/** A port that is free now, for a program that must come back on it. */
async function freePort(): Promise<number> {
  return new Promise((resolve) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const { port } = server.address() as { port: number };
      server.close(() => resolve(port));
    });
  });
}

const distance = (a: readonly number[], b: readonly number[]) => Math.hypot(...a.map((n, i) => n - b[i]));

/** A body that can be carried and is on the screen, and where. */
async function aBody(page: Page): Promise<{ id: number; at: [number, number]; position: number[] }> {
  const { bodies } = await state(page);
  const { width } = page.viewportSize()!;
  const fixed: number[] = await page.evaluate(() => (window as any).hulltouch.fixedBodies());
  for (const { id, position } of bodies as { id: number; position: [number, number, number] }[]) {
    if (fixed.includes(id)) continue;
    const at: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), position);
    if (!at || at[0] < 20 || at[0] > width - 20) continue;
    const hit: number | null = await page.evaluate((p) => (window as any).hulltouch.bodyAt(p[0], p[1]), at);
    if (hit === id) return { id, at, position: [...position] };
  }
  assert.fail(`no body is in sight: ${JSON.stringify(bodies)}`);
}

/** A place on the floor that is in sight, and where. */
async function aPlace(page: Page): Promise<{ place: [number, number, number]; at: [number, number] }> {
  for (const place of [[-0.9, 0, 0.9], [0.9, 0, 0.9], [1.1, 0, 0.2], [-1.1, 0, 0.2], [0, 0, -1.2]] as [number, number, number][]) {
    const at: [number, number] | null = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), place);
    if (at && (await page.evaluate((p) => document.elementFromPoint(p[0], p[1])?.id === "view" && (window as any).hulltouch.placeAt(p[0], p[1]) === "floor", at))) return { place, at };
  }
  return assert.fail("no floor is in sight");
}

/** The share of a camera's view that shows the person. */
async function personShare(page: Page): Promise<number> {
  const { mask } = await picture(page, { camera: 0 }, 160, 120, "shaded");
  return mask.reduce((sum, one) => sum + one, 0) / mask.length;
}

describe("the page", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let browser: Browser;
  let program: Program;
  let watched: Watched;
  let page: Page;
  before(async () => {
    browser = await launch();
    program = await Program.start([...DEMO, "--listen", "127.0.0.1:0"]);
    const began = performance.now();
    watched = await open(browser, program.page, { viewport: { width: 960, height: 600 } });
    page = watched.page;
    const first = await until(page, "a first picture", ({ framesShown, pictures }) => framesShown > 0 && pictures > 0);
    console.log(`# first picture after ${(performance.now() - began).toFixed(0)} ms`, first.frame);
  });
  after(async () => {
    await browser?.close();
    await program?.stop();
  });
  // Also after a test that failed while the world stood.
  beforeEach(() => goOn(page));

  test("loads as a controller and hides its token", async () => {
    const now = await state(page);
    assert.equal(now.cameras, 8);
    assert.ok(now.link && now.controller);
    assert.ok(!page.url().includes(TOKEN), page.url());
    assert.ok(!program.complaints.includes(TOKEN), "a token is printed to terminals only");
    assert.ok(await page.locator("#insecure").isHidden(), "nothing leaves this machine");
    assert.ok(now.bodies.length > 0 && now.box, "bodies and a person");
  });

  test("goes round by drag and by key, and nearer by wheel", async () => {
    const start = await state(page);
    // Above all bodies.
    const [x, y] = [150, 120];
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 60, y + 30, { steps: 4 });
    await page.mouse.up();
    const turned = await until(page, "the eye goes round", ({ eye }) => distance(eye, start.eye) > 0.2);
    assert.ok(distance(turned.target, start.target) < 1e-6, "the target stays");
    await page.locator("#view").focus();
    await page.keyboard.press("ArrowLeft");
    await until(page, "the arrow turns", ({ eye }) => distance(eye, turned.eye) > 0.05);
    const before = await state(page);
    await page.mouse.wheel(0, -240);
    await until(page, "the wheel comes nearer", ({ eye, target }) => distance(eye, target) < distance(before.eye, before.target) * 0.9);
    await page.getByRole("button", { name: "Start view" }).click();
    await until(page, "the start view", ({ eye }) => distance(eye, start.eye) < 0.05);
  });

  test("toggles layers and ways to draw, and keeps them in the address", async () => {
    await page.getByRole("checkbox", { name: /Touches/ }).check();
    await page.getByRole("button", { name: "Shaded", exact: true }).click();
    await page.locator("#view").focus();
    await page.keyboard.press("c");
    const now = await until(page, "the layers", ({ mode }) => mode === "shaded");
    assert.ok(now.layers.includes("touches") && !now.layers.includes("cameras"));
    await page.waitForURL(/mode=shaded&layers=bitgs/);
    const shared = new URL(page.url());
    const second = await open(browser, shared.toString(), { viewport: { width: 480, height: 320 } });
    const there = await until(second.page, "the shared view", ({ framesShown }) => framesShown > 0);
    assert.equal(there.mode, "shaded");
    assert.deepEqual([...there.layers].sort(), [...now.layers].sort());
    assert.ok(distance(there.eye, now.eye) < 0.01);
    assert.equal(there.controller, false, "a shared view does not give the token away");
    await second.page.context().close();
    await page.keyboard.press("c");
    await page.getByRole("button", { name: "Photo", exact: true }).click();
    await page.getByRole("checkbox", { name: /Touches/ }).uncheck();
  });

  test("looks through a camera, with its image", async () => {
    await page.locator("#view").focus();
    await page.keyboard.press("2");
    await until(page, "camera 2 with its image", ({ through, hasBackdrop }) => through === 1 && hasBackdrop);
    await page.keyboard.press("Escape");
    await until(page, "the free view", ({ through }) => through === null);
  });

  test("pauses and goes on, and steps no live film", async () => {
    const paused = await pauseAtItsFrame(page);
    assert.equal(await page.locator("#link-text").textContent(), "Paused");
    assert.equal(await page.locator("#live").getAttribute("aria-pressed"), "false", "paused is not live");
    await page.locator("#scrub").fill("-1000");
    await until(page, "the past", ({ live, frame }) => !live && frame < paused.frame);
    await page.getByRole("button", { name: "Live", exact: true }).click();
    await untilStanding(page);
    await page.keyboard.press(".");
    await page.locator("#toast", { hasText: "cannot be stepped" }).waitFor({ state: "visible" });
    assert.ok(await page.locator("#step").isHidden());
    assert.equal((await state(page)).step, paused.step, "person and bodies stand");
    await page.getByRole("button", { name: "Go on" }).click();
    await until(page, "the world goes on", ({ paused: still, step }) => !still && step > paused.step + 5);
  });

  test("a page that comes while the world is paused sees the same person, and its cameras' images", async () => {
    let paused = await pauseAtItsFrame(page);
    // Of fewer cameras a person is larger, and pages may have met the frame at different moments.
    const isWhole = ({ frame, frameCameras, cameras }: Record<string, any>) => frame !== null && frameCameras === cameras;
    const late = await (async () => {
      for (const end = performance.now() + TIMEOUT_MS; performance.now() < end; ) {
        // Nodes drop frames within a quarter of a second.
        await page.waitForTimeout(2000);
        const opened = await open(browser, program.viewers, { viewport: { width: 480, height: 320 } });
        const there = await within(opened.page, 15_000, isWhole);
        const here = await within(page, 1000, isWhole);
        const { frame } = await state(opened.page);
        assert.ok(frame === null || frame === paused.frame, `never the person of another frame: ${frame} instead of ${paused.frame}`);
        if (there && here) return opened;
        // A busy server may not get hold of the frame of all cameras in time: then it is another frame's turn.
        await opened.page.context().close();
        await goOn(page);
        paused = await pauseAtItsFrame(page);
      }
      return assert.fail("a late page sees no person");
    })();
    const masks = [late.page, page].map(async (each) => (await picture(each, { camera: 0 }, 160, 120, "shaded")).mask);
    const [mask, truth] = await Promise.all(masks);
    assert.ok(overlap(mask, truth) > 0.98, `overlap ${overlap(mask, truth).toFixed(3)}`);
    await late.page.locator("#view").focus();
    await late.page.keyboard.press("3");
    await until(late.page, "camera 3 with its image", ({ through, hasBackdrop }) => through === 2 && hasBackdrop);
    assert.deepEqual(late.complaints, []);
    await late.page.context().close();
    await page.getByRole("button", { name: "Go on" }).click();
    await until(page, "the world goes on", ({ paused: still, step }) => !still && step > paused.step + 5);
  });

  test("looks back while the world goes on", async () => {
    // However few sets a slow machine makes of it.
    const before = await until(page, "something to look back at", ({ timelineMs }) => timelineMs > 2000);
    await page.locator("#scrub").fill("-100");
    const back = await until(page, "the past", ({ live, behindMs }) => !live && behindMs > 500);
    await page.locator("#link-text", { hasText: "Looking back" }).waitFor();
    await until(page, "the world goes on meanwhile", ({ step }) => step > back.step + 10);
    assert.ok(back.step >= before.step);
    await page.getByRole("button", { name: "Live", exact: true }).click();
    await until(page, "live again", ({ live, framesShown }) => live && framesShown > back.framesShown + 1);
  });

  test("puts a new body where it is clicked", async () => {
    const before = await state(page);
    await page.getByRole("button", { name: "Place by click" }).click();
    const { place, at } = await aPlace(page);
    await page.mouse.click(at[0], at[1]);
    const known = new Set(before.bodies.map(({ id }: { id: number }) => id));
    const after = await until(page, "a new body", ({ bodies }) => bodies.length === before.bodies.length + 1);
    const born = after.bodies.find(({ id }: { id: number }) => !known.has(id));
    assert.ok(Math.hypot(born.position[0] - place[0], born.position[2] - place[2]) < 0.6, `${born.position} instead of ${place}`);
    await page.keyboard.press("Escape");
  });

  test("carries a body and throws it", async () => {
    // Bodies move while one reaches for them: as people do, try again.
    let body = await aBody(page);
    let held = false;
    for (let tries = 0; tries < 8 && !held; tries++) {
      if (tries > 0) {
        await page.mouse.up();
        body = await aBody(page);
      }
      await page.mouse.move(body.at[0], body.at[1]);
      await page.mouse.down();
      for (let i = 1; i <= 12; i++) {
        await page.mouse.move(body.at[0] + i * 6, body.at[1] - i * 8);
        await page.waitForTimeout(16);
      }
      for (let wait = 0; wait < 100 && !held; wait++) {
        await page.waitForTimeout(100);
        const { bodies } = await state(page);
        held = bodies.some(({ id, grabbed }: { id: number; grabbed: boolean }) => id === body.id && grabbed);
      }
    }
    assert.ok(held, "a body is held");
    await page.mouse.up();
    const thrown = await until(page, "the body is let go", ({ bodies }) => bodies.some(({ id, grabbed }: { id: number; grabbed: boolean }) => id === body.id && !grabbed));
    const { position } = thrown.bodies.find(({ id }: { id: number }) => id === body.id);
    assert.ok(distance(position, body.position) > 0.1, `it is still at ${position}`);
  });

  test("sets parameters, chooses a scene and starts it again", async () => {
    const before = await state(page);
    const scenes = await page.locator("#scene option").allTextContents();
    const other = scenes.find((name) => name !== before.scene)!;
    await page.locator("#scene").selectOption(other);
    const chosen = await until(page, "the other scene", ({ scene, generation }) => scene === other && generation > before.generation);
    await page.locator("#response").selectOption("off");
    await page.getByRole("button", { name: "Restart" }).click();
    const restarted = await until(page, "a restart", ({ generation }) => generation > chosen.generation);
    await page.getByRole("button", { name: "Undo" }).click();
    await until(page, "the world before it", ({ generation, step }) => generation > restarted.generation && step > restarted.step);
  });

  test("survives the loss of the graphics card, again and again", async () => {
    for (let round = 0; round < 4; round++) {
      await loseCard(page, 100 + 150 * round);
      const before = await state(page);
      await until(page, "the person again", ({ framesShown, pictures, box }) => box && framesShown > before.framesShown + 2 && pictures > before.pictures + 2);
      assert.ok((await personShare(page)) > 0.01, "the person is drawn");
    }
  });

  test("draws the person again when the card is lost while the world stands, and while one looks back", async () => {
    const { frame } = await pauseAtItsFrame(page);
    await loseCard(page, 200);
    await until(page, "the person who stands", ({ box, frame: now }) => box && now === frame);
    assert.ok((await personShare(page)) > 0.01, "the person is drawn");
    await page.getByRole("button", { name: "Go on" }).click();
    await until(page, "the world goes on", ({ paused, frame: now }) => !paused && now > frame + 5);
    await page.locator("#look-back").click();
    const held = await until(page, "a picture that stands", ({ live }) => !live);
    await loseCard(page, 200);
    await until(page, "the person of then", ({ live, box }) => !live && box);
    assert.ok((await personShare(page)) > 0.01 && (await state(page)).framesShown > held.framesShown);
    await page.getByRole("button", { name: "Live", exact: true }).click();
    await until(page, "live again", ({ live, framesShown }) => live && framesShown > held.framesShown + 2);
  });

  test("everything that can be pressed has a name and can be reached by key", async () => {
    const nameless = await page.evaluate(() =>
      [...document.querySelectorAll<HTMLElement>("button, select, input, summary, canvas[tabindex]")]
        .filter((element) => element.offsetParent !== null)
        .filter((element) => {
          const labels = (element as HTMLInputElement).labels;
          return !element.getAttribute("aria-label") && !element.textContent?.trim() && !(labels && labels.length > 0 && labels[0].textContent?.trim());
        })
        .map((element) => element.outerHTML),
    );
    assert.deepEqual(nameless, []);
    await page.locator("#view").focus();
    await page.keyboard.press("Tab");
    assert.notEqual(await page.evaluate(() => document.activeElement?.id), "view");
  });

  test("a page without the token watches and cannot steer", async () => {
    const viewer = await open(browser, program.viewers);
    const now = await until(viewer.page, "a viewer's picture", ({ framesShown }) => framesShown > 0);
    assert.equal(now.controller, false);
    await viewer.page.evaluate(() => document.body.classList.remove("panel-closed"));
    assert.ok(await viewer.page.locator("#pause").isDisabled());
    assert.deepEqual(viewer.complaints, []);
    await viewer.page.context().close();
  });

  test("nothing was complained of", () => assert.deepEqual(watched.complaints.filter((text) => !/CONTEXT_LOST|Context Lost|Context Restored/i.test(text)), []));
});

describe("on a phone", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  test("the picture comes first, everything fits, and fingers find the buttons", async () => {
    const browser = await launch();
    const program = await Program.start([...DEMO, "--listen", "127.0.0.1:0"]);
    try {
      const { page, complaints } = await open(browser, program.page, { viewport: { width: 360, height: 740 }, hasTouch: true, isMobile: true });
      await until(page, "a first picture", ({ framesShown }) => framesShown > 0);
      assert.ok(await page.locator("#panel").isHidden());
      await page.getByRole("button", { name: "Panel" }).tap();
      assert.ok(await page.locator("#panel").isVisible());
      const wide = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
      assert.ok(wide[0] <= wide[1], `${wide[0]} wide on a screen of ${wide[1]}`);
      const small = await page.evaluate(() =>
        [...document.querySelectorAll<HTMLElement>("button, select")]
          .filter((element) => element.offsetParent !== null)
          .map((element) => ({ name: element.id || element.textContent, box: element.getBoundingClientRect() }))
          .filter(({ box }) => box.height < 44 || box.width < 44)
          .map(({ name, box }) => `${name}: ${box.width} x ${box.height}`),
      );
      assert.deepEqual(small, []);
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
      await program.stop();
    }
  });
});

describe("without WebGL2", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  test("the cameras' images are there, and the controls", async () => {
    const browser = await launch(["--disable-3d-apis"]);
    const program = await Program.start([...DEMO, "--listen", "127.0.0.1:0"]);
    try {
      const { page, complaints } = await open(browser, program.page, { viewport: { width: 960, height: 600 } });
      assert.ok(await page.getByText("No free view here").isVisible());
      await page.waitForFunction(() => {
        const canvas = document.querySelector<HTMLCanvasElement>("#plain-images canvas");
        const pixels = canvas?.getContext("2d", { willReadFrequently: true })?.getImageData(0, 0, canvas.width, canvas.height).data;
        return pixels?.some((value, index) => index % 4 !== 3 && value > 0);
      });
      await page.getByRole("button", { name: "Pause" }).click();
      await until(page, "a pause", ({ paused }) => paused);
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
      await program.stop();
    }
  });
});

describe("when the program goes", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  test("the page says so, keeps its picture, and comes back by itself", async () => {
    const browser = await launch();
    const port = await freePort();
    const listen = [...DEMO, "--listen", `127.0.0.1:${port}`];
    let program = await Program.start(listen);
    try {
      const { page, complaints } = await open(browser, program.page, { viewport: { width: 640, height: 400 } }, GONE);
      await until(page, "a first picture", ({ framesShown }) => framesShown > 0);
      await program.stop("SIGKILL");
      await page.locator("#banner").waitFor({ state: "visible" });
      assert.match((await page.locator("#banner").textContent())!, /link to the program is gone/);
      const lost = await state(page);
      program = await Program.start(listen);
      await until(page, "frames again", ({ framesShown, link }) => link && framesShown > lost.framesShown + 1);
      await page.locator("#banner").waitFor({ state: "hidden" });
      assert.ok((await state(page)).controller, "the token is kept");
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
      await program.stop();
    }
  });
});

describe("a page of a viewer that touches a body all the time", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let browser: Browser;
  let program: Program;
  before(async () => {
    browser = await launch();
    const scene = join(dirname(DIST), "tests/browser/plate.scene.toml");
    program = await Program.start(["--response", "paper", "--cameras", "3", "--size", "320x240", "--scene", scene, "--listen", "127.0.0.1:0"]);
  });
  after(async () => {
    await browser?.close();
    await program?.stop();
  });

  test("touches that are wanted while paused are drawn", async () => {
    const { page, complaints } = await open(browser, program.page, { viewport: { width: 960, height: 600 } });
    await until(page, "a first picture", ({ framesShown }) => framesShown > 0);
    const isTouched = (bodies: { touching: boolean }[]) => bodies.some(({ touching }) => touching);
    // The response may just have freed the plate in the step of the pause: then it is another step's turn.
    let paused = await pauseAtItsFrame(page);
    for (const end = performance.now() + TIMEOUT_MS; !isTouched(paused.bodies); paused = await pauseAtItsFrame(page)) {
      assert.ok(performance.now() < end, "nothing touches the plate");
      await goOn(page);
    }
    assert.equal((await state(page)).touchesDrawn, 0);
    await page.getByRole("checkbox", { name: /Touches/ }).check();
    await until(page, "touches", ({ touchesDrawn }) => touchesDrawn > 0);
    assert.deepEqual(complaints, []);
  });
});
