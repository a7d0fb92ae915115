/** What travels between the page and its decoding worker. */
import type { Box } from "./hull_box.ts";
import type { CameraText } from "../view/lens.ts";
import type { Rect } from "../feed/runs.ts";

/** The rig and its rule: sent once a connection. */
export interface Setup {
  readonly op: "setup";
  readonly cameras: readonly CameraText[];
  readonly volume: Box;
  readonly offImageIsOutside: boolean;
}

/** A message to decode; its buffer is handed over. */
export interface Job {
  readonly op: "decode";
  readonly id: number;
  readonly message: ArrayBuffer;
  /** Whether outlines are wanted. */
  readonly contours: boolean;
  /** Whether images are wanted. */
  readonly colour: boolean;
}

/** One camera, ready for the graphics card. */
export interface DecodedCamera {
  readonly camera: number;
  /** Distances around the silhouette and what is ignored; null if both are empty. */
  readonly field: { readonly rect: Rect; readonly step: number; readonly columns: number; readonly rows: number; readonly bytes: Uint8Array } | null;
  /** What the field of the silhouette alone would cover; null for an empty one. */
  readonly around: Rect | null;
  readonly hasRuns: boolean;
  /** Foreground share of the image. */
  readonly foreground: number;
  readonly image: ImageBitmap | null;
  /** Where the image lies, in full-resolution pixels. */
  readonly crop: Rect;
  readonly contour: Float32Array | null;
  readonly bytes: number;
}

/** A decoded message. */
export interface Decoded {
  readonly op: "decoded";
  readonly id: number;
  readonly type: "frames" | "images";
  readonly seq: number;
  readonly frame: number;
  readonly filmS: number;
  readonly capturedUnixS: number;
  readonly thumbnails: boolean;
  readonly cameras: readonly DecodedCamera[];
  /** The box around the hull; null if there is none. */
  readonly box: Box | null;
  readonly decodeMs: number;
  readonly bytes: number;
}

/** A message that made no sense. */
export interface Failed {
  readonly op: "failed";
  readonly id: number;
  readonly why: string;
}

/** Closes the images of a set that is not drawn. */
export function closeImages(set: Decoded): void {
  for (const part of set.cameras) part.image?.close();
}
