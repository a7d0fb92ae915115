/** What the page can use now: the server sends no more than that. */
import type { Want } from "../feed/connection.ts";
import type { Hello } from "../feed/text.ts";
import type { HullMode, Layer } from "../view/hash.ts";

/** Levels from here on are those of a page that cannot show all that it is sent. */
const WEAK_LEVEL = 4;

/** What the wants depend on. */
export interface View {
  /** Whether there is WebGL2 to draw with. */
  readonly canDraw: boolean;
  readonly isHidden: boolean;
  readonly quality: { readonly number: number; readonly fixed: number | null };
  readonly mode: HullMode;
  readonly colour: Want["colour"];
  readonly layers: ReadonlySet<Layer>;
  /** The camera that is looked through, by its place in the rig, and how much of its image is seen. */
  readonly through: number | null;
  readonly opacity: number;
  /** Whether the panel shows small images. */
  readonly wantsThumbnails: boolean;
}

export function wantOf(view: View, hello: Hello): Want {
  const { canDraw, isHidden, quality, mode, colour, layers, through } = view;
  const isWeak = canDraw && quality.number >= WEAK_LEVEL && quality.fixed === null;
  const isDrawn = canDraw && mode !== "off";
  const hasImages = (layers.has("cameras") && layers.has("images")) || view.wantsThumbnails;
  return {
    colour: mode === "photo" && isDrawn && !isHidden ? (isWeak && colour === "full" ? "half" : colour) : "off",
    fps: isHidden ? 1 : Math.min(60, Math.max(1, Math.round(hello.fps))),
    state_hz: isHidden ? 1 : 60,
    touches: layers.has("touches"),
    // Ripples and rims need to know what is touched and where. Patches are 208 bytes a touched body at most, samples ten times as much.
    patches: canDraw,
    thumbnails_hz: isHidden ? 0 : !canDraw ? 4 : hasImages ? 1 : 0,
    image_of: through !== null && !isHidden && view.opacity > 0 ? (hello.cameras[through]?.name ?? null) : null,
    silhouettes: isDrawn && !isHidden,
  };
}
