/** Bodies under true contacts: the person's surface where they touch it, live and from a recording. */
import assert from "node:assert/strict";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { launch, open, PROGRAM, Program, state, steer, until } from "./browser.ts";

const LISTEN = ["--listen", "127.0.0.1:0"];
/** What browsers say of a server that is gone. */
const GONE = [/WebSocket connection to/, /ERR_CONNECTION_REFUSED/];
const STUDIO = ["--cameras", "4", "--size", "320x240", "--scene", "rest", "--response", "contacts"];

describe("boxes on a table, under contacts", { skip: PROGRAM ? false : "HULLTOUCH_BIN names no program" }, () => {
  let folder: string;
  let file: string;
  let browser: Browser;
  before(async () => {
    folder = mkdtempSync(join(tmpdir(), "hulltouch-contacts-"));
    file = join(folder, "run.mcap");
    browser = await launch();
  });
  after(async () => {
    await browser?.close();
    if (folder) rmSync(folder, { recursive: true });
  });

  /** Patches are drawn with the layer of touches, at most four a body, and not without it. */
  async function showsPatches(page: Page): Promise<void> {
    const touches = page.getByRole("checkbox", { name: /Touches/ });
    await touches.check();
    const { patchesDrawn, bodies } = await until(page, "patches", (now) => now.patchesDrawn > 0);
    assert.ok(patchesDrawn <= 4 * bodies.length, `${patchesDrawn} patches of ${bodies.length} bodies`);
    await touches.uncheck();
    assert.equal((await state(page)).patchesDrawn, 0);
  }

  test("the surface under them is drawn, and how old it is told", async () => {
    const program = await Program.start([...STUDIO, ...LISTEN, "--record", file]);
    try {
      const { page, complaints } = await open(browser, program.page, { viewport: { width: 960, height: 600 } });
      await showsPatches(page);
      const age = page.locator("dt", { hasText: "From lens to step" }).locator("+ dd", { hasText: /^\d+ ms$/ });
      await age.waitFor({ state: "visible" });
      assert.deepEqual(complaints, []);
    } finally {
      await program.stop();
    }
  });

  test("a recording shows it again", async () => {
    const program = await Program.start([file, ...LISTEN], "replay");
    try {
      // It does not wait: held at a step at which the boxes have come to the table.
      await steer(program, "pause");
      await steer(program, "step", { steps: 60 });
      const { page, complaints } = await open(browser, program.page, { viewport: { width: 960, height: 600 } }, GONE);
      await showsPatches(page);
      assert.deepEqual(complaints, []);
    } finally {
      await program.stop();
    }
  });
});
