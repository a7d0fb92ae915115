/** The view in the address: where one stands, what is drawn. What makes no sense is left out. */

export type HullMode = "photo" | "shaded" | "cones" | "off";
export const HULL_MODES: readonly HullMode[] = ["photo", "shaded", "cones", "off"];

/** Layers by the letter that stands for them. */
export const LAYERS = { bodies: "b", cameras: "c", images: "i", touches: "t", grid: "g", shadows: "s" } as const;
export type Layer = keyof typeof LAYERS;

/** What an address can hold; what is not there stays as it is. */
export interface ViewText {
  readonly eye?: readonly [number, number, number];
  readonly target?: readonly [number, number, number];
  readonly fovDeg?: number;
  readonly mode?: HullMode;
  readonly layers?: ReadonlySet<Layer>;
  /** The camera that is looked through. */
  readonly camera?: string;
  /** The body that is followed. */
  readonly follow?: string;
}

const FAR_M = 1e4;

export function writeHash(view: ViewText): string {
  const parts: string[] = [];
  const point = (p: readonly number[]) => p.map((n) => String(Math.round(n * 1000) / 1000)).join(",");
  if (view.eye) parts.push(`eye=${point(view.eye)}`);
  if (view.target) parts.push(`at=${point(view.target)}`);
  if (view.fovDeg !== undefined) parts.push(`fov=${Math.round(view.fovDeg * 10) / 10}`);
  if (view.mode) parts.push(`mode=${view.mode}`);
  if (view.layers) {
    const letters = (Object.keys(LAYERS) as Layer[]).filter((layer) => view.layers!.has(layer)).map((layer) => LAYERS[layer]);
    parts.push(`layers=${letters.join("")}`);
  }
  if (view.camera !== undefined) parts.push(`camera=${encodeURIComponent(view.camera)}`);
  if (view.follow !== undefined) parts.push(`follow=${encodeURIComponent(view.follow)}`);
  return parts.join("&");
}

export function readHash(hash: string): ViewText {
  const params = new URLSearchParams(hash.replace(/^#/, ""));
  const eye = readPoint(params.get("eye"));
  const target = readPoint(params.get("at"));
  const fov = Number(params.get("fov"));
  const mode = params.get("mode") as HullMode | null;
  const letters = params.get("layers");
  return {
    ...(eye && target && (eye[0] !== target[0] || eye[1] !== target[1] || eye[2] !== target[2]) ? { eye, target } : {}),
    ...(fov >= 5 && fov <= 120 ? { fovDeg: fov } : {}),
    ...(mode && HULL_MODES.includes(mode) ? { mode } : {}),
    ...(letters !== null ? { layers: new Set((Object.keys(LAYERS) as Layer[]).filter((layer) => letters.includes(LAYERS[layer]))) } : {}),
    ...(params.get("camera") ? { camera: params.get("camera")! } : {}),
    ...(params.get("follow") ? { follow: params.get("follow")! } : {}),
  };
}

function readPoint(text: string | null): [number, number, number] | null {
  const numbers = (text ?? "").split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  if (numbers.length !== 3 || !numbers.every((n) => Number.isFinite(n) && Math.abs(n) <= FAR_M)) return null;
  return numbers as [number, number, number];
}
