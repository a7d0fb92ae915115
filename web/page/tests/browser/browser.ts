/** A headless browser, the program it looks at, and what tests ask of both. */
import assert from "node:assert/strict";
import { type ChildProcess, spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { type Browser, type BrowserContextOptions, chromium, type Page } from "playwright-core";
import { WebSocket } from "ws";
import type { TestPicture } from "../../src/debug.ts";

/** The built page. */
export const DIST = join(dirname(dirname(dirname(dirname(fileURLToPath(import.meta.url))))), "dist");
/** The browser: Debian's, or what the environment says. */
const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";
/** The program under test; tests that need it are skipped aloud without it. */
export const PROGRAM = process.env.HULLTOUCH_BIN;

/** What has not happened by now will not: far longer than anything takes on a busy machine. */
export const TIMEOUT_MS = 180_000;

export async function launch(more: readonly string[] = []): Promise<Browser> {
  assert.ok(existsSync(CHROMIUM), `no browser at ${CHROMIUM}: install chromium, or set CHROMIUM`);
  return chromium.launch({
    executablePath: CHROMIUM,
    args: [
      "--no-sandbox",
      "--disable-gpu",
      "--use-gl=angle",
      "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
      ...more,
    ],
  });
}

/** A page, and everything it complains of. */
export interface Watched {
  readonly page: Page;
  readonly complaints: string[];
}

/** Messages that say nothing about the page: drivers that tell of their speed, and a link that is cut on purpose. */
const HARMLESS = [/GL Driver Message/, /KHR_parallel_shader_compile/];

/** A page, drawn at half the size of its layout: without a graphics card pixels are what takes time. */
export async function open(browser: Browser, url: string, options: BrowserContextOptions = {}, alsoHarmless: RegExp[] = []): Promise<Watched> {
  const context = await browser.newContext({ viewport: { width: 480, height: 320 }, deviceScaleFactor: 0.5, ...options });
  context.setDefaultTimeout(TIMEOUT_MS);
  // Tests press what is folded away too.
  await context.addInitScript(() => addEventListener("DOMContentLoaded", () => document.querySelectorAll("details").forEach((part) => (part.open = true))));
  const page = await context.newPage();
  const complaints: string[] = [];
  page.on("console", (message) => {
    if (message.type() !== "error" && message.type() !== "warning") return;
    if (![...HARMLESS, ...alsoHarmless].some((harmless) => harmless.test(message.text()))) complaints.push(message.text());
  });
  page.on("pageerror", (error) => complaints.push(String(error)));
  await page.goto(url);
  return { page, complaints };
}

/** The page's own account of itself. */
// What tests read of it differs from test to test.
export async function state(page: Page): Promise<Record<string, any>> {
  return page.evaluate(() => (window as any).hulltouch.state());
}

/** Waits until the page is in a state. */
export async function until(page: Page, what: string, condition: (state: Record<string, any>) => boolean): Promise<Record<string, any>> {
  const end = performance.now() + TIMEOUT_MS;
  let last: Record<string, any> = {};
  while (performance.now() < end) {
    last = await state(page);
    if (condition(last)) return last;
    await page.waitForTimeout(50);
  }
  const [focused, told] = await page.evaluate(() => [document.activeElement?.outerHTML.split(">")[0], document.getElementById("toast")?.textContent]);
  assert.fail(`${what}: not within ${TIMEOUT_MS / 1000} s; the focus is on ${focused}>; it told last: ${told}; the page says ${JSON.stringify(last).slice(0, 1500)}`);
}

/** Waits until the run is paused and the page shows the frame at which it stands. */
export async function untilStanding(page: Page): Promise<Record<string, any>> {
  return until(page, "the frame at which the world stands", ({ paused, frame, worldFrame }) => paused && frame !== null && frame === worldFrame);
}

/**
 * Pauses the run at a frame that the page shows, with one before it to look back at. A busy machine may drop a frame before it was fetched:
 * then it is another frame's turn.
 */
export async function pauseAtItsFrame(page: Page): Promise<Record<string, any>> {
  const end = performance.now() + TIMEOUT_MS;
  while (performance.now() < end) {
    await page.getByRole("button", { name: "Pause" }).click();
    await until(page, "a pause", ({ paused }) => paused);
    const found = await within(page, 10_000, ({ frame, worldFrame, timelineFrames }) => frame !== null && frame === worldFrame && timelineFrames > 1);
    if (found) return found;
    await goOn(page);
  }
  return assert.fail("the page never shows the frame at which the run is paused");
}

/** Lets a paused run go on; of one that goes on nothing is asked. */
export async function goOn(page: Page): Promise<void> {
  if (!(await state(page)).paused) return;
  await page.getByRole("button", { name: "Go on" }).click();
  await until(page, "the world goes on", ({ paused }) => !paused);
}

/** The page's state once a condition holds; null if it does not within so many milliseconds. */
export async function within(page: Page, ms: number, condition: (state: Record<string, any>) => boolean): Promise<Record<string, any> | null> {
  for (const end = performance.now() + ms; performance.now() < end; await page.waitForTimeout(50)) {
    const now = await state(page);
    if (condition(now)) return now;
  }
  return null;
}

/** A picture of the person alone. */
export async function picture(page: Page, from: object, width: number, height: number, mode: "photo" | "shaded" = "photo"): Promise<{ rgba: Uint8Array; depthM: Float32Array; mask: Uint8Array; frame: number | null }> {
  const made = await page.evaluate(([f, w, h, m]) => (window as any).hulltouch.picture(f, w, h, m), [from, width, height, mode] as const);
  assert.ok(made, "the page draws no picture");
  const { rgba: colours, depthM: depths, frame } = made as TestPicture;
  const rgba = new Uint8Array(Buffer.from(colours, "base64"));
  const depthM = new Float32Array(Uint8Array.from(Buffer.from(depths, "base64")).buffer);
  const mask = Uint8Array.from({ length: width * height }, (_, i) => (rgba[i * 4 + 3] > 0 ? 1 : 0));
  return { rgba, depthM, mask, frame };
}

/** A picture of the screen. */
export interface Screen {
  readonly width: number;
  readonly height: number;
  /** Four bytes a pixel, rows from the top. */
  readonly rgba: Uint8Array;
  /** Red, green, blue and alpha of a pixel. */
  at(x: number, y: number): readonly [number, number, number, number];
}

/** A picture of the view, with what lies over it, in pixels of the layout. */
export async function screen(page: Page): Promise<Screen> {
  return decoded(page, await page.locator("#view").screenshot({ omitBackground: true, scale: "css" }));
}

/** A picture in a PNG file; the browser decodes it. */
export async function decoded(page: Page, png: Buffer): Promise<Screen> {
  const { width, height, base64 } = await page.evaluate(async (data) => {
    const file = await (await fetch(`data:image/png;base64,${data}`)).blob();
    const bitmap = await createImageBitmap(file, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d")!;
    context.drawImage(bitmap, 0, 0);
    const { data: pixels } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    // As a list of numbers half a million pixels take half a minute.
    let text = "";
    for (let at = 0; at < pixels.length; at += 8192) text += String.fromCharCode(...pixels.subarray(at, at + 8192));
    return { width: bitmap.width, height: bitmap.height, base64: btoa(text) };
  }, png.toString("base64"));
  const rgba = new Uint8Array(Buffer.from(base64, "base64"));
  return { width, height, rgba, at: (x, y) => [...rgba.subarray(4 * (Math.round(y) * width + Math.round(x))).subarray(0, 4)] as [number, number, number, number] };
}

/** Takes the graphics card away, and gives it back so long after the page has heard of it; resolves when it is back. */
export async function loseCard(page: Page, forMs: number): Promise<void> {
  await page.evaluate(async (gapMs) => {
    const canvas = document.getElementById("view") as HTMLCanvasElement;
    const gl = canvas.getContext("webgl2")!;
    const heard = (event: string) => new Promise((done) => canvas.addEventListener(event, done, { once: true }));
    // The extension must be kept: a lost context has none.
    const handle = ((window as any).loseContext ??= gl.getExtension("WEBGL_lose_context"));
    const [lost, restored] = [heard("webglcontextlost"), heard("webglcontextrestored")];
    handle.loseContext();
    // Before the page has heard of it, nothing can be restored.
    await lost;
    await new Promise((done) => setTimeout(done, gapMs));
    handle.restoreContext();
    await restored;
  }, forMs);
}

/** Relative luminance of a colour of the screen, 0 to 1. */
export function luminance([r, g, b]: readonly number[]): number {
  const linear = (value: number) => (value <= 10 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  return 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
}

/** The contrast of two luminances, as people see it: 1 is none. */
export function contrast(a: number, b: number): number {
  return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
}

/** What lets pages steer the runs of these tests. */
export const TOKEN = "a-token-for-browser-tests";

/** A run of the program, with its page. */
export class Program {
  readonly child: ChildProcess;
  page = "";
  viewers = "";
  private log = "";

  private constructor(child: ChildProcess) {
    this.child = child;
  }

  /** A run that serves a page: `demo`, unless another subcommand is named. */
  static async start(args: readonly string[], subcommand = "demo"): Promise<Program> {
    assert.ok(PROGRAM, "HULLTOUCH_BIN names no program");
    const child = spawn(PROGRAM, [subcommand, ...args], { stdio: ["ignore", "ignore", "pipe"], env: { ...process.env, HULLTOUCH_TOKEN: TOKEN } });
    const program = new Program(child);
    await new Promise<void>((resolve, reject) => {
      child.stderr!.on("data", (bytes) => {
        program.log += String(bytes);
        program.viewers = /^viewers: (\S+)\n/m.exec(program.log)?.[1] ?? "";
        // A token is printed to terminals only.
        program.page = `${program.viewers}?token=${TOKEN}`;
        if (program.viewers) resolve();
      });
      setTimeout(() => reject(new Error(`the program served no page in time: ${program.log}`)), TIMEOUT_MS).unref();
      child.on("error", reject);
      child.on("exit", (status) => reject(new Error(`the program ended with ${status}: ${program.log}`)));
    });
    return program;
  }

  get complaints(): string {
    return this.log;
  }

  /** Ends as a user ends it. */
  async stop(signal: NodeJS.Signals = "SIGINT"): Promise<void> {
    if (this.child.exitCode !== null || this.child.signalCode !== null) return;
    const ended = new Promise((resolve) => this.child.once("exit", resolve));
    this.child.kill(signal);
    const late = setTimeout(() => this.child.kill("SIGKILL"), 20_000);
    await ended;
    clearTimeout(late);
  }
}

/** Steers a run as a program does; resolves when it is done. */
export async function steer(program: Program, command: string, fields: object = {}): Promise<void> {
  const { host, searchParams } = new URL(program.page);
  const socket = new WebSocket(`ws://${host}/state?rate=1&token=${searchParams.get("token")}`);
  try {
    await new Promise<void>((resolve, reject) => {
      socket.on("open", () => socket.send(JSON.stringify({ op: "command", id: 1, command, ...fields })));
      socket.on("message", (data) => {
        const text = JSON.parse(String(data));
        if (text.op === "done") resolve();
        if (text.op === "refused") reject(new Error(`${command}: ${text.why}`));
      });
      socket.on("error", reject);
      socket.on("close", () => reject(new Error(`${command}: the run has gone`)));
    });
  } finally {
    socket.close();
  }
}
