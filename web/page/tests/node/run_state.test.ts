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

const AROUND: Surroundings = { nowMs: 0, framesPerS: 29.6, canDraw: true, behindMs: null, isForgotten: false, isPlaying: false };
const HOLD = { action: "hold", state: "free" } as const;
const NO_HOLD = { action: "hold", state: "unavailable" } as const;
const words = (state: RunState, around: Partial<Surroundings> = {}) => describe(state, { ...AROUND, ...around });

test("a page connects, is greeted, and is live", () => {
  assert.equal(words(INITIAL).status, "Connecting…");
  assert.equal(words(after(OPENED)).status, "Connected");
  const live = after(CONNECTING, OPENED, HELLO);
  assert.deepEqual(words(live), { status: "Live · 30 frames/s", banner: null, timeline: "now", live: "pressed", hold: HOLD });
  assert.equal(words(live, { framesPerS: 1.2 }).status, "Live · 1 frame/s");
  assert.equal(words(live, { canDraw: false }).status, "Connected");
  for (const early of [INITIAL, after(OPENED)]) assert.deepEqual([words(early).live, words(early).hold], ["unavailable", NO_HOLD]);
  assert.equal(isStale(live), false);
});

test("a paused run is not live: what leads to the newest picture and what holds it are unavailable", () => {
  const paused = after(OPENED, HELLO, PAUSED);
  assert.deepEqual(words(paused), { status: "Paused", banner: null, timeline: "paused", live: "unavailable", hold: NO_HOLD });
  assert.equal(words(reduce(paused, { type: "paused", isPaused: false })).live, "pressed");
});

test("a run that is looked back at is not live either", () => {
  const { status, timeline, live, hold } = words(after(OPENED, HELLO), { behindMs: 2340 });
  assert.deepEqual([status, timeline, live, hold], ["Looking back", "−2.3 s", "free", { action: "play", state: "free" }]);
  assert.deepEqual(words(after(OPENED, HELLO), { behindMs: 900, isPlaying: true }).hold, HOLD);
  assert.equal(words(after(OPENED, HELLO), { behindMs: 12_300, isForgotten: true }).timeline, "−12.3 s, kept");
  assert.equal(words(after(OPENED, HELLO, PAUSED), { behindMs: 0 }).status, "Paused, looking back");
});

test("without a graphics card nothing is live", () => {
  const lostCard = after(OPENED, HELLO, { type: "card", isLost: true });
  const { status, banner, live } = words(lostCard);
  assert.deepEqual([status, live], ["No picture", "unavailable"]);
  assert.match(banner!.text, /graphics card/);
  assert.deepEqual(words(reduce(lostCard, { type: "card", isLost: false })).live, "pressed");
});

test("a recording is called recorded, not live", () => {
  const replay = after(OPENED, { type: "hello", isReplay: true });
  assert.deepEqual(words(replay), { status: "Recorded · 30 frames/s", banner: null, timeline: "newest", live: "unavailable", hold: HOLD });
});

test("a recording that has ended stands there and can be played again", () => {
  const end = { type: "end", isAtEnd: true } as const;
  const ended = after(OPENED, { type: "hello", isReplay: true }, PAUSED, end);
  const { status, banner, timeline } = words(ended);
  assert.deepEqual([status, timeline], ["Ended", "end"]);
  assert.deepEqual(banner, { text: "The recording has ended. It can be played again.", isCalm: true, canRetry: false });
  assert.equal(reduce(ended, end), ended, "nothing changed");
  const again = reduce(ended, { type: "paused", isPaused: false });
  assert.deepEqual([words(again).status, words(again).banner], ["Recorded · 30 frames/s", null]);
  assert.equal(words(reduce(ended, { type: "end", isAtEnd: false })).status, "Paused");
  assert.equal(announcement(after(OPENED, HELLO, PAUSED), reduce(after(OPENED, HELLO, PAUSED), end)), "The recording has ended.");
  assert.equal(words(after(OPENED, HELLO, PAUSED, end, HELLO)).status, "Paused", "another run has not");
});

test("a lost link is counted down, greys the person, and is over with the next hello", () => {
  const gone = after(OPENED, HELLO, lost(null, 2500));
  assert.equal(words(gone, { nowMs: 600 }).banner!.text, "The link to the program is gone. Trying again in 2 s.");
  assert.deepEqual([words(gone).status, words(gone).timeline, words(gone).live, words(gone).hold], ["Link lost", "last", "unavailable", NO_HOLD]);
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
  const { status, banner, timeline, live } = words(ended);
  assert.deepEqual([status, timeline, live], ["Ended", "end", "unavailable"]);
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
