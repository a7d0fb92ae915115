/** A film of one moment of the person whose truth is known: runs and JPEG crops as nodes make them. */
import type { Browser } from "playwright-core";
import { camera, type Camera } from "../../src/view/lens.ts";
import type { Film } from "../feeder/server.ts";
import { occluded, pictureOf, ringOfCameras } from "../feeder/person.ts";
import { encodeRuns, type Part } from "../feeder/write.ts";

/** A film, its cameras, and their true masks and colours. */
export interface Known {
  readonly film: Film;
  readonly cameras: readonly Camera[];
  readonly masks: readonly Uint8Array[];
  readonly colours: readonly Uint8Array[];
}

/** Makes the film; the browser encodes its JPEG. */
export async function known(browser: Browser, options: { bent: boolean; outside: boolean; colour: boolean; shift?: boolean; pillar?: boolean; minViews?: number }): Promise<Known> {
  const texts = ringOfCameras(8, 320, 240, options.bent);
  // Cameras that see a part of the person only: for the rule that lets them be silent.
  if (options.shift) texts.forEach((text, index) => index % 3 === 2 && ((text as unknown as { matrix: number[][] }).matrix[1][2] += 90));
  const pictures = texts.map(camera).map((each) => pictureOf(each, 0.4));
  // Before one camera stands something that hides the person's middle.
  if (options.pillar) {
    const { text, mask } = occluded(texts[1], pictures[1].mask, { left: 100, top: 70, right: 220, bottom: 150 });
    texts[1] = text;
    pictures[1] = { ...pictures[1], mask };
  }
  const cameras = texts.map(camera);
  const crops = pictures.map(({ mask, rgb }) => cropOf(mask, rgb, 320, 240));
  const jpegs = options.colour ? await encode(browser, crops) : crops.map(() => null);
  const parts: Part[] = pictures.map(({ mask }, index) => ({
    camera: index,
    scaleLog2: 0,
    left: crops[index].left,
    top: crops[index].top,
    width: crops[index].width,
    height: crops[index].height,
    runs: encodeRuns(mask, 320, 240),
    jpeg: jpegs[index],
  }));
  const film: Film = {
    cameras: texts,
    volume: { low: [-1.5, 0, -1.5], high: [1.5, 2.2, 1.5] },
    fps: 10,
    rule: { min_views: options.minViews ?? 2, out_of_view: options.outside ? "outside" : "abstain" },
    colour: options.colour,
    frame: () => parts,
    thumbnails: () => parts.filter((part) => part.jpeg).map((part) => ({ ...part, runs: null })),
  };
  return { film, cameras, masks: pictures.map(({ mask }) => mask), colours: pictures.map(({ rgb }) => rgb) };
}

interface Crop {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
  readonly rgba: number[];
}

/** The foreground's box grown by sixteen pixels; the foreground spread over its edge, as nodes do. */
function cropOf(mask: Uint8Array, rgb: Uint8Array, width: number, height: number): Crop {
  let [x0, y0, x1, y1] = [width, height, 0, 0];
  for (let i = 0; i < mask.length; i++) {
    if (!mask[i]) continue;
    const [x, y] = [i % width, Math.floor(i / width)];
    [x0, y0, x1, y1] = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x + 1), Math.max(y1, y + 1)];
  }
  const [left, top] = [Math.max(0, x0 - 16) & ~7, Math.max(0, y0 - 16) & ~7];
  const [right, bottom] = [Math.min(width, (x1 + 23) & ~7), Math.min(height, (y1 + 23) & ~7)];
  const rgba: number[] = [];
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) rgba.push(...spread(mask, rgb, width, height, x, y), 255);
  }
  return { left, top, width: right - left, height: bottom - top, rgba };
}

function spread(mask: Uint8Array, rgb: Uint8Array, width: number, height: number, x: number, y: number): Uint8Array {
  let best = y * width + x;
  let least = mask[best] ? 0 : 65;
  for (let dy = -8; dy <= 8 && least > 0; dy++) {
    for (let dx = -8; dx <= 8; dx++) {
      const [u, v] = [x + dx, y + dy];
      if (u < 0 || v < 0 || u >= width || v >= height || !mask[v * width + u] || dx * dx + dy * dy >= least) continue;
      least = dx * dx + dy * dy;
      best = v * width + u;
    }
  }
  return rgb.subarray(best * 3, best * 3 + 3);
}

async function encode(browser: Browser, crops: readonly Crop[]): Promise<Uint8Array[]> {
  const page = await browser.newPage();
  const jpegs: Uint8Array[] = [];
  for (const crop of crops) {
    const text = await page.evaluate(async ({ width, height, rgba }) => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [width, height];
      canvas.getContext("2d")!.putImageData(new ImageData(Uint8ClampedArray.from(rgba), width, height), 0, 0);
      return canvas.toDataURL("image/jpeg", 0.85).split(",")[1];
    }, crop);
    jpegs.push(new Uint8Array(Buffer.from(text, "base64")));
  }
  await page.close();
  return jpegs;
}
