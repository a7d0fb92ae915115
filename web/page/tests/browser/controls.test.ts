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
  async function drawn(count = 2): Promise<void> {
    const { pictures } = await state(page);
    await until(page, "some pictures", (now) => now.pictures > pictures + count);
  }

  test("a hint says how to look round until that was done", async () => {
    await page.getByText("Drag to look from any side; drag a body to throw it.").waitFor();
    await page.mouse.move(300, 120);
    await page.mouse.down();
    await page.mouse.move(340, 120, { steps: 4 });
    await page.mouse.up();
    await page.locator("#first").waitFor({ state: "hidden" });
    await page.keyboard.press("0");
  });

  test("what a show needs stands first, the rest is folded, and cameras are seen without scrolling", async () => {
    const operator = await browser.newPage({ viewport: { width: 1280, height: 800 } });
    await operator.goto(`${feeder.address}?token=${feeder.token}`);
    await until(operator, "the run", ({ controller }) => controller);
    await operator.locator("#cameras button").nth(7).waitFor({ state: "visible" });
    const { first, hidden, lowest, panel } = await operator.evaluate(() => {
      const panel = document.getElementById("panel")!;
      const seen = [...panel.querySelectorAll<HTMLElement>("button, select, input")].filter((element) => element.checkVisibility());
      const rows = [...panel.querySelectorAll("#cameras button")];
      const list = document.getElementById("cameras")!;
      return { first: seen.slice(0, 5).map((element) => element.id || element.dataset.preset), hidden: list.scrollHeight - list.clientHeight, lowest: Math.max(...rows.map((row) => row.getBoundingClientRect().bottom)), panel: panel.getBoundingClientRect().bottom };
    });
    assert.deepEqual(first, ["pause", "reset", "scene", "drop", "home"]);
    assert.equal(hidden, 0, "pixels of the list that are scrolled away");
    assert.ok(lowest <= panel, `the last camera ends at ${lowest}, the panel at ${panel}`);
    assert.ok(await operator.getByRole("button", { name: "Take background" }).isHidden());
    await operator.close();
  });

  test("graphs show the last minute", async () => {
    const graph = page.locator("#last-minute canvas").nth(1);
    await graph.scrollIntoViewIfNeeded();
    await page.locator("#last-minute output").nth(1).filter({ hasText: /^\d+\.\d ms at most$/ }).waitFor();
    const painted = () => graph.evaluate((canvas: HTMLCanvasElement) => canvas.getContext("2d")!.getImageData(0, 0, canvas.width, canvas.height).data.filter((_, at) => at % 4 === 3).filter((alpha) => alpha > 0).length);
    assert.ok((await painted()) > 0);
    assert.match((await graph.getAttribute("aria-label"))!, /^Step with its pass, p99 in the last minute: /);
  });

  test("Space pauses, whatever was clicked before", async () => {
    for (const pressed of [page.getByRole("button", { name: "Top", exact: true }), page.getByRole("checkbox", { name: /Touches/ })]) {
      await pressed.click();
      await page.keyboard.press(" ");
      await until(page, "a pause", ({ paused }) => paused);
      await page.keyboard.press(" ");
      await until(page, "the world goes on", ({ paused }) => !paused);
    }
    // A label's text is pressed as its control is.
    await page.locator("label", { hasText: "Floor" }).locator("kbd").click();
    await page.keyboard.press(" ");
    await until(page, "a pause without the grid", ({ paused, layers }) => paused && !layers.includes("grid"));
    await page.keyboard.press(" ");
    await until(page, "the world goes on", ({ paused }) => !paused);
    await page.keyboard.press("g");
    await page.keyboard.press("k");
    await until(page, "no touches", ({ layers }) => !layers.includes("touches"));
    // The button's own meaning is no other.
    await page.locator("#pause").click();
    await until(page, "a pause", ({ paused }) => paused);
    await page.keyboard.press(" ");
    await until(page, "the world goes on", ({ paused }) => !paused);
  });

  test("Space pauses, also where the pointer was released beside what it pressed", async () => {
    for (const pressed of [page.getByRole("button", { name: "Top", exact: true }), page.locator("#restitution")]) {
      await pressed.hover();
      await page.mouse.down();
      await page.mouse.move(300, 300, { steps: 4 });
      await page.mouse.up();
      await page.keyboard.press(" ");
      await until(page, "a pause", ({ paused }) => paused);
      await page.keyboard.press(" ");
      await until(page, "the world goes on", ({ paused }) => !paused);
    }
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

  test("bounce, friction and gravity are set by sliders, which show what the run has", async () => {
    const shown = (id: string, text: string) => page.waitForFunction(([of, is]) => document.getElementById(`${of}-text`)!.textContent === is, [id, text] as const);
    await shown("friction", "0.50");
    await shown("gravity", "9.8 m/s²");
    for (const [id, value, text] of [["restitution", "75", "75 %"], ["friction", "120", "1.20"], ["gravity", "1.6", "1.6 m/s²"]] as const) {
      await page.locator(`#${id}`).fill(value);
      await page.locator(`#${id}`).blur();
      await shown(id, text);
    }
    await until(page, "what the run has", ({ parameters }) => parameters.hull_friction === 1.2 && parameters.hull_restitution === 0.75 && parameters.gravity_m_s2[1] === -1.6);
    await page.locator("#gravity").fill("9.8");
    await page.locator("#gravity").blur();
  });

  test("a background is taken by the cameras' own account, and can be undone", async () => {
    const take = page.getByRole("button", { name: "Take background" });
    const dialog = page.locator("#emptying");
    const outcome = page.locator("#background-outcome");
    const given = () => feeder.commands().filter((command) => command === "take_background").length;
    await take.click();
    await dialog.getByText("Leave the room").waitFor();
    const box = (await dialog.boundingBox())!;
    assert.deepEqual([box.x, box.y, box.width, box.height], [0, 0, 960, 600], "it covers the screen");
    await page.keyboard.press("Escape");
    await dialog.waitFor({ state: "hidden" });
    await page.waitForTimeout(6000);
    assert.equal(given(), 0, "it was stopped in time");

    await take.click();
    await outcome.getByText(/No background was taken: camera "left" keeps its background: 3.2 %/).waitFor();
    assert.ok(await dialog.isHidden());
    await page.getByLabel("Light or furniture has changed").check();
    await take.click();
    await page.getByText("All cameras have a new background.").waitFor();
    assert.equal(given(), 2);
    assert.equal(await outcome.textContent(), "");
    assert.ok(!(await page.getByLabel("Light or furniture has changed").isChecked()), "next time it is asked again");
    await page.getByRole("button", { name: "Undo" }).click();
    await page.getByText("Undone.").waitFor();
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
    // By itself the level may change between two pictures.
    const shown = async (level: string, isWanted: boolean) => {
      await page.locator("#quality").selectOption(level);
      if ((await state(page)).layers.includes("shadows") !== isWanted) await page.keyboard.press("s");
      await until(page, "the layers", ({ layers }) => layers.includes("shadows") === isWanted);
      // Without a graphics card a picture of the highest level takes seconds.
      await drawn(level === "high" ? 1 : 2);
      return pixels();
    };
    for (const level of ["low", "high"]) {
      const [on, off] = [await shown(level, true), await shown(level, false)];
      const noise = level === "low" ? differing(on, await shown(level, true)) : 0;
      const changed = differing(on, off);
      assert.ok(changed > 300 && changed > 5 * noise, `${level}: ${changed} pixels differ, ${noise} without a change`);
    }
    await shown("low", true);
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

  test("live film cannot be stepped: there is no button, and the key says so", async () => {
    const before = feeder.commands().length;
    await page.keyboard.press(" ");
    await until(page, "a pause", ({ paused }) => paused);
    const { step } = await state(page);
    await page.keyboard.press(".");
    await page.locator("#toast", { hasText: "Live film goes on and cannot be stepped" }).waitFor({ state: "visible" });
    assert.ok(await page.locator("#step").isHidden());
    await page.keyboard.press(" ");
    await until(page, "the world goes on", (now) => !now.paused && now.step >= step);
    assert.deepEqual(feeder.commands().slice(before), ["pause", "resume"]);
  });

  test("a removal and a restart can be undone", async () => {
    const before = feeder.commands().length;
    const undo = page.getByRole("button", { name: "Undo" });
    await page.locator("#body").selectOption(String(BOX.id));
    await page.getByRole("button", { name: "Remove" }).click();
    await page.locator("#toast", { hasText: "box was removed." }).waitFor({ state: "visible" });
    await until(page, "no body", ({ bodies }) => bodies.length === 0);
    await undo.click();
    await until(page, "the body again", ({ bodies }) => bodies.length === 1 && bodies[0].id === BOX.id);
    await page.locator("#toast", { hasText: "Undone." }).waitFor({ state: "visible" });
    assert.ok(await undo.isHidden(), "there is nothing more to undo");
    const { generation } = await state(page);
    await page.keyboard.press("r");
    await page.locator("#toast", { hasText: "The scene was restarted." }).waitFor({ state: "visible" });
    await until(page, "a restart", (now) => now.generation > generation);
    await undo.click();
    await page.locator("#toast", { hasText: "Undone." }).waitFor({ state: "visible" });
    assert.deepEqual(feeder.commands().slice(before), ["remove", "undo", "reset", "undo"]);
  });

  test("a new body is shown where it will be, and not put far away", async () => {
    const before = feeder.commands().length;
    await page.getByRole("button", { name: "Start view" }).click();
    await page.waitForTimeout(1000);
    const { eye, target } = await state(page);
    /** The floor so far before the target, seen from the eye, metres, and where it is on the canvas. */
    const floor = async (ahead: number): Promise<{ point: number[]; at: [number, number] }> => {
      const way = [target[0] - eye[0], target[2] - eye[2]].map((part, _, both) => part / Math.hypot(...both));
      const point = [target[0] + ahead * way[0], 0, target[2] + ahead * way[1]];
      const at = await page.evaluate((p) => (window as any).hulltouch.onCanvas(p), point);
      return { point, at };
    };
    const [near, far] = [await floor(-1), await floor(8)];
    // Beside the person.
    const aside: [number, number] = [far.at[0] - 200, far.at[1]];
    await page.getByRole("button", { name: "Place by click" }).click();
    await page.locator("#hint", { hasText: "Click where the new body goes." }).waitFor({ state: "visible" });
    await page.mouse.move(...near.at);
    const shown = await until(page, "a preview", ({ preview }) => preview !== null);
    const missed = Math.hypot(shown.preview[0] - near.point[0], shown.preview[2] - near.point[2]);
    assert.ok(missed < 0.05 && Math.abs(shown.preview[1] - 0.13) < 0.01, `${shown.preview} instead of ${near.point}`);
    await page.mouse.move(...aside);
    await until(page, "no preview", ({ preview }) => preview === null);
    await page.locator("#hint", { hasText: "Too far away" }).waitFor({ state: "visible" });
    await page.mouse.click(...aside);
    await page.locator("#toast", { hasText: "Too far away" }).waitFor({ state: "visible" });
    await page.mouse.move(...near.at);
    const again = await until(page, "a preview again", ({ preview }) => preview !== null);
    await page.mouse.click(...near.at);
    const placed = await until(page, "a new body", ({ bodies }) => bodies.length === 2);
    const { position } = placed.bodies.find(({ id }: { id: number }) => id !== BOX.id);
    assert.ok(Math.hypot(position[0] - again.preview[0], position[2] - again.preview[2]) < 0.01, "it is where it was shown");
    await page.keyboard.press("Escape");
    await until(page, "no preview", ({ preview }) => preview === null);
    assert.deepEqual(feeder.commands().slice(before), ["spawn"]);
    await page.keyboard.press("r");
    await until(page, "a restart", ({ bodies }) => bodies.length === 1);
  });

  test("bodies on the floor before the person are seen above the timeline, and one that lies under it through it", async () => {
    await page.getByRole("button", { name: "Start view" }).click();
    await page.waitForTimeout(1000);
    const onCanvas = (point: readonly number[]): Promise<[number, number]> => page.evaluate((p) => (window as any).hulltouch.onCanvas(p), point);
    const bar = page.locator(".timeline");
    const { y: top, height } = (await bar.boundingBox())!;
    const { eye, target, bodies } = await state(page);
    const away = Math.hypot(eye[0] - target[0], eye[2] - target[2]);
    const before = [0, 2].map((axis) => target[axis] + (1.3 * (eye[axis] - target[axis])) / away);
    assert.ok((await onCanvas([before[0], 0, before[1]]))[1] < top, "the floor 1.3 m before the person");
    const [x, y, z] = bodies[0].position;
    assert.equal(await bar.evaluate((element) => element.classList.contains("over-body")), false);
    let isUnder = false;
    for (let height_m = 0.4; height_m < 2 && !isUnder; height_m += 0.05) {
      await page.evaluate((hash) => (location.hash = hash), `eye=${x},${y + height_m + 0.6},${z + 3}&at=${x},${y + height_m},${z}&mode=shaded`);
      await drawn();
      const at = await onCanvas([x, y, z]);
      isUnder = at[1] > top && at[1] < top + height;
    }
    assert.ok(isUnder, "no view has the body under the timeline");
    await page.locator(".timeline.over-body").waitFor();
    await page.getByRole("button", { name: "Start view" }).click();
    await page.locator(".timeline:not(.over-body)").waitFor();
  });

  test("a token that is refused is said to be", async () => {
    const viewer = await open(browser, `${feeder.address}?token=another-token`, { viewport: { width: 960, height: 600 } });
    await viewer.page.locator("#toast", { hasText: "The token was refused" }).waitFor({ state: "visible" });
    assert.match((await viewer.page.locator("#viewer-note").textContent())!, /^The token was refused/);
    assert.deepEqual(viewer.complaints, []);
    await viewer.page.context().close();
  });
});
