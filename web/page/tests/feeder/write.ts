/** The feed's binary messages, written: what the parser under test reads. */

/** One camera's part of a message. */
export interface Part {
  readonly camera: number;
  readonly scaleLog2: number;
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
  readonly runs: Uint8Array | null;
  readonly jpeg: Uint8Array | null;
}

/** A pose as the tests' world holds it. */
export interface Placed {
  readonly id: number;
  readonly position: readonly number[];
  readonly touching?: boolean;
  readonly grabbed?: boolean;
  readonly asleep?: boolean;
}

const align = (at: number) => (at + 3) & ~3;

/** A frame set (type 1) or images (type 3). */
export function frameMessage(type: 1 | 3, seq: number, frame: number, filmS: number, parts: readonly Part[], flags = 0): ArrayBuffer {
  let total = 48 + parts.length * 32;
  const places = parts.map((part) => {
    const runs = align(total);
    total = runs + (part.runs?.length ?? 0);
    const jpeg = align(total);
    total = jpeg + (part.jpeg?.length ?? 0);
    return { runs, jpeg };
  });
  const buffer = new ArrayBuffer(total);
  const view = new DataView(buffer);
  header(view, type, parts.length, seq);
  view.setBigUint64(16, BigInt(frame), true);
  // Nothing was asked of the cameras: nothing was captured.
  view.setFloat64(24, parts.length > 0 ? Date.now() / 1000 : 0, true);
  view.setFloat64(32, filmS, true);
  view.setUint32(40, flags, true);
  parts.forEach((part, index) => {
    const at = 48 + index * 32;
    view.setUint16(at, part.camera, true);
    view.setUint8(at + 2, (part.runs ? 1 : 0) | (part.jpeg ? 2 : 0));
    view.setUint8(at + 3, part.scaleLog2);
    [part.left, part.top, part.width, part.height].forEach((n, i) => view.setUint16(at + 4 + i * 2, n, true));
    const { runs, jpeg } = places[index];
    if (part.runs) {
      view.setUint32(at + 12, runs, true);
      view.setUint32(at + 16, part.runs.length, true);
      new Uint8Array(buffer).set(part.runs, runs);
    }
    if (part.jpeg) {
      view.setUint32(at + 20, jpeg, true);
      view.setUint32(at + 24, part.jpeg.length, true);
      new Uint8Array(buffer).set(part.jpeg, jpeg);
    }
  });
  return buffer;
}

/**
 * A world (type 2) without touches and patches, or with those given: body, point, response; and body, samples, point,
 * normal, velocity, depth, radius.
 */
export function worldMessage(
  seq: number,
  generation: number,
  step: number,
  filmS: number,
  frame: number | null,
  paused: boolean,
  bodies: readonly Placed[],
  touches: readonly (readonly number[])[] = [],
  patches: readonly (readonly number[])[] = [],
): ArrayBuffer {
  const patchesAt = 48 + bodies.length * 48 + 4 + touches.length * 28;
  const buffer = new ArrayBuffer(patchesAt + (patches.length > 0 ? 4 + patches.length * 52 : 0));
  const view = new DataView(buffer);
  header(view, 2, bodies.length, seq);
  view.setUint32(16, generation, true);
  view.setUint32(20, paused ? 1 : 0, true);
  view.setBigUint64(24, BigInt(step), true);
  view.setFloat64(32, filmS, true);
  view.setBigUint64(40, frame === null ? 0xffff_ffff_ffff_ffffn : BigInt(frame), true);
  bodies.forEach((body, index) => {
    const at = 48 + index * 48;
    view.setUint32(at, body.id, true);
    view.setUint16(at + 4, (body.touching ? 1 : 0) | (body.grabbed ? 2 : 0) | (body.asleep ? 4 : 0), true);
    body.position.forEach((n, i) => view.setFloat32(at + 8 + i * 4, n, true));
    view.setFloat32(at + 32, 1, true);
  });
  const at = 48 + bodies.length * 48;
  view.setUint32(at, touches.length, true);
  touches.forEach((touch, index) => {
    view.setUint32(at + 4 + index * 28, touch[0], true);
    for (let i = 0; i < 6; i++) view.setFloat32(at + 8 + index * 28 + i * 4, touch[i + 1], true);
  });
  if (patches.length > 0) view.setUint32(patchesAt, patches.length, true);
  patches.forEach((patch, index) => {
    const from = patchesAt + 4 + index * 52;
    for (let i = 0; i < 2; i++) view.setUint32(from + i * 4, patch[i], true);
    for (let i = 2; i < 13; i++) view.setFloat32(from + i * 4, patch[i], true);
  });
  return buffer;
}

function header(view: DataView, type: number, count: number, seq: number): void {
  view.setUint32(0, 0x31465448, true);
  view.setUint8(4, type);
  view.setUint8(5, 1);
  view.setUint16(6, count, true);
  view.setUint32(8, seq, true);
  view.setUint32(12, view.byteLength, true);
}

/** Runs of a mask, row by row. */
export function encodeRuns(mask: Uint8Array, width: number, height: number): Uint8Array {
  const bytes: number[] = [];
  const push = (n: number) => {
    while (n >= 0x80) {
      bytes.push((n & 0x7f) | 0x80);
      n >>= 7;
    }
    bytes.push(n);
  };
  for (let row = 0; row < height; row++) {
    const runs: [number, number][] = [];
    for (let column = 0; column < width; column++) {
      if (mask[row * width + column] === 0) continue;
      if (runs.length > 0 && runs[runs.length - 1][1] === column) runs[runs.length - 1][1]++;
      else runs.push([column, column + 1]);
    }
    push(runs.length);
    let after = 0;
    runs.forEach(([start, end], index) => {
      push(start - after - (index > 0 ? 1 : 0));
      push(end - start - 1);
      after = end;
    });
  }
  return Uint8Array.from(bytes);
}
