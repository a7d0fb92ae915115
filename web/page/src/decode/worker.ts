/** Decodes frame sets off the page's thread: runs to distances, JPEG to bitmaps, the box around the hull. */
import { Scratch } from "../feed/distance.ts";
import { type CameraPart, type FrameSet, parseMessage } from "../feed/message.ts";
import { decodeRuns } from "../feed/runs.ts";
import { type Camera, camera } from "../view/lens.ts";
import { contour } from "./contour.ts";
import { hullBox, type CameraSilhouette } from "./hull_box.ts";
import { type Silhouette, silhouetteOf } from "./silhouette.ts";
import type { Decoded, DecodedCamera, Failed, Job, Setup } from "./work.ts";

const MAX_SEGMENTS = 1500;

let setup: Setup | null = null;
let cameras: Camera[] = [];
const scratch = new Scratch();

self.onmessage = async (event: MessageEvent<Setup | Job>) => {
  const message = event.data;
  if (message.op === "setup") {
    setup = message;
    cameras = message.cameras.map(camera);
    return;
  }
  try {
    const decoded = await decode(message);
    const moved: Transferable[] = [];
    for (const part of decoded.cameras) {
      if (part.field) moved.push(part.field.bytes.buffer);
      if (part.image) moved.push(part.image);
      if (part.contour) moved.push(part.contour.buffer);
    }
    self.postMessage(decoded, { transfer: moved });
  } catch (error) {
    const failed: Failed = { op: "failed", id: message.id, why: error instanceof Error ? error.message : String(error) };
    self.postMessage(failed);
  }
};

async function decode(job: Job): Promise<Decoded> {
  const began = performance.now();
  const parsed = parseMessage(job.message);
  if (parsed.type === "world" || !setup) throw new Error("a message that the decoder does not know");
  const set: FrameSet = parsed;
  // Images decode on the browser's own threads meanwhile.
  const images = set.cameras.map((part) => (part.jpeg && job.colour ? bitmap(part.jpeg) : Promise.resolve(null)));
  const parts: Omit<DecodedCamera, "image">[] = [];
  try {
    for (const part of set.cameras) parts.push(decodePart(part, job.contours, setup.offImageIsOutside));
  } catch (error) {
    for (const image of images) void image.then((done) => done?.close());
    throw error;
  }
  const seen: CameraSilhouette[] = parts.filter((part) => part.hasRuns).map((part) => ({ camera: cameras[part.camera], field: part.field }));
  const box = set.type === "frames" && seen.length > 0 ? hullBox(setup.volume, seen, setup.offImageIsOutside) : null;
  const done: DecodedCamera[] = [];
  for (const [index, part] of parts.entries()) done.push({ ...part, image: await images[index] });
  return {
    op: "decoded",
    id: job.id,
    type: set.type,
    seq: set.seq,
    frame: set.frame,
    filmS: set.filmS,
    capturedUnixS: set.capturedUnixS,
    thumbnails: set.thumbnails,
    cameras: done,
    box,
    decodeMs: performance.now() - began,
    bytes: set.bytes,
  };
}

function decodePart(part: CameraPart, contours: boolean, offImageIsOutside: boolean): Omit<DecodedCamera, "image"> {
  const seenBy = cameras[part.camera];
  if (!seenBy) throw new Error(`camera ${part.camera}, but the rig has ${cameras.length}`);
  const crop = { left: part.left, top: part.top, right: part.left + part.width, bottom: part.top + part.height };
  if (part.jpeg && (crop.right > seenBy.width + 64 || crop.bottom > seenBy.height + 64)) {
    throw new Error(`${seenBy.name}: a crop to ${crop.right} x ${crop.bottom} of ${seenBy.width} x ${seenBy.height} pixels`);
  }
  let silhouette: Silhouette = { field: null, outlined: null, around: null };
  let foreground = 0;
  if (part.runs) {
    const runs = decodeRuns(part.runs, seenBy.width, seenBy.height);
    foreground = runs.area / (seenBy.width * seenBy.height);
    silhouette = silhouetteOf(seenBy, runs, offImageIsOutside, contours, scratch);
  }
  return {
    camera: part.camera,
    field: silhouette.field,
    around: silhouette.around,
    hasRuns: part.runs !== null,
    foreground,
    crop,
    contour: silhouette.outlined ? contour(silhouette.outlined, 3, MAX_SEGMENTS) : null,
    bytes: (part.runs?.length ?? 0) + (part.jpeg?.length ?? 0),
  };
}

async function bitmap(jpeg: Uint8Array): Promise<ImageBitmap | null> {
  try {
    return await createImageBitmap(new Blob([jpeg as Uint8Array<ArrayBuffer>], { type: "image/jpeg" }), {
      colorSpaceConversion: "none",
      premultiplyAlpha: "none",
    });
  } catch {
    // A broken image costs its camera's colour, not the frame.
    return null;
  }
}
