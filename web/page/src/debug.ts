/**
 * `window.hulltouch`: state and pictures for tests and for debugging. Pictures are of the person alone, from any
 * view, at any size, independent of the screen.
 */
import type { App } from "./app/app.ts";
import { clipOf, type Eye, eyeOfCamera, FAR_M, NEAR_M } from "./draw/eye.ts";
import type { BodyTools } from "./ui/body_tools.ts";
import type { CameraText, Mat3, Vec3 } from "./view/lens.ts";

/** A pinhole: fx, fy, cx, cy with pixel centres at whole numbers. */
export interface View {
  readonly rotation: Mat3;
  readonly translation: Vec3;
  readonly pinhole: readonly [number, number, number, number];
}

/** A camera of the rig by its place, or a pinhole. */
export type From = { readonly camera: number } | View;

/** A picture, rows from the top. */
export interface TestPicture {
  readonly width: number;
  readonly height: number;
  /** Base 64 of four bytes a pixel; alpha is 255 on the person and 0 beside it. */
  readonly rgba: string;
  /** Base 64 of float32, metres along the view's axis; 0 beside the person. */
  readonly depthM: string;
  /** The frame it is of. */
  readonly frame: number | null;
}

export interface Debug {
  /** Counts and states. */
  state(): Record<string, unknown>;
  /** The run's cameras. */
  rig(): readonly CameraText[];
  /** The person alone; null without a hull, or without WebGL2. */
  picture(from: From, width: number, height: number, mode?: "photo" | "shaded"): TestPicture | null;
  /** The view of the last picture, pixels of the drawing buffer: what {@link picture} takes. */
  view(): View | null;
  /** Where a point of the world is on the canvas, CSS pixels; null behind the view. */
  onCanvas(point: Vec3): [number, number] | null;
  /** The body under a point of the canvas; null if there is none, or something before it. */
  bodyAt(x: number, y: number): number | null;
  /** What is under a point of the canvas: body, person, floor or nothing. */
  placeAt(x: number, y: number): string | null;
  /** Bodies that never move. */
  fixedBodies(): number[];
}

export function debug(app: App, tools: BodyTools, version: string): Debug {
  return {
    state: () => ({
      version,
      link: app.connection.open,
      controller: app.controller,
      mode: app.mode,
      layers: [...app.layers],
      through: app.through,
      follow: app.follow,
      paused: app.run.isPaused,
      isGrey: app.isGrey,
      live: app.frames.playout.live,
      behindMs: app.frames.playout.behindMs ?? 0,
      eye: app.orbit.eye(),
      target: app.orbit.now.target,
      framesShown: app.frames.count,
      frame: app.frames.shown?.frame ?? null,
      frameCameras: app.frames.shown?.cameras ?? 0,
      timelineFrame: app.frames.timeline.at(app.frames.playout.moment ?? Infinity)?.frame ?? null,
      worldFrame: app.worlds.newest()?.frame ?? null,
      pictures: app.drawing?.count ?? 0,
      refined: app.drawing?.refined ?? 0,
      looks: app.frames.looks,
      isReady: app.frames.isReady,
      isDecoding: app.frames.isDecoding,
      quality: app.quality.number,
      colours: app.status?.feed?.tier ?? null,
      drawMs: app.quality.averageMs,
      latencyMs: app.frames.latency.get(),
      receivedBytes: app.connection.received,
      stalls: app.frames.stalls,
      outstanding: app.connection.credit.outstanding,
      timelineFrames: app.frames.timeline.length,
      timelineMs: (([from, to]) => to - from)(app.frames.timeline.span() ?? [0, 0]),
      cameras: app.hello?.cameras.length ?? 0,
      scene: app.scene?.scene ?? null,
      parameters: app.scene?.parameters ?? {},
      generation: app.moment?.world.generation ?? null,
      step: app.worlds.newest()?.step ?? null,
      bodies: (app.moment?.bodies ?? []).map((body) => ({ ...body, isElsewhere: app.stage?.bodies.isHeldElsewhere(body.id) ?? false, name: app.scene?.bodies.find(({ id }) => id === body.id)?.name ?? null })),
      touchesDrawn: app.layers.has("touches") ? (app.stage?.touches.count ?? 0) : 0,
      ripples: app.stage?.ripples.count ?? 0,
      preview: app.stage?.preview.place ?? null,
      patchesDrawn: app.layers.has("touches") ? (app.stage?.patches.count ?? 0) : 0,
      box: app.stage?.hull?.box ?? null,
      hasBackdrop: app.stage?.cameras?.backdrop.visible ?? false,
    }),
    rig: () => app.hello?.cameras ?? [],
    picture: (from, width, height, mode = "photo") => picture(app, from, width, height, mode),
    view: () => (app.stage?.seen ? viewOf(app.stage.seen) : null),
    onCanvas: (point) => app.onCanvas(point),
    bodyAt: (x, y) => tools.hit(x, y, false)?.body ?? null,
    placeAt: (x, y) => tools.hit(x, y)?.what ?? null,
    fixedBodies: () => (app.scene?.bodies ?? []).filter(({ fixed }) => fixed).map(({ id }) => id),
  };
}

function picture(app: App, from: From, width: number, height: number, mode: "photo" | "shaded"): TestPicture | null {
  const { stage } = app;
  if (!stage) return null;
  let eye: Eye;
  if ("camera" in from) {
    const camera = app.rig[from.camera];
    if (!camera) return null;
    eye = eyeOfCamera(camera, width, height);
  } else {
    eye = eyeOfPinhole(from);
  }
  const made = stage.hullPicture(eye, width, height, mode);
  app.invalidate();
  if (!made) return null;
  const rgba = new Uint8Array(width * height * 4);
  const depth = new Float32Array(width * height);
  for (let row = 0; row < height; row++) {
    const below = height - 1 - row;
    rgba.set(made.rgba.subarray(below * width * 4, (below + 1) * width * 4), row * width * 4);
    for (let column = 0; column < width; column++) {
      const d = made.depth[below * width + column] * 2 - 1;
      const metres = (2 * FAR_M * NEAR_M) / (FAR_M + NEAR_M - d * (FAR_M - NEAR_M));
      depth[row * width + column] = made.rgba[(below * width + column) * 4 + 3] > 0 ? metres : 0;
    }
  }
  return { width, height, rgba: base64(rgba), depthM: base64(new Uint8Array(depth.buffer)), frame: (app.frames.shown?.frame ?? null) };
}

function viewOf({ position, turn: t, pinhole: [fx, fy, cx, cy] }: Eye): View {
  const rotation: Mat3 = [[t[0], t[3], t[6]], [t[1], t[4], t[7]], [t[2], t[5], t[8]]];
  const along = (r: Vec3) => -(r[0] * position[0] + r[1] * position[1] + r[2] * position[2]);
  return { rotation, translation: [along(rotation[0]), along(rotation[1]), along(rotation[2])], pinhole: [fx, fy, cx - 0.5, cy - 0.5] };
}

function eyeOfPinhole(from: View): Eye {
  const [r0, r1, r2] = from.rotation;
  const t = from.translation;
  const [fx, fy, cx, cy] = from.pinhole;
  const at = (i: 0 | 1 | 2) => -(r0[i] * t[0] + r1[i] * t[1] + r2[i] * t[2]);
  return {
    position: [at(0), at(1), at(2)],
    turn: [r0[0], r1[0], r2[0], r0[1], r1[1], r2[1], r0[2], r1[2], r2[2]],
    pinhole: [fx, fy, cx + 0.5, cy + 0.5],
    skew: 0,
    lens: [0, 0, 0, 0, 0],
    clip: clipOf(from.rotation, t),
  };
}

function base64(bytes: Uint8Array): string {
  let text = "";
  for (let at = 0; at < bytes.length; at += 8192) text += String.fromCharCode(...bytes.subarray(at, at + 8192));
  return btoa(text);
}
