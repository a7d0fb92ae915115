/**
 * The slider over a whole recording: where it stands, and which seeks a viewer's moves become. No page and no clock: times
 * are arguments, milliseconds; places are film times, seconds.
 */

/** Seeks follow each other no sooner, milliseconds: the program makes the run again for each. */
export const SEEK_EVERY_MS = 100;
/** Once the world is so near, the slider follows it again, seconds. */
const NEAR_S = 0.25;
/** A place that the world has not come near by then was another's or was passed, milliseconds. */
const SETTLED_MS = 1000;
/** What arrow keys move, and what page keys move, seconds. */
const ARROW_S = 0.5;
const PAGE_S = 5;

export class FilmSlider {
  /** Where the viewer has moved it; null: it follows the world. */
  private wanted: number | null = null;
  private isUnsent = false;
  private sentMs = -Infinity;
  private held = false;

  /** Whether the viewer has it in hand. */
  get isHeld(): boolean {
    return this.held;
  }

  /** The viewer takes it. */
  hold(): void {
    this.held = true;
  }

  /** The viewer moves it to a place; what is to be sought now, if anything. */
  move(place: number, nowMs: number): number | null {
    this.wanted = place;
    this.isUnsent = true;
    return this.due(nowMs);
  }

  /** What is to be sought by now: the newest place, once it is time again. */
  due(nowMs: number): number | null {
    return this.isUnsent && nowMs - this.sentMs >= SEEK_EVERY_MS ? this.send(nowMs) : null;
  }

  /** The viewer lets go: the last place is sought, however soon after another. */
  release(nowMs: number): number | null {
    this.held = false;
    return this.isUnsent ? this.send(nowMs) : null;
  }

  /** Where it stands: at the place that is wanted until the world is there. */
  place(world: { readonly filmS: number; readonly isSeeking: boolean }, nowMs: number): number {
    const isSettled = !world.isSeeking && nowMs - this.sentMs > SETTLED_MS;
    if (this.wanted !== null && !this.held && !this.isUnsent && (isSettled || Math.abs(world.filmS - this.wanted) <= NEAR_S)) this.wanted = null;
    return this.wanted ?? world.filmS;
  }

  private send(nowMs: number): number | null {
    this.isUnsent = false;
    this.sentMs = nowMs;
    return this.wanted;
  }
}

/** Where a key moves the slider of a recording; null: the key is none of its own. */
export function placeByKey(key: string, place: number, lengthS: number): number | null {
  const places: Record<string, number> = {
    ArrowLeft: place - ARROW_S,
    ArrowDown: place - ARROW_S,
    ArrowRight: place + ARROW_S,
    ArrowUp: place + ARROW_S,
    PageDown: place - PAGE_S,
    PageUp: place + PAGE_S,
    Home: 0,
    End: lengthS,
  };
  const there = places[key];
  return there === undefined ? null : Math.max(0, Math.min(lengthS, there));
}

/** A place at which the frame before (−1) or after (+1) that of another is seen: its end, for the run stands at the last step before a place. */
export function besideFrame(place: number, direction: 1 | -1, fps: number, lengthS: number): number {
  // Sums of times fall short of frames.
  const frame = Math.floor(place * fps + 1e-6) + direction;
  return Math.max(0, Math.min(lengthS, (frame + 1) / fps - 1e-6));
}

/** A place as minutes, seconds and tenths. */
export function placeText(place: number): string {
  const tenths = Math.floor(Math.max(0, place) * 10 + 1e-6);
  const seconds = (tenths % 600) / 10;
  return `${Math.floor(tenths / 600)}:${seconds < 10 ? "0" : ""}${seconds.toFixed(1)}`;
}

/** A length as minutes and seconds. */
export function lengthText(lengthS: number): string {
  const seconds = Math.round(Math.max(0, lengthS));
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
}
