/** What the address asks of a page that stands before an audience: nothing but the picture, and what is behind it. */

/** What is behind the scene: a floor and a sky, nothing, or one colour (0xrrggbb). */
export type Background = "room" | "transparent" | number;

export interface Audience {
  /** No controls, no pointer, no token: the picture alone. */
  readonly isClean: boolean;
  readonly background: Background;
  /** What makes no sense in the address, in a sentence. */
  readonly refused: string | null;
}

const MOST_SHOWN = 40;

export function readAudience(search: string): Audience {
  const params = new URLSearchParams(search);
  const clean = params.get("clean");
  const isClean = clean !== null && clean !== "0" && clean !== "false";
  const asked = params.get("background");
  const colour = /^#?([0-9a-f]{6})$/i.exec(asked ?? "");
  if (asked === null || asked === "room") return { isClean, background: "room", refused: null };
  if (asked === "transparent") return { isClean, background: "transparent", refused: null };
  if (colour) return { isClean, background: parseInt(colour[1], 16), refused: null };
  const shown = asked.length > MOST_SHOWN ? `${asked.slice(0, MOST_SHOWN)}…` : asked;
  return { isClean, background: "room", refused: `background=${shown}: expected transparent, or a colour such as 00ff00` };
}

/** Keeps the screen from going dark while the page is seen, where the browser lets it. */
export function keepAwake(): void {
  const request = () => {
    if (document.visibilityState === "visible") navigator.wakeLock?.request("screen").catch(() => undefined);
  };
  document.addEventListener("visibilitychange", request);
  request();
}
