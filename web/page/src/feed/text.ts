/** The feed's text messages: JSON, checked where the page would otherwise trip over it. */
import type { Box } from "../decode/hull_box.ts";
import { type CameraText, type Mat3, type Vec3 } from "../view/lens.ts";
import { MAX_CAMERAS } from "./message.ts";
import { decodeRuns, type Runs } from "./runs.ts";

/** Why a text is no message: one line. */
export class TextError extends Error {}

export interface Rule {
  readonly min_views: number;
  readonly out_of_view: "outside" | "abstain";
}

/** The first message of a connection. */
export interface Hello {
  readonly op: "hello";
  readonly program: string;
  readonly session: string;
  readonly controller: boolean;
  readonly fps: number;
  readonly dt_s: number;
  readonly latency_s: number;
  readonly cameras: readonly CameraText[];
  readonly rule: Rule;
  readonly up: Vec3;
  readonly floor_m: number | null;
  readonly volume: Box;
  readonly scenes: readonly string[];
  readonly responses: readonly string[];
  readonly colour: boolean;
  /** A recorded run made again: it can be played in other ways, and not changed. */
  readonly replay: boolean;
  /** Film time of the recording's last step, seconds; undefined if the run is no replay, or cannot be sought. */
  readonly length_s?: number;
  /** Whether film waits while the run is paused: then a step shows the person of that step. */
  readonly film_waits: boolean;
  /** What others on the way may read, in words; null if all is encrypted, or stays on one machine. */
  readonly insecure: string | null;
}

export type Shape =
  | { readonly box: { readonly size: Vec3 } }
  | { readonly ball: { readonly radius: number } }
  | { readonly capsule: { readonly radius: number; readonly length: number } }
  | { readonly cylinder: { readonly radius: number; readonly height: number } }
  | { readonly cone: { readonly radius: number; readonly height: number } }
  | { readonly hull: { readonly corners: readonly Vec3[]; readonly faces: readonly Vec3[] } };

export interface BodyText {
  readonly id: number;
  readonly name: string;
  /** sRGB, 0 to 1. */
  readonly color: Vec3;
  readonly fixed: boolean;
  readonly shape: Shape;
}

export interface Parameters {
  readonly answers_hull: boolean;
  readonly hull_restitution: number;
  readonly hull_friction: number;
  readonly gravity_m_s2: Vec3;
}

/** Bodies and parameters, whenever they change. */
export interface Scene {
  readonly op: "scene";
  readonly generation: number;
  readonly version: number;
  readonly scene: string;
  readonly parameters: Partial<Parameters>;
  /** Height of its floor along up, metres; null for none, undefined if the server does not say. */
  readonly floor_m?: number | null;
  readonly bodies: readonly BodyText[];
}

export interface CameraStatus {
  readonly name: string;
  readonly problem?: string | null;
  readonly newest_frame?: number | null;
  readonly age_ms?: number;
  /** By what its frames are numbered. */
  readonly stamps?: string;
  /** How far its captures are from the middle of all cameras', and how far its film time may be off. */
  readonly sync_ms?: number;
  readonly clock_bound_ms?: number;
  readonly foreground?: number;
  readonly silhouette_bytes?: number;
  readonly segment_ms?: number;
  /** How late nearly all its frames are; null if that is not measured. And by how much all others wait for it. */
  readonly late_ms?: number | null;
  readonly costs_ms?: number;
  /** Steps go on without it. */
  readonly left_out?: boolean;
}

/** Whether a run goes on without a camera. */
export function isGone({ problem, left_out }: CameraStatus): boolean {
  return Boolean(problem) || left_out === true;
}

/** How a recording is played. */
export interface ReplayStatus {
  /** Seconds of film in a second. */
  readonly speed?: number;
  /** Whether it begins again at its end. */
  readonly loop?: boolean;
  /** Film time that is being sought, seconds. */
  readonly seeking_s?: number | null;
  /** Whether the run stands at its end. */
  readonly ended?: boolean;
}

/** How the run and the feed do, four times a second. Figures that a server leaves out are not shown. */
export interface Status {
  readonly op: "status";
  readonly progress?: {
    readonly film_s?: number;
    readonly frame?: number | null;
    readonly steps_per_s?: number;
    readonly passes_per_s?: number;
    readonly p50_ms?: number;
    readonly p99_ms?: number;
    readonly samples?: number;
    readonly contacts?: number;
    /** From the capture of the film that bodies collide with to the end of the step; null if no step had a hull. */
    readonly hull_age_ms?: number | null;
    /** How long after its film time a step is made. */
    readonly latency_ms?: number;
    readonly bytes_per_s?: number;
    readonly blind?: string | null;
  };
  readonly cameras?: readonly CameraStatus[];
  readonly frames_missed?: number;
  readonly frames_expected?: number;
  readonly late_steps?: number;
  readonly blind_steps?: number;
  /** Steps that went on without some camera. */
  readonly reduced_steps?: number;
  readonly blind?: string | null;
  readonly paused?: boolean;
  /** Of a replay alone. */
  readonly replay?: ReplayStatus;
  readonly feed?: {
    readonly bytes_per_s?: number;
    readonly sent?: number;
    readonly dropped?: number;
    readonly tier?: string;
    readonly pages?: number;
  };
}

export type Text =
  | Hello
  | Scene
  | Status
  | { readonly op: "done"; readonly id: number; readonly body?: number; readonly undo?: boolean }
  | { readonly op: "refused"; readonly id: number; readonly why: string }
  | { readonly op: "bye"; readonly why: string };

/** Whether a server went because there is no more to show. */
export function hasEnded(why: string | null): boolean {
  return why !== null && / has ended$/.test(why);
}

/** Reads a text message; null for an op that this page does not know (a newer server's). */
export function parseText(text: string): Text | null {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    throw new TextError("a text message that is not JSON");
  }
  if (!isRecord(value) || typeof value.op !== "string") throw new TextError("a text message without op");
  switch (value.op) {
    case "hello":
      return hello(value);
    case "scene":
      return scene(value);
    case "status":
      return value as unknown as Status;
    case "done":
    case "refused":
      if (typeof value.id !== "number") throw new TextError(`${value.op} without an id`);
      return value as unknown as Text;
    case "bye":
      return { op: "bye", why: String(value.why ?? "") };
    default:
      return null;
  }
}

function hello(value: Record<string, unknown>): Hello {
  if (value.version !== 1) throw new TextError(`the server has version ${String(value.version)}, this page version 1: reload it`);
  const cameras = list(value.cameras, "cameras");
  if (cameras.length > MAX_CAMERAS) throw new TextError(`${cameras.length} cameras, expected ${MAX_CAMERAS} at most`);
  const rule = isRecord(value.rule) ? value.rule : {};
  const volume = isRecord(value.volume) ? value.volume : {};
  return {
    op: "hello",
    program: String(value.program ?? ""),
    session: String(value.session ?? ""),
    controller: value.controller === true,
    fps: positive(value.fps, "fps"),
    dt_s: positive(value.dt_s ?? 1 / 120, "dt_s"),
    latency_s: typeof value.latency_s === "number" ? value.latency_s : 0,
    cameras: cameras.map(cameraText),
    rule: {
      min_views: Math.max(1, Number(rule.min_views ?? 2)),
      out_of_view: rule.out_of_view === "abstain" ? "abstain" : "outside",
    },
    up: vector(value.up ?? [0, 1, 0], "up"),
    floor_m: typeof value.floor_m === "number" ? value.floor_m : null,
    volume: { low: vector(volume.low, "volume.low"), high: vector(volume.high, "volume.high") },
    scenes: list(value.scenes ?? [], "scenes").map(String),
    responses: list(value.responses ?? [], "responses").map(String),
    colour: value.colour !== false,
    replay: value.replay === true,
    ...(typeof value.length_s === "number" && value.length_s > 0 ? { length_s: value.length_s } : {}),
    film_waits: value.film_waits === true,
    insecure: typeof value.insecure === "string" ? value.insecure : null,
  };
}

function cameraText(value: unknown, index: number): CameraText {
  const what = `cameras[${index}]`;
  if (!isRecord(value)) throw new TextError(`${what} is no object`);
  const [width, height] = [positive(value.width, `${what}.width`), positive(value.height, `${what}.height`)];
  return {
    name: String(value.name ?? `camera ${index}`),
    width,
    height,
    matrix: matrix(value.matrix, `${what}.matrix`),
    distortions: numbers(value.distortions, 5, `${what}.distortions`) as unknown as CameraText["distortions"],
    rotation: matrix(value.rotation, `${what}.rotation`),
    translation: vector(value.translation, `${what}.translation`),
    max_radius: typeof value.max_radius === "number" ? value.max_radius : null,
    ignored: value.ignored === undefined || value.ignored === null ? null : ignored(value.ignored, width, height, `${what}.ignored`),
  };
}

/** Runs in base64; null if they hold no pixel. */
function ignored(value: unknown, width: number, height: number, what: string): Runs | null {
  if (typeof value !== "string") throw new TextError(`${what} is no text`);
  try {
    const runs = decodeRuns(Uint8Array.from(atob(value), (letter) => letter.charCodeAt(0)), width, height);
    return runs.area > 0 ? runs : null;
  } catch (error) {
    throw new TextError(`${what}: ${error instanceof Error ? error.message : String(error)}`);
  }
}

function scene(value: Record<string, unknown>): Scene {
  const bodies = list(value.bodies, "bodies").map((body, index): BodyText => {
    if (!isRecord(body) || typeof body.id !== "number" || !isRecord(body.shape)) throw new TextError(`bodies[${index}] lacks id or shape`);
    return {
      id: body.id,
      name: String(body.name ?? body.id),
      color: vector(body.color ?? [0.6, 0.6, 0.6], `bodies[${index}].color`),
      fixed: body.fixed === true,
      shape: body.shape as unknown as Shape,
    };
  });
  return {
    op: "scene",
    generation: Number(value.generation ?? 0),
    version: Number(value.version ?? 0),
    scene: String(value.scene ?? ""),
    parameters: isRecord(value.parameters) ? (value.parameters as Partial<Parameters>) : {},
    ...(typeof value.floor_m === "number" || value.floor_m === null ? { floor_m: value.floor_m } : {}),
    bodies,
  };
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function list(value: unknown, what: string): unknown[] {
  if (!Array.isArray(value)) throw new TextError(`${what} is no list`);
  return value;
}

function numbers(value: unknown, count: number, what: string): number[] {
  const all = list(value, what);
  if (all.length !== count || !all.every((n) => typeof n === "number" && Number.isFinite(n))) {
    throw new TextError(`${what} is not ${count} numbers`);
  }
  return all as number[];
}

function vector(value: unknown, what: string): Vec3 {
  return numbers(value, 3, what) as unknown as Vec3;
}

function matrix(value: unknown, what: string): Mat3 {
  const rows = list(value, what);
  if (rows.length !== 3) throw new TextError(`${what} has ${rows.length} rows, expected 3`);
  return rows.map((row) => vector(row, what)) as unknown as Mat3;
}

function positive(value: unknown, what: string): number {
  if (typeof value !== "number" || !(value > 0) || !Number.isFinite(value)) throw new TextError(`${what} is ${String(value)}, expected above 0`);
  return value;
}
