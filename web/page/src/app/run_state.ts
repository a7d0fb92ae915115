/**
 * Link, run and graphics card as one state: connected or not, ended, paused, without a hull. Events change it; what badge,
 * banner and the buttons of the timeline show is computed from it. No clock, no page: times are arguments.
 */
import { hasEnded } from "../feed/text.ts";
import { plain } from "../feed/plain.ts";

export interface RunState {
  readonly link: "connecting" | "open" | "lost";
  /** Whether a `hello` has come over this link: what the page shows is the run's. */
  readonly isGreeted: boolean;
  /** Why the link broke, and when it is tried again (milliseconds of the page's clock); null until it breaks. */
  readonly lost: { readonly why: string | null; readonly retryAtMs: number } | null;
  /** The program's last message, if the run is over. */
  readonly ended: string | null;
  readonly isReplay: boolean;
  /** Whether a replay stands at the end of its recording. */
  readonly isAtEnd: boolean;
  readonly isPaused: boolean;
  /** Why there is no hull; null while there is one. */
  readonly blind: string | null;
  /** Whether the graphics card is lost, and with it the picture. */
  readonly isCardLost: boolean;
}

export type RunEvent =
  | { readonly type: "connecting" }
  | { readonly type: "opened" }
  | { readonly type: "lost"; readonly why: string | null; readonly retryAtMs: number }
  | { readonly type: "hello"; readonly isReplay: boolean }
  | { readonly type: "paused"; readonly isPaused: boolean }
  | { readonly type: "end"; readonly isAtEnd: boolean }
  | { readonly type: "blind"; readonly why: string | null }
  | { readonly type: "card"; readonly isLost: boolean };

export const INITIAL: RunState = { link: "connecting", isGreeted: false, lost: null, ended: null, isReplay: false, isAtEnd: false, isPaused: false, blind: null, isCardLost: false };

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
      return { ...state, link: "open", isGreeted: true, lost: null, ended: null, isReplay: event.isReplay, isAtEnd: false, blind: null };
    case "paused":
      return state.isPaused === event.isPaused ? state : { ...state, isPaused: event.isPaused };
    case "end":
      return state.isAtEnd === event.isAtEnd ? state : { ...state, isAtEnd: event.isAtEnd };
    case "blind":
      return state.blind === event.why ? state : { ...state, blind: event.why };
    case "card":
      return state.isCardLost === event.isLost ? state : { ...state, isCardLost: event.isLost };
  }
}

/** Whether the person on the screen is not that of now: drawn grey. The last picture of an ended run is as it should be. */
export function isStale(state: RunState): boolean {
  return state.ended === null && (state.lost !== null || state.blind !== null);
}

/** Whether a replay stands at the end of its recording. That it is played again is known from its worlds first, then from its status. */
function standsAtEnd({ isAtEnd, isPaused }: RunState): boolean {
  return isAtEnd && isPaused;
}

/** What else the words depend on. */
export interface Surroundings {
  readonly nowMs: number;
  readonly framesPerS: number;
  /** Whether there is a view to draw into. */
  readonly canDraw: boolean;
  /** How far before the newest picture one looks, milliseconds; null: at the newest. */
  readonly behindMs: number | null;
  /** Whether the pictures around the one that is looked at are forgotten. */
  readonly isForgotten: boolean;
  /** Whether what is looked back at goes on. */
  readonly isPlaying: boolean;
}

/** What a button is: it can be pressed, it is pressed, or pressing it would do nothing. */
export type ButtonState = "free" | "pressed" | "unavailable";

/** The words of the status line, of the banner and of the timeline, and what its buttons are. */
export interface RunText {
  readonly status: string;
  readonly banner: { readonly text: string; readonly isCalm: boolean; readonly canRetry: boolean } | null;
  readonly timeline: string;
  /** Leads to the newest picture; pressed while what is seen is what happens now. */
  readonly live: ButtonState;
  /** Holds the picture, or lets it go on from where it was held. */
  readonly hold: { readonly action: "hold" | "play" | "play from the oldest"; readonly state: ButtonState };
}

export function describe(state: RunState, around: Surroundings): RunText {
  return { status: status(state, around), banner: banner(state, around.nowMs), timeline: timeline(state, around), live: live(state, around), hold: hold(state, around) };
}

function live(state: RunState, { behindMs, canDraw }: Surroundings): ButtonState {
  if (behindMs !== null) return "free";
  return state.isGreeted && canDraw && !state.isPaused && !state.isReplay && !state.isCardLost ? "pressed" : "unavailable";
}

function hold(state: RunState, { behindMs, isForgotten, isPlaying }: Surroundings): RunText["hold"] {
  if (behindMs !== null) return { action: isPlaying ? "hold" : isForgotten ? "play from the oldest" : "play", state: "free" };
  // A picture that stands already cannot be held.
  return { action: "hold", state: state.isGreeted && !state.isPaused && !state.isCardLost ? "free" : "unavailable" };
}

function status(state: RunState, { framesPerS, canDraw, behindMs }: Surroundings): string {
  if (state.ended !== null) return "Ended";
  if (state.link === "lost") return "Link lost";
  if (state.link === "connecting") return "Connecting…";
  if (state.isCardLost) return "No picture";
  if (standsAtEnd(state)) return "Ended";
  if (state.isPaused) return behindMs === null ? "Paused" : "Paused, looking back";
  if (!state.isGreeted || !canDraw) return "Connected";
  if (behindMs !== null) return "Looking back";
  const frames = framesPerS.toFixed(0);
  return `${state.isReplay ? "Recorded" : "Live"} · ${frames} ${frames === "1" ? "frame" : "frames"}/s`;
}

function banner(state: RunState, nowMs: number): RunText["banner"] {
  const { ended, lost, link, blind, isCardLost } = state;
  if (ended !== null) {
    return { text: `${sentence(plain(ended))} You see its last picture; the bar below looks back.`, isCalm: true, canRetry: false };
  }
  if (lost !== null) {
    const reason = lost.why ? ` (${plain(lost.why)})` : "";
    const left = link === "lost" ? Math.max(0, Math.ceil((lost.retryAtMs - nowMs) / 1000)) : 0;
    return { text: `The link to the program is gone${reason}. Trying again${left > 0 ? ` in ${left} s.` : "…"}`, isCalm: false, canRetry: true };
  }
  if (isCardLost) return { text: "The browser lost the graphics card. The picture returns with it; if it does not, load the page again.", isCalm: false, canRetry: false };
  if (standsAtEnd(state)) return { text: "The recording has ended. It can be played again.", isCalm: true, canRetry: false };
  return blind === null ? null : { text: `Hull unavailable, collisions off: ${plain(blind)}`, isCalm: true, canRetry: false };
}

function timeline(state: RunState, { behindMs, isForgotten }: Surroundings): string {
  if (behindMs !== null) return `−${(behindMs / 1000).toFixed(1)} s${isForgotten ? ", kept" : ""}`;
  if (state.ended !== null || (standsAtEnd(state) && state.lost === null)) return "end";
  if (state.lost !== null) return "last";
  if (state.isPaused) return "paused";
  return state.isReplay ? "newest" : "now";
}

/** What those hear who do not look; null if the change is nothing to speak of. */
export function announcement(before: RunState, after: RunState): string | null {
  if (after.ended !== null && before.ended === null) return sentence(plain(after.ended));
  if (after.lost !== null && before.lost === null) return "The connection was lost.";
  if (after.lost === null && before.lost !== null) return "Connected again.";
  if (after.isCardLost !== before.isCardLost) return after.isCardLost ? "The graphics card was lost." : "The picture is back.";
  if (after.isAtEnd && !before.isAtEnd) return "The recording has ended.";
  if (after.isPaused !== before.isPaused) return after.isPaused ? "The world is paused." : "The world goes on.";
  return null;
}

function sentence(text: string): string {
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}
