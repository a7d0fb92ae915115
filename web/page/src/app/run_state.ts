/**
 * Link and run as one state: connected or not, ended, paused, without a hull. Events change it; what the page
 * shows is computed from it. No clock, no page: times are arguments.
 */
import { hasEnded } from "../feed/text.ts";

export interface RunState {
  readonly link: "connecting" | "open" | "lost";
  /** Whether a `hello` has come over this link: what the page shows is the run's. */
  readonly isGreeted: boolean;
  /** Why the link broke, and when it is tried again (milliseconds of the page's clock); null until it breaks. */
  readonly lost: { readonly why: string | null; readonly retryAtMs: number } | null;
  /** The program's last message, if the run is over. */
  readonly ended: string | null;
  readonly isReplay: boolean;
  readonly isPaused: boolean;
  /** Why there is no hull; null while there is one. */
  readonly blind: string | null;
}

export type RunEvent =
  | { readonly type: "connecting" }
  | { readonly type: "opened" }
  | { readonly type: "lost"; readonly why: string | null; readonly retryAtMs: number }
  | { readonly type: "hello"; readonly isReplay: boolean }
  | { readonly type: "paused"; readonly isPaused: boolean }
  | { readonly type: "blind"; readonly why: string | null };

export const INITIAL: RunState = { link: "connecting", isGreeted: false, lost: null, ended: null, isReplay: false, isPaused: false, blind: null };

/** The state after an event; the same object if nothing changed. */
export function reduce(state: RunState, event: RunEvent): RunState {
  switch (event.type) {
    case "connecting":
      return state.link === "connecting" ? state : { ...state, link: "connecting", isGreeted: false };
    case "opened":
      return { ...state, link: "open", isGreeted: false };
    case "lost":
      // A run that has ended stays ended, whatever the attempts to find it again report.
      return { ...state, link: "lost", isGreeted: false, lost: { why: event.why, retryAtMs: event.retryAtMs }, ended: hasEnded(event.why) ? event.why : state.ended };
    case "hello":
      return { ...state, link: "open", isGreeted: true, lost: null, ended: null, isReplay: event.isReplay, blind: null };
    case "paused":
      return state.isPaused === event.isPaused ? state : { ...state, isPaused: event.isPaused };
    case "blind":
      return state.blind === event.why ? state : { ...state, blind: event.why };
  }
}

/** Whether the person on the screen is not that of now: drawn grey. The last picture of an ended run is as it should be. */
export function isStale(state: RunState): boolean {
  return state.ended === null && (state.lost !== null || state.blind !== null);
}

/** What else the words depend on. */
export interface Surroundings {
  readonly nowMs: number;
  readonly framesPerS: number;
  /** Whether there is a view to draw into. */
  readonly canDraw: boolean;
  /** How far before the newest picture one looks, milliseconds; null: at the newest. */
  readonly behindMs: number | null;
}

/** The words of the status line, of the banner and of the timeline. */
export interface RunText {
  readonly status: string;
  readonly banner: { readonly text: string; readonly isCalm: boolean; readonly canRetry: boolean } | null;
  readonly timeline: string;
  /** Whether what is seen is what happens now. */
  readonly isLive: boolean;
}

export function describe(state: RunState, around: Surroundings): RunText {
  const isLive = around.behindMs === null && state.isGreeted && !state.isPaused && !state.isReplay;
  return { status: status(state, around), banner: banner(state, around.nowMs), timeline: timeline(state, around.behindMs), isLive };
}

function status(state: RunState, { framesPerS, canDraw, behindMs }: Surroundings): string {
  if (state.ended !== null) return "Ended";
  if (state.link === "lost") return "Link lost";
  if (state.link === "connecting") return "Connecting…";
  if (state.isPaused) return "Paused";
  if (!state.isGreeted || !canDraw) return "Connected";
  if (behindMs !== null) return "Looking back";
  return `${state.isReplay ? "Recorded" : "Live"} · ${framesPerS.toFixed(0)} frames/s`;
}

function banner({ ended, lost, link, blind }: RunState, nowMs: number): RunText["banner"] {
  if (ended !== null) {
    return { text: `${sentence(ended)} You see its last picture; the bar below looks back.`, isCalm: true, canRetry: false };
  }
  if (lost !== null) {
    const reason = lost.why ? ` (${lost.why})` : "";
    const left = link === "lost" ? Math.max(0, Math.ceil((lost.retryAtMs - nowMs) / 1000)) : 0;
    return { text: `The link to the program is gone${reason}. Trying again${left > 0 ? ` in ${left} s.` : "…"}`, isCalm: false, canRetry: true };
  }
  return blind === null ? null : { text: `Hull unavailable, collisions off: ${blind}`, isCalm: true, canRetry: false };
}

function timeline(state: RunState, behindMs: number | null): string {
  if (behindMs !== null) return `−${(behindMs / 1000).toFixed(1)} s`;
  if (state.ended !== null) return "end";
  if (state.lost !== null) return "last";
  if (state.isPaused) return "paused";
  return state.isReplay ? "newest" : "live";
}

/** What those hear who do not look; null if the change is nothing to speak of. */
export function announcement(before: RunState, after: RunState): string | null {
  if (after.ended !== null && before.ended === null) return sentence(after.ended);
  if (after.lost !== null && before.lost === null) return "The connection was lost.";
  if (after.lost === null && before.lost !== null) return "Connected again.";
  if (after.isPaused !== before.isPaused) return after.isPaused ? "The world is paused." : "The world goes on.";
  return null;
}

function sentence(text: string): string {
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}
