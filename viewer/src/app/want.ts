/** What the page can use now: the server sends no more than that. */
import type { Want } from "../feed/connection.ts";
import type { Hello } from "../feed/text.ts";
import type { App } from "./app.ts";

/** Levels from here on are those of a page that cannot show all that it is sent. */
const WEAK_LEVEL = 4;

export function wantOf(app: App, hello: Hello): Want {
  const { hidden } = document;
  const { stage, mode, colour, layers } = app;
  const isWeak = stage !== null && app.quality.number >= WEAK_LEVEL && app.quality.fixed === null;
  const isDrawn = stage !== null && (mode === "photo" || mode === "shaded" || mode === "cones");
  const hasImages = (layers.has("cameras") && layers.has("images")) || app.wantsThumbnails;
  return {
    colour: mode === "photo" && isDrawn && !hidden ? (isWeak && colour === "full" ? "half" : colour) : "off",
    fps: hidden ? 1 : Math.min(60, Math.max(1, Math.round(hello.fps))),
    state_hz: hidden ? 1 : 60,
    touches: layers.has("touches"),
    thumbnails_hz: hidden ? 0 : stage === null ? 4 : hasImages ? 1 : 0,
    image_of: app.through !== null && !hidden && app.opacity > 0 ? (app.rig[app.through]?.name ?? null) : null,
    silhouettes: isDrawn && !hidden,
  };
}
