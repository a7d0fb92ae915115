/**
 * The feed's binary messages, taken apart and checked. Nothing in them is trusted: every count, length and
 * offset is held against the bytes that are there. Little-endian throughout.
 */

/** "HTF1". */
export const MAGIC = 0x31465448;
/** The version of the binary format that this page reads. */
export const VERSION = 1;
/** A rig has no more cameras than the shader's loops are compiled for. */
export const MAX_CAMERAS = 64;
/** No message is larger: sixteen cameras of 4K film at full quality stay below. */
export const MAX_MESSAGE_BYTES = 64 * 1024 * 1024;
/** More bodies than any scene holds. */
export const MAX_BODIES = 4096;
/** More samples than are ever inside. */
export const MAX_TOUCHES = 1 << 18;

/** Patches of one body at most. */
const MAX_BODY_PATCHES = 4;
/** Numbers of a patch in {@link WorldMessage.patches}. */
export const PATCH_NUMBERS = 13;

const HEADER_BYTES = 16;
const FRAME_HEADER_BYTES = 32;
const CAMERA_BYTES = 32;
const WORLD_HEADER_BYTES = 32;
const BODY_BYTES = 48;
const TOUCH_BYTES = 28;
const PATCH_BYTES = 52;
const NO_FRAME = 0xffff_ffff_ffff_ffffn;

/** What is wrong with a message: one line. */
export class MessageError extends Error {}

/** One camera's part of a frame set; rectangles in the camera's own full-resolution pixels. */
export interface CameraPart {
  /** The camera's place in the rig. */
  readonly camera: number;
  /** The JPEG holds the crop at 1 / 2^scaleLog2 of its size. */
  readonly scaleLog2: number;
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
  /** The silhouette's runs, or null. */
  readonly runs: Uint8Array | null;
  /** The crop as JPEG, or null. */
  readonly jpeg: Uint8Array | null;
}

/** All cameras at one frame (type 1), or whole images (type 3). */
export interface FrameSet {
  readonly type: "frames" | "images";
  readonly seq: number;
  readonly frame: number;
  /** When the film was captured, Unix seconds. */
  readonly capturedUnixS: number;
  /** Film time, seconds. */
  readonly filmS: number;
  /** True for small images of all cameras. */
  readonly thumbnails: boolean;
  readonly cameras: readonly CameraPart[];
  readonly bytes: number;
}

/** One body at one step; world, metres, seconds. */
export interface BodyPose {
  readonly id: number;
  readonly touching: boolean;
  readonly grabbed: boolean;
  readonly asleep: boolean;
  readonly insideSamples: number;
  readonly position: readonly [number, number, number];
  /** x y z w, of length one. */
  readonly rotation: readonly [number, number, number, number];
  /** How the hull moved it, metres. */
  readonly response: readonly [number, number, number];
}

/** The world after a step (type 2). */
export interface WorldMessage {
  readonly type: "world";
  readonly seq: number;
  readonly generation: number;
  readonly paused: boolean;
  readonly blind: boolean;
  readonly step: number;
  readonly filmS: number;
  /** The frame that the step saw, or null. */
  readonly frame: number | null;
  readonly bodies: readonly BodyPose[];
  /** Seven numbers a touch: the body's place, point, response. */
  readonly touches: Float32Array;
  /**
   * The hull's surface at the bodies, thirteen numbers a patch: the body's place, how many samples touch; a point, the
   * outward unit normal there, how the surface moves there (m/s); how deep the samples are, and how far from the point.
   */
  readonly patches: Float32Array;
  readonly bytes: number;
}

export type Message = FrameSet | WorldMessage;

/** Takes a message apart, or throws a {@link MessageError}. Payloads are views into the buffer. */
export function parseMessage(buffer: ArrayBuffer): Message {
  const size = buffer.byteLength;
  if (size < HEADER_BYTES) throw new MessageError(`message of ${size} bytes, expected ${HEADER_BYTES} or more`);
  if (size > MAX_MESSAGE_BYTES) throw new MessageError(`message of ${size} bytes, expected ${MAX_MESSAGE_BYTES} at most`);
  const view = new DataView(buffer);
  const magic = view.getUint32(0, true);
  if (magic !== MAGIC) throw new MessageError(`magic 0x${magic.toString(16)}, expected 0x${MAGIC.toString(16)}`);
  const type = view.getUint8(4);
  const version = view.getUint8(5);
  if (version !== VERSION) throw new MessageError(`version ${version}, expected ${VERSION}`);
  const count = view.getUint16(6, true);
  const seq = view.getUint32(8, true);
  const total = view.getUint32(12, true);
  if (total !== size) throw new MessageError(`message says ${total} bytes, but holds ${size}`);
  switch (type) {
    case 1:
      return frameSet("frames", view, count, seq);
    case 2:
      return world(view, count, seq);
    case 3:
      return frameSet("images", view, count, seq);
    default:
      throw new MessageError(`type ${type}, expected 1, 2 or 3`);
  }
}

function frameSet(type: "frames" | "images", view: DataView, count: number, seq: number): FrameSet {
  const size = view.byteLength;
  const payload = HEADER_BYTES + FRAME_HEADER_BYTES + count * CAMERA_BYTES;
  if (count > MAX_CAMERAS) throw new MessageError(`${count} cameras, expected ${MAX_CAMERAS} at most`);
  if (size < payload) throw new MessageError(`${count} cameras need ${payload} bytes, message holds ${size}`);
  const frame = Number(view.getBigUint64(16, true));
  const capturedUnixS = finite(view.getFloat64(24, true), "captured");
  const filmS = finite(view.getFloat64(32, true), "film time");
  const flags = view.getUint32(40, true);
  const cameras: CameraPart[] = [];
  const seen = new Set<number>();
  for (let index = 0; index < count; index++) {
    const part = cameraPart(view, HEADER_BYTES + FRAME_HEADER_BYTES + index * CAMERA_BYTES, payload);
    if (seen.has(part.camera)) throw new MessageError(`camera ${part.camera} comes twice`);
    seen.add(part.camera);
    cameras.push(part);
  }
  const thumbnails = type === "images" && (flags & 1) !== 0;
  return { type, seq, frame, capturedUnixS, filmS, thumbnails, cameras, bytes: size };
}

function cameraPart(view: DataView, at: number, payload: number): CameraPart {
  const camera = view.getUint16(at, true);
  if (camera >= MAX_CAMERAS) throw new MessageError(`camera ${camera}, expected below ${MAX_CAMERAS}`);
  const kind = view.getUint8(at + 2);
  const scaleLog2 = view.getUint8(at + 3);
  if (scaleLog2 > 3) throw new MessageError(`camera ${camera}: scale ${scaleLog2}, expected 0 to 3`);
  const bytes = (offset: number, length: number, what: string): Uint8Array => {
    if (offset < payload || offset + length > view.byteLength) {
      throw new MessageError(`camera ${camera}: ${what} at ${offset} + ${length} lie outside ${payload} to ${view.byteLength}`);
    }
    return new Uint8Array(view.buffer, offset, length);
  };
  const width = view.getUint16(at + 8, true);
  const height = view.getUint16(at + 10, true);
  const hasJpeg = (kind & 2) !== 0;
  if (hasJpeg && (width === 0 || height === 0)) throw new MessageError(`camera ${camera}: crop of ${width} x ${height} pixels`);
  return {
    camera,
    scaleLog2,
    left: view.getUint16(at + 4, true),
    top: view.getUint16(at + 6, true),
    width,
    height,
    runs: (kind & 1) !== 0 ? bytes(view.getUint32(at + 12, true), view.getUint32(at + 16, true), "runs") : null,
    jpeg: hasJpeg ? bytes(view.getUint32(at + 20, true), view.getUint32(at + 24, true), "image") : null,
  };
}

function world(view: DataView, count: number, seq: number): WorldMessage {
  const size = view.byteLength;
  if (count > MAX_BODIES) throw new MessageError(`${count} bodies, expected ${MAX_BODIES} at most`);
  const touchAt = HEADER_BYTES + WORLD_HEADER_BYTES + count * BODY_BYTES;
  if (size < touchAt + 4) throw new MessageError(`${count} bodies need ${touchAt + 4} bytes, message holds ${size}`);
  const flags = view.getUint32(20, true);
  const frame = view.getBigUint64(40, true);
  const bodies: BodyPose[] = [];
  for (let index = 0; index < count; index++) bodies.push(bodyPose(view, HEADER_BYTES + WORLD_HEADER_BYTES + index * BODY_BYTES));
  return {
    type: "world",
    seq,
    generation: view.getUint32(16, true),
    paused: (flags & 1) !== 0,
    blind: (flags & 2) !== 0,
    step: Number(view.getBigUint64(24, true)),
    filmS: finite(view.getFloat64(32, true), "film time"),
    frame: frame === NO_FRAME ? null : Number(frame),
    bodies,
    touches: touches(view, touchAt, count),
    patches: patches(view, touchAt, count),
    bytes: size,
  };
}

function bodyPose(view: DataView, at: number): BodyPose {
  const id = view.getUint32(at, true);
  const flags = view.getUint16(at + 4, true);
  const number = (offset: number) => finite(view.getFloat32(at + offset, true), `body ${id}`);
  const [x, y, z, w] = [number(20), number(24), number(28), number(32)];
  const length = Math.hypot(x, y, z, w);
  if (!(Math.abs(length - 1) < 1e-2)) throw new MessageError(`body ${id}: rotation of length ${length}, expected 1`);
  return {
    id,
    touching: (flags & 1) !== 0,
    grabbed: (flags & 2) !== 0,
    asleep: (flags & 4) !== 0,
    insideSamples: view.getUint16(at + 6, true),
    position: [number(8), number(12), number(16)],
    rotation: [x / length, y / length, z / length, w / length],
    response: [number(36), number(40), number(44)],
  };
}

function touches(view: DataView, at: number, bodies: number): Float32Array {
  const count = view.getUint32(at, true);
  if (count > MAX_TOUCHES) throw new MessageError(`${count} touches, expected ${MAX_TOUCHES} at most`);
  if (view.byteLength < at + 4 + count * TOUCH_BYTES) {
    throw new MessageError(`${count} touches need ${count * TOUCH_BYTES} bytes, ${view.byteLength - at - 4} are left`);
  }
  const numbers = new Float32Array(count * 7);
  for (let index = 0; index < count; index++) {
    const from = at + 4 + index * TOUCH_BYTES;
    const body = view.getUint32(from, true);
    if (body >= bodies) throw new MessageError(`touch of body ${body}, expected below ${bodies}`);
    numbers[index * 7] = body;
    for (let part = 0; part < 6; part++) {
      numbers[index * 7 + 1 + part] = finite(view.getFloat32(from + 4 + part * 4, true), "a touch");
    }
  }
  return numbers;
}

/** The places of the bodies that have a patch: samples of them are inside the hull, or less than a centimetre outside. */
export function patchedPlaces(patches: Float32Array): Set<number> {
  const places = new Set<number>();
  for (let at = 0; at < patches.length; at += PATCH_NUMBERS) places.add(patches[at]);
  return places;
}

/** What follows the touches: nothing, or a count and so many patches. */
function patches(view: DataView, touchAt: number, bodies: number): Float32Array {
  const at = touchAt + 4 + view.getUint32(touchAt, true) * TOUCH_BYTES;
  const left = view.byteLength - at;
  if (left === 0) return new Float32Array(0);
  const count = left < 4 ? 0 : view.getUint32(at, true);
  if (count > bodies * MAX_BODY_PATCHES) throw new MessageError(`${count} patches of ${bodies} bodies, expected ${MAX_BODY_PATCHES} each at most`);
  if (left !== 4 + count * PATCH_BYTES) throw new MessageError(`${count} patches need ${4 + count * PATCH_BYTES} bytes, ${left} are left`);
  const numbers = new Float32Array(count * PATCH_NUMBERS);
  for (let index = 0; index < count; index++) {
    const from = at + 4 + index * PATCH_BYTES;
    const body = view.getUint32(from, true);
    if (body >= bodies) throw new MessageError(`patch of body ${body}, expected below ${bodies}`);
    const patch = numbers.subarray(index * PATCH_NUMBERS, (index + 1) * PATCH_NUMBERS);
    patch[0] = body;
    patch[1] = view.getUint32(from + 4, true);
    for (let part = 2; part < PATCH_NUMBERS; part++) patch[part] = finite(view.getFloat32(from + part * 4, true), "a patch");
    const length = Math.hypot(patch[5], patch[6], patch[7]);
    if (!(Math.abs(length - 1) < 1e-2)) throw new MessageError(`patch of body ${body}: normal of length ${length}, expected 1`);
    if (patch[12] < 0) throw new MessageError(`patch of body ${body}: radius ${patch[12]}, expected 0 or more`);
  }
  return numbers;
}

function finite(value: number, what: string): number {
  if (!Number.isFinite(value)) throw new MessageError(`${what} holds ${value}, expected a finite number`);
  return value;
}
