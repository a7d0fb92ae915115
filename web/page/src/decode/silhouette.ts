/** A camera's silhouette as it is judged and drawn: with what the camera ignores. */
import { type DistanceField, distanceField, fieldRect, fieldStep, type Scratch } from "../feed/distance.ts";
import { type Rect, type Runs, union } from "../feed/runs.ts";
import type { Camera } from "../view/lens.ts";

export interface Silhouette {
  /** Distances to the foreground and what is ignored: beyond both the camera carves. Null if both are empty. */
  readonly field: DistanceField | null;
  /** Distances to the foreground alone, if its outline is wanted. */
  readonly outlined: DistanceField | null;
  /** What the field of the foreground alone covers; null for an empty one. */
  readonly around: Rect | null;
}

/** `pastEdge`: what is off the image counts as background, as in {@link distanceField}. */
export function silhouetteOf(camera: Camera, runs: Runs, pastEdge: boolean, isOutlined: boolean, scratch: Scratch): Silhouette {
  const step = fieldStep(camera.width, camera.height);
  const { ignored } = camera;
  // What is ignored carves nothing, whatever the silhouette has there.
  const field = distanceField(ignored ? union(runs, ignored) : runs, pastEdge, step, scratch);
  const outline = () => (ignored ? distanceField(runs, pastEdge, step, scratch) : field);
  const around = runs.bounds && fieldRect(runs.bounds, runs.width, runs.height, pastEdge, step);
  return { field, outlined: isOutlined ? outline() : null, around };
}
