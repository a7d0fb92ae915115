import assert from "node:assert/strict";
import { test } from "node:test";
import { announcement, describe, INITIAL, isStale, reduce, type RunEvent, type RunState, type Surroundings } from "../../src/app/run_state.ts";

const after = (...events: RunEvent[]) => events.reduce(reduce, INITIAL);
const CONNECTING = { type: "connecting" } as const;
const OPENED = { type: "opened" } as const;
const HELLO = { type: "hello", isReplay: false } as const;
const PAUSED = { type: "paused", isPaused: true } as const;
const BLIND = { type: "blind", why: "node a is gone" } as const;
const lost = (why: string | null, retryAtMs = 0) => ({ type: "lost", why, retryAtMs }) as const;

const AROUND: Surroundings = { nowMs: 0, framesPerS: 29.6, canDraw: true, behindMs: null };
const words = (state: RunState, around: Partial<Surroundings> = {}) => describe(state, { ...AROUND, ...around });

test("a page connects, is greeted, and is live", () => {
  assert.equal(words(INITIAL).status, "Connecting…");
  assert.equal(words(after(OPENED)).status, "Connected");
  const live = after(CONNECTING, OPENED, HELLO);
  assert.deepEqual(words(live), { status: "Live · 30 frames/s", banner: null, timeline: "live", isLive: true });
  assert.equal(words(live, { canDraw: false }).status, "Connected");
  assert.equal(isStale(live), false);
});

test("a paused run is not live: no pressed Live beside Paused", () => {
  const paused = after(OPENED, HELLO, PAUSED);
  assert.deepEqual(words(paused), { status: "Paused", banner: null, timeline: "paused", isLive: false });
  assert.equal(words(reduce(paused, { type: "paused", isPaused: false })).isLive, true);
});

test("a run that is looked back at is not live either", () => {
  const { status, timeline, isLive } = words(after(OPENED, HELLO), { behindMs: 2340 });
  assert.deepEqual([status, timeline, isLive], ["Looking back", "−2.3 s", false]);
  assert.equal(words(after(OPENED, HELLO, PAUSED), { behindMs: 0 }).status, "Paused");
});

test("a recording is called recorded, not live", () => {
  const replay = after(OPENED, { type: "hello", isReplay: true });
  assert.deepEqual(words(replay), { status: "Recorded · 30 frames/s", banner: null, timeline: "newest", isLive: false });
});

test("a lost link is counted down, greys the person, and is over with the next hello", () => {
  const gone = after(OPENED, HELLO, lost(null, 2500));
  assert.equal(words(gone, { nowMs: 600 }).banner!.text, "The link to the program is gone. Trying again in 2 s.");
  assert.deepEqual([words(gone).status, words(gone).timeline, words(gone).isLive], ["Link lost", "last", false]);
  assert.ok(isStale(gone) && words(gone).banner!.canRetry && !words(gone).banner!.isCalm);
  const trying = reduce(gone, CONNECTING);
  assert.equal(words(trying).banner!.text, "The link to the program is gone. Trying again…");
  // A socket alone is no run: a proxy may take it and close it again.
  assert.ok(words(reduce(trying, OPENED)).banner && isStale(reduce(trying, OPENED)));
  const back = [CONNECTING, OPENED, HELLO].reduce(reduce, gone);
  assert.deepEqual([words(back).banner, isStale(back)], [null, false]);
});

test("the program's reason is told", () => {
  assert.match(words(after(OPENED, HELLO, lost("a message that is none"))).banner!.text, /is gone \(a message that is none\)\./);
});

test("an ended run stays as it was, however often it is looked for again", () => {
  const ended = after(OPENED, HELLO, lost("the run has ended", 500), CONNECTING, lost(null, 1500), CONNECTING, lost(null, 3500));
  const { status, banner, timeline, isLive } = words(ended);
  assert.deepEqual([status, timeline, isLive], ["Ended", "end", false]);
  assert.deepEqual(banner, { text: "The run has ended. You see its last picture; the bar below looks back.", isCalm: true, canRetry: false });
  assert.equal(isStale(ended), false, "the person does not go dark");
  assert.equal(words([CONNECTING, OPENED, HELLO].reduce(reduce, ended)).status, "Live · 30 frames/s");
});

test("without a hull the banner says what that means, and the person that is left is grey", () => {
  const blind = after(OPENED, HELLO, BLIND);
  assert.deepEqual(words(blind).banner, { text: "Hull unavailable, collisions off: node a is gone", isCalm: true, canRetry: false });
  assert.ok(isStale(blind));
  const again = reduce(blind, { type: "blind", why: null });
  assert.deepEqual([words(again).banner, isStale(again)], [null, false]);
});

test("a broken link matters more than a missing hull, and the next run begins with a hull", () => {
  const gone = after(OPENED, HELLO, BLIND, lost(null));
  assert.match(words(gone).banner!.text, /^The link/);
  assert.equal(words(reduce(gone, HELLO)).banner, null);
});

test("cameras that go first when a run ends do not darken its last picture", () => {
  assert.equal(isStale(after(OPENED, HELLO, BLIND, lost("the run has ended"))), false);
});

test("what is told again changes nothing", () => {
  const state = after(OPENED, HELLO, PAUSED, BLIND);
  for (const event of [PAUSED, BLIND]) assert.equal(reduce(state, event), state);
  assert.equal(reduce(INITIAL, CONNECTING), INITIAL);
});

test("changes are spoken once", () => {
  const spoken = (...events: RunEvent[]) => {
    let state = INITIAL;
    return events.flatMap((event) => {
      const next = reduce(state, event);
      const text = announcement(state, next);
      state = next;
      return text === null ? [] : [text];
    });
  };
  assert.deepEqual(spoken(OPENED, HELLO, PAUSED, PAUSED, { type: "paused", isPaused: false }), ["The world is paused.", "The world goes on."]);
  assert.deepEqual(spoken(OPENED, HELLO, lost(null), CONNECTING, lost(null), CONNECTING, OPENED, HELLO), ["The connection was lost.", "Connected again."]);
  assert.deepEqual(spoken(OPENED, HELLO, lost("the recording has ended"), lost(null)), ["The recording has ended."]);
});
