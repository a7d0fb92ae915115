/** Frame sets that were decoded are shown, whatever becomes of the connection meanwhile. */
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { Frames } from "../../src/app/frames.ts";
import type { Job, Setup } from "../../src/decode/work.ts";
import { Credit } from "../../src/feed/credit.ts";
import type { Hello } from "../../src/feed/text.ts";

const CAMERAS = 2;

/** Decodes when it is told to. */
class FakeWorker {
  static waiting: { worker: FakeWorker; job: Job }[] = [];
  onmessage: ((event: { data: unknown }) => void) | null = null;

  postMessage(message: Setup | Job): void {
    if (message.op === "decode") FakeWorker.waiting.push({ worker: this, job: message });
  }

  static finish(): void {
    const { worker, job } = FakeWorker.waiting.shift()!;
    const header = new DataView(job.message);
    worker.onmessage!({ data: { op: "decoded", id: job.id, type: "frames", seq: header.getUint32(8, true), frame: Number(header.getBigUint64(16, true)), cameras: [] } });
  }
}

/** As much of a frame set as its keeper reads. */
function set(seq: number): ArrayBuffer {
  const message = new ArrayBuffer(48);
  const header = new DataView(message);
  header.setUint16(6, CAMERAS, true);
  header.setUint32(8, seq, true);
  header.setBigUint64(16, BigInt(100 + seq), true);
  return message;
}

let frames: Frames;
const settled = () => new Promise((done) => setImmediate(done));

beforeEach(() => {
  FakeWorker.waiting = [];
  Object.assign(globalThis, { Worker: FakeWorker });
  frames = new Frames(new Credit(() => {}), () => ({ contours: false, colour: false }), assert.fail);
  frames.setup({ cameras: new Array(CAMERAS), rule: { out_of_view: "outside" } } as unknown as Hello);
});

test("the last set that came is shown though the connection has gone", async () => {
  frames.came(set(1), true);
  FakeWorker.finish();
  await settled();
  frames.disconnected();
  assert.equal(frames.take(0, false)?.frame, 101);
});

test("a set that was passed over is shown if no other follows", async () => {
  for (const seq of [1, 2]) frames.came(set(seq), seq === 1);
  FakeWorker.finish();
  await settled();
  assert.equal(frames.take(0, false)?.frame, 101);
  frames.disconnected();
  FakeWorker.finish();
  await settled();
  assert.equal(frames.take(0, false)?.frame, 102);
});

test("what is looked back at is shown, however often a connection is tried in vain", async () => {
  for (const seq of [1, 2, 3]) frames.came(set(seq), false);
  frames.lookBack(0);
  frames.look(0);
  FakeWorker.finish();
  await settled();
  frames.disconnected();
  assert.equal(frames.take(0, false)?.frame, 101);
  frames.goLive();
  FakeWorker.finish();
  await settled();
  frames.disconnected();
  assert.equal(frames.take(0, false)?.frame, 103);
});

test("a set of the connection before is not drawn with another rig", async () => {
  frames.came(set(1), true);
  FakeWorker.finish();
  await settled();
  frames.setup({ cameras: new Array(CAMERAS), rule: { out_of_view: "outside" } } as unknown as Hello);
  assert.equal(frames.take(0, false), null);
});
