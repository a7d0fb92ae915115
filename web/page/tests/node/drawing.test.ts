/** When pictures are drawn: what changed at once, what stands more and more finely, and then nothing. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { Drawing } from "../../src/app/drawing.ts";
import { LEVELS, Quality } from "../../src/draw/quality.ts";
import { type Part, REST_MS, SAMPLES } from "../../src/draw/refinement.ts";
import type { Picture, Stage } from "../../src/draw/stage.ts";

/** A graphics card that is done with everything until the next screen refresh, and what it was told to draw. */
class Screen {
  readonly drawn: ("new" | "refined" | Part)[] = [];
  readonly levels: Picture["level"][] = [];
  readonly drawing: Drawing;
  nowMs = 1000;
  isStanding = true;
  isBusy = false;

  constructor(quality = new Quality()) {
    const gl = {
      fenceSync: () => ({}),
      deleteSync: () => undefined,
      flush: () => undefined,
      clientWaitSync: () => (this.isBusy ? 1 : 2),
      isContextLost: () => false,
      TIMEOUT_EXPIRED: 1,
    };
    const stage = {
      renderer: { getContext: () => gl },
      draw: ({ level }: Picture) => void (this.drawn.push("new"), this.levels.push(level)),
      refine: ({ level }: Picture, part: Part) => void (this.drawn.push(part), this.levels.push(level)),
      showRefined: () => void this.drawn.push("refined"),
    };
    this.drawing = new Drawing(stage as unknown as Stage, quality, 2, { drawn: () => undefined, levelChanged: () => undefined });
  }

  /** Screen refreshes for so long. */
  pass(ms: number): void {
    for (const end = this.nowMs + ms; this.nowMs < end; this.nowMs += 16) {
      if (this.drawing.isFree(this.nowMs, false)) this.drawing.drawIfOld(this.nowMs, () => ({}) as Omit<Picture, "level">, this.isStanding);
    }
  }

  get parts(): Part[] {
    return this.drawn.filter((each): each is Part => typeof each === "object");
  }
}

test("what stands is refined after a rest, by as many pictures as it takes, and then nothing is drawn", () => {
  const screen = new Screen();
  screen.pass(REST_MS);
  assert.deepEqual(screen.drawn, ["new"], "the first picture is there at once, and rests");
  screen.pass(20_000);
  assert.equal(screen.parts.filter(({ rows }) => rows === null).length, SAMPLES);
  assert.deepEqual([screen.drawing.count, screen.drawing.refined], [1 + SAMPLES, SAMPLES]);
  const { length } = screen.drawn;
  screen.pass(60_000);
  assert.equal(screen.drawn.length, length, "nothing more is drawn");
});

test("a change gives a new picture at the next refresh, and refining begins once more after a rest", () => {
  for (const waitMs of [REST_MS + 100, REST_MS + 300, 20_000]) {
    const screen = new Screen();
    screen.pass(waitMs);
    assert.ok(screen.parts.length > 0);
    const { length } = screen.drawn;
    screen.drawing.invalidate();
    screen.pass(16);
    assert.deepEqual([screen.drawn.slice(length), screen.drawing.refined], [["new"], 0]);
    screen.pass(20_000);
    assert.deepEqual([screen.drawn.slice(length + 1).filter((each) => each === "new"), screen.drawing.refined], [[], SAMPLES]);
    const first = screen.drawn[length + 1] as Part;
    assert.deepEqual([first.sample, first.rows![0]], [0, 0], "from the first row of the first picture");
  }
});

test("nothing is refined while the world goes on", () => {
  const screen = new Screen();
  screen.isStanding = false;
  screen.pass(20_000);
  assert.deepEqual(screen.drawn, ["new"]);
  // Film that comes faster than a rest is long leaves no time either, whatever the world says.
  screen.isStanding = true;
  for (let frame = 0; frame < 50; frame++) {
    screen.drawing.invalidate();
    screen.pass(REST_MS - 50);
  }
  assert.equal(screen.parts.length, 0);
});

test("no part is begun before the card is done with the one before, and none by a rest that the card spent drawing", () => {
  const screen = new Screen();
  screen.pass(16);
  screen.isBusy = true;
  screen.pass(2 * REST_MS);
  screen.isBusy = false;
  screen.pass(REST_MS - 50);
  assert.equal(screen.parts.length, 0, "the card was done a moment ago");
  screen.pass(100);
  const { length } = screen.drawn;
  assert.ok(screen.parts.length > 0);
  screen.isBusy = true;
  screen.pass(1000);
  assert.equal(screen.drawn.length, length);
});

test("refined pictures have the person at full size, at the effort of one that stands; they change no level", () => {
  const quality = new Quality(4);
  const screen = new Screen(quality);
  screen.pass(20_000);
  assert.deepEqual(screen.levels[0], LEVELS[4]);
  for (const level of screen.levels.slice(1)) assert.deepEqual(level, { ...LEVELS[2], scale: 1 });
  assert.equal(quality.number, 4);
  quality.fixed = 5;
  screen.drawing.invalidate();
  screen.pass(20_000);
  assert.deepEqual(screen.levels.at(-1), { ...LEVELS[5], scale: 1 }, "what was chosen stays");
});

test("when the world goes on and nothing changes, what is refined stays", () => {
  const screen = new Screen(new Quality(4));
  screen.pass(20_000);
  const { length } = screen.drawn;
  screen.isStanding = false;
  screen.pass(5000);
  assert.equal(screen.drawn.length, length);
});

test("a refined picture is drawn once more as it is, until something changes", () => {
  const screen = new Screen();
  screen.pass(REST_MS + 100);
  assert.equal(screen.drawing.drawRefined(), false, "it is not complete");
  screen.pass(20_000);
  assert.equal(screen.drawing.drawRefined(), true);
  assert.equal(screen.drawn.at(-1), "refined");
  screen.drawing.invalidate();
  assert.equal(screen.drawing.drawRefined(), false);
});

test("a lost card refines nothing of what it had", () => {
  const screen = new Screen();
  screen.pass(REST_MS + 200);
  screen.drawing.lost();
  assert.equal(screen.drawing.refined, 0);
  const { length } = screen.drawn;
  screen.pass(5000);
  assert.equal(screen.drawn.length, length, "not before it has drawn something new");
  screen.drawing.invalidate();
  screen.pass(20_000);
  assert.equal(screen.drawn[length], "new");
  assert.equal(screen.drawing.refined, SAMPLES);
});
