/**
 * A small server that speaks the feed's format to one or more pages, for tests that need a film whose truth
 * is known exactly. It follows the credit rules, and takes the commands that tests give.
 */
import { createReadStream, existsSync, statSync } from "node:fs";
import { createServer, type Server } from "node:http";
import { extname, join, normalize } from "node:path";
import { type WebSocket, WebSocketServer } from "ws";
import type { BodyText, Hello } from "../../src/feed/text.ts";
import { encodeRuns, frameMessage, type Part, worldMessage } from "./write.ts";

/** What is shown. */
export interface Film {
  readonly cameras: Hello["cameras"];
  readonly volume: Hello["volume"];
  readonly fps: number;
  readonly rule: Hello["rule"];
  readonly colour: boolean;
  /** Which way is up; +Y unless told. */
  readonly up?: Hello["up"];
  /** Whether no frame comes while the world is paused, as from the program; else film goes on. */
  readonly waits?: boolean;
  /** All cameras at a frame. */
  frame(index: number): readonly Part[];
  /** Small whole images, or none. */
  thumbnails(index: number): readonly Part[];
}

/** A body, and where it is held if it does not fall. */
export interface Placed extends BodyText {
  readonly at?: [number, number, number];
}

interface Body extends BodyText {
  position: [number, number, number];
  velocity: [number, number, number];
  held: [number, number, number] | null;
  /** Whether a page holds it. */
  grabbed?: boolean;
  touching?: boolean;
  /** Where the person touches it, and the unit normal of the person's surface there. */
  patch?: { readonly at: readonly number[]; readonly normal: readonly number[] };
}

const TYPES: Record<string, string> = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".json": "application/json" };
/** What its page says of its encryption. */
export const INSECURE = "--insecure: cameras are asked without encryption and certificates";
const TOKEN = process.env.TOKEN ?? "feeder-test";
const STATE_HZ = 60;

export interface Feeder {
  readonly address: string;
  readonly token: string;
  /** Frame sets sent so far. */
  sent(): number;
  commands(): readonly string[];
  /** Says why there is no hull, from the next status on; null: there is one. */
  goBlind(why: string | null): void;
  /** A camera is gone, and why; null: all are there. */
  loseCamera(camera: number | null, why: string): void;
  /** Pauses the world, or lets it go on. */
  pause(isPaused: boolean): void;
  /** The person touches a body from now on: at a place, with the unit normal of the person's surface there; null: no longer. */
  touch(body: number, patch: Body["patch"] | null): void;
  /** Says goodbye and goes, as a run that is over. */
  end(why: string): Promise<void>;
  close(): Promise<void>;
}

/** Serves a film and a page on a free port. */
export async function serve(film: Film, page: string, bodies: readonly Placed[] = [], port = 0): Promise<Feeder> {
  const world = new World(bodies, film);
  const server = createServer((request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url ?? "/", "http://x").pathname));
    let file = join(page, path);
    if (existsSync(file) && statSync(file).isDirectory()) file = join(file, "index.html");
    if (!file.startsWith(page) || !existsSync(file)) {
      response.writeHead(404).end();
      return;
    }
    response.writeHead(200, { "content-type": TYPES[extname(file)] ?? "application/octet-stream", "cache-control": "no-cache" });
    createReadStream(file).pipe(response);
  });
  const sockets = new WebSocketServer({ server, path: "/feed" });
  let sent = 0;
  const commands: string[] = [];
  sockets.on("connection", (socket, request) => {
    const offered = String(request.headers["sec-websocket-protocol"] ?? "").split(",").map((protocol) => protocol.trim());
    const controller = offered.includes(`hulltouch.token.${TOKEN}`);
    new Page(socket, film, world, controller, commands, () => sent++);
  });
  await new Promise<void>((resolve) => server.listen(port, "127.0.0.1", resolve));
  const { port: bound } = server.address() as { port: number };
  return {
    address: `http://127.0.0.1:${bound}/`,
    token: TOKEN,
    sent: () => sent,
    commands: () => commands,
    goBlind: (why) => (world.blind = why),
    loseCamera: (camera, why) => (world.gone = camera === null ? null : { camera, why }),
    pause: (isPaused) => world.pause(isPaused),
    touch: (id, patch) => {
      const body = world.bodies.find((each) => each.id === id)!;
      [body.touching, body.patch] = [patch !== null, patch ?? undefined];
    },
    end: async (why) => {
      for (const socket of sockets.clients) {
        socket.send(JSON.stringify({ op: "bye", why }));
        await new Promise((resolve) => socket.once("close", resolve).close());
      }
      await close(server, sockets, world);
    },
    close: () => close(server, sockets, world),
  };
}

async function close(server: Server, sockets: WebSocketServer, world: World): Promise<void> {
  world.stop();
  for (const socket of sockets.clients) socket.terminate();
  sockets.close();
  server.closeAllConnections();
  await new Promise((resolve) => server.close(resolve));
}

/** Bodies that fall onto the floor: enough to see that commands arrive. */
class World {
  readonly bodies: Body[];
  readonly film: Film;
  private readonly start: readonly Placed[];
  private readonly began = performance.now();
  private readonly timer: ReturnType<typeof setInterval>;
  private nextId = 1000;
  /** The bodies before the last command that took any away. */
  private former: Body[] = [];
  /** The last command that took anything away took a background. */
  private tookBackground = false;
  readonly parameters = { answers_hull: true, hull_restitution: 0.3, hull_friction: 0.5, gravity_m_s2: [0, -9.81, 0] };
  step = 0;
  generation = 1;
  version = 1;
  scene = "topple";
  paused = false;
  /** The frame at which a film stands that waits. */
  private pausedFrame: number | null = null;
  blind: string | null = null;
  gone: { readonly camera: number; readonly why: string } | null = null;

  constructor(bodies: readonly Placed[], film: Film) {
    this.film = film;
    this.start = bodies;
    this.bodies = bodies.map((body, index) => World.body(body, index));
    this.timer = setInterval(() => this.advance(), 1000 / STATE_HZ);
  }

  private static body({ at, ...text }: Placed, index: number): Body {
    const size = "box" in text.shape ? text.shape.box.size[1] / 2 : 0.15;
    if (at) return { ...text, position: at, velocity: [0, 0, 0], held: at };
    return { ...text, position: [index % 2 === 0 ? -0.7 : 0.75, size, 0.15 + 0.35 * Math.floor(index / 2) - 0.4], velocity: [0, 0, 0], held: null };
  }

  get frame(): number {
    return this.pausedFrame ?? Math.floor(((performance.now() - this.began) / 1000) * this.film.fps);
  }

  pause(isPaused: boolean): void {
    this.paused = isPaused;
    this.pausedFrame = isPaused && this.film.waits ? this.frame : null;
  }

  get filmS(): number {
    return this.step / 120;
  }

  stop(): void {
    clearInterval(this.timer);
  }

  /** The person's surface at bodies: still, a millimetre deep, three centimetres wide. */
  patches(): number[][] {
    return this.bodies.flatMap(({ patch }, place) => (patch ? [[place, 4, ...patch.at, ...patch.normal, 0, 0, 0, 0.001, 0.03]] : []));
  }

  private advance(): void {
    if (this.paused) return;
    this.step += 2;
    for (const body of this.bodies) {
      if (body.held) {
        body.position = [...body.held];
        continue;
      }
      body.velocity[1] -= 9.81 / STATE_HZ;
      for (let i = 0; i < 3; i++) body.position[i] += body.velocity[i] / STATE_HZ;
      if (body.position[1] < 0.12) {
        body.position[1] = 0.12;
        body.velocity = [body.velocity[0] * 0.8, Math.abs(body.velocity[1]) * 0.4, body.velocity[2] * 0.8];
      }
    }
  }

  command(message: any): { body?: number; undo?: true } | { why: string } {
    const held = this.bodies.find((body) => body.id === message.body);
    switch (message.command) {
      case "pause":
        this.pause(true);
        return {};
      case "resume":
        this.pause(false);
        return {};
      case "spawn": {
        const id = this.nextId++;
        this.bodies.push({ id, name: message.name ?? `body ${id}`, color: message.color ?? [0.8, 0.5, 0.2], fixed: false, shape: message.shape, position: [...(message.position as [number, number, number])], velocity: message.velocity ?? [0, 0, 0], held: null });
        this.version++;
        return { body: id };
      }
      case "remove":
        this.tookBackground = false;
        this.former = [...this.bodies];
        this.bodies.splice(this.bodies.indexOf(held!), 1);
        this.version++;
        return { undo: true };
      case "undo":
        if (this.tookBackground) return {};
        this.bodies.splice(0, this.bodies.length, ...this.former);
        this.version++;
        return {};
      case "grab":
      case "release":
        if (!held) return { why: `no body ${message.body}` };
        held.grabbed = message.command === "grab";
        held.held = message.target ?? null;
        if (held.grabbed) return {};
        held.velocity = message.velocity ?? [0, 0, 0];
        return {};
      case "reset":
      case "choose":
        this.tookBackground = false;
        this.former = [...this.bodies];
        this.scene = message.scene ?? this.scene;
        this.bodies.splice(0, this.bodies.length, ...this.start.map((body, index) => World.body(body, index)));
        this.generation++;
        this.version++;
        this.step = 0;
        return { undo: true };
      case "step":
        this.step += message.steps;
        return {};
      case "set":
        for (const key of ["hull_restitution", "hull_friction"] as const) this.parameters[key] = message[key] ?? this.parameters[key];
        this.parameters.gravity_m_s2 = message.gravity ?? this.parameters.gravity_m_s2;
        this.version++;
        return {};
      case "push":
        return {};
      case "take_background":
        this.tookBackground = true;
        return message.allow_foreground ? { undo: true } : { why: 'camera "left" keeps its background: 3.2 % of its image were foreground meanwhile' };
      default:
        return { why: `no command ${message.command}` };
    }
  }
}

/** A camera as texts have it: what it ignores in base64. */
function told(camera: Film["cameras"][number]): object {
  const { ignored, width, height, ...rest } = camera;
  if (!ignored) return { ...rest, width, height };
  const mask = new Uint8Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let run = ignored.rows[row]; run < ignored.rows[row + 1]; run++) mask.fill(1, row * width + ignored.starts[run], row * width + ignored.ends[run]);
  }
  return { ...rest, width, height, ignored: Buffer.from(encodeRuns(mask, width, height)).toString("base64") };
}

/** One page: what it wants, what it was sent. */
class Page {
  private readonly socket: WebSocket;
  private readonly film: Film;
  private readonly world: World;
  private readonly timers: ReturnType<typeof setInterval>[] = [];
  private unshown = 0;
  private lastFrame = -1;
  private seq = 0;
  private version = 0;
  private sentBytes = 0;
  private wants = { colour: "full", fps: 30, thumbnails_hz: 0, image_of: null as string | null, touches: true, patches: false, silhouettes: true };

  constructor(socket: WebSocket, film: Film, world: World, controller: boolean, commands: string[], sent: () => void) {
    this.socket = socket;
    this.film = film;
    this.world = world;
    const { cameras, volume, fps, rule, colour } = film;
    this.text({ op: "hello", version: 1, program: "test", session: "feeder", controller, fps, dt_s: 1 / 120, latency_s: 0.1, cameras: cameras.map(told), rule, up: film.up ?? [0, 1, 0], floor_m: 0, volume, scenes: ["topple", "lift"], responses: ["paper", "off"], colour, insecure: INSECURE });
    this.timers.push(
      setInterval(() => this.sendFrame(sent), 1000 / fps / 4),
      setInterval(() => this.sendWorld(), 1000 / STATE_HZ),
      setInterval(() => this.sendStatus(), 250),
      setInterval(() => this.sendImages(), 500),
    );
    socket.on("message", (data) => this.heard(JSON.parse(String(data)), controller, commands));
    socket.on("close", () => this.timers.forEach(clearInterval));
  }

  private heard(message: any, controller: boolean, commands: string[]): void {
    if (message.op === "shown") this.unshown = Math.max(0, this.unshown - 1);
    if (message.op === "want") this.wants = { ...this.wants, ...message };
    if (message.op !== "command") return;
    if (!controller) return this.text({ op: "refused", id: message.id, why: "a viewer cannot steer: open the page with its token" });
    commands.push(message.command);
    const done = this.world.command(message);
    this.text("why" in done ? { op: "refused", id: message.id, ...done } : { op: "done", id: message.id, ...done });
  }

  private text(message: object): void {
    this.socket.send(JSON.stringify(message));
  }

  private sendFrame(sent: () => void): void {
    const frame = this.world.frame;
    if (this.unshown >= 2 || frame === this.lastFrame) return;
    this.lastFrame = frame;
    this.unshown++;
    const { colour, silhouettes } = this.wants;
    const parts = colour === "off" && !silhouettes ? [] : this.film.frame(frame).map((part) => (colour === "off" ? { ...part, jpeg: null } : part));
    const bytes = frameMessage(1, this.seq++, frame, frame / this.film.fps, parts);
    this.sentBytes += bytes.byteLength;
    this.socket.send(bytes);
    sent();
  }

  private sendImages(): void {
    if (this.wants.thumbnails_hz > 0) {
      const parts = this.film.thumbnails(this.world.frame);
      if (parts.length > 0) this.socket.send(frameMessage(3, this.seq++, this.world.frame, 0, parts, 1));
    }
    if (this.wants.image_of) {
      const index = this.film.cameras.findIndex((camera) => camera.name === this.wants.image_of);
      const parts = this.film.thumbnails(this.world.frame).filter((part) => part.camera === index);
      if (parts.length > 0) this.socket.send(frameMessage(3, this.seq++, this.world.frame, 0, parts, 0));
    }
  }

  private sendWorld(): void {
    const { world } = this;
    if (this.version !== world.version) {
      this.version = world.version;
      const bodies = world.bodies.map(({ id, name, color, fixed, shape }) => ({ id, name, color, fixed, shape }));
      this.text({ op: "scene", generation: world.generation, version: world.version, scene: world.scene, parameters: world.parameters, bodies });
    }
    const touches = this.wants.touches ? world.bodies.map(({ position }, index) => [index, ...position, 0, 0.1, 0]) : [];
    this.socket.send(worldMessage(this.seq++, world.generation, world.step, world.filmS, world.frame, world.paused, world.bodies, touches, this.wants.patches ? world.patches() : []));
  }

  private sendStatus(): void {
    const { world, film } = this;
    this.text({
      op: "status",
      progress: { film_s: world.filmS, frame: world.frame, steps_per_s: 120, passes_per_s: 30, p50_ms: 2.1, p99_ms: 4.4, samples: 12000, contacts: 1, bytes_per_s: 2e5, blind: null },
      cameras: film.cameras.map((camera, index) => ({ name: camera.name, problem: world.gone?.camera === index ? world.gone.why : null, newest_frame: world.frame, age_ms: 31 + index, sync_ms: 0.2, clock_bound_ms: 0.1, foreground: 0.05, silhouette_bytes: 970, segment_ms: 0.9 })),
      frames_missed: 0,
      frames_expected: world.frame,
      late_steps: 0,
      blind_steps: 0,
      blind: world.blind,
      paused: world.paused,
      feed: { bytes_per_s: this.sentBytes * 4, sent: this.seq, dropped: 0, tier: "full", pages: 1 },
    });
    this.sentBytes = 0;
  }
}
