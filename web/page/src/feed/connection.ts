/** The socket: connects, connects again, and hands messages on. What they mean is not its business. */
import { backoffMs } from "./backoff.ts";
import { Credit } from "./credit.ts";
import { MAGIC } from "./message.ts";
import { parseText, type Text } from "./text.ts";

/** A server that is silent for so long is gone: status comes four times a second. */
const SILENCE_MS = 6000;
/** Commands that wait for an answer at most. */
const MAX_COMMANDS = 256;

export type LinkState = "connecting" | "open" | "lost";

/** Where the feed is, and the subprotocols that are offered there. */
export interface Endpoint {
  readonly url: string;
  readonly protocols: readonly string[];
}

/** What the connection reports. */
export interface Listener {
  link(state: LinkState, retryInMs: number | null, why: string | null): void;
  text(text: Text): void;
  binary(type: number, buffer: ArrayBuffer): void;
  invalid(why: string): void;
}

/** What the page wants to be sent. */
export interface Want {
  readonly colour: "full" | "half" | "quarter" | "off";
  readonly fps: number;
  readonly state_hz: number;
  readonly touches: boolean;
  readonly patches: boolean;
  readonly thumbnails_hz: number;
  readonly image_of: string | null;
  readonly silhouettes: boolean;
}

/** What a command came to: its number, the body that was spawned, and whether the command can be undone. */
export type Answer = { readonly id: number; readonly body?: number; readonly undo?: boolean } | { readonly refused: string };

export class Connection {
  readonly credit: Credit;
  private socket: WebSocket | null = null;
  private attempt = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private receivedAt = 0;
  private watchedAt = 0;
  private nextId = 1;
  private goodbye: string | null = null;
  private wanted: Want | null = null;
  private readonly waiting = new Map<number, (answer: Answer) => void>();
  private readonly endpoint: Endpoint;
  private readonly listener: Listener;
  /** Bytes that came so far. */
  received = 0;

  constructor(endpoint: Endpoint, listener: Listener) {
    this.endpoint = endpoint;
    this.listener = listener;
    this.credit = new Credit((seq) => this.send({ op: "shown", seq }));
    setInterval(() => this.watch(), 1000);
  }

  get open(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  connect(): void {
    clearTimeout(this.timer);
    this.listener.link("connecting", null, null);
    this.goodbye = null;
    let socket: WebSocket;
    try {
      socket = new WebSocket(this.endpoint.url, [...this.endpoint.protocols]);
    } catch (error) {
      this.lost(String(error));
      return;
    }
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.receivedAt = performance.now();
    socket.onopen = () => {
      if (this.socket !== socket) return;
      this.credit.reset();
      this.listener.link("open", null, null);
      if (this.wanted) this.send({ op: "want", ...this.wanted });
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      if (this.socket === socket) this.receive(event.data);
    };
    socket.onclose = () => {
      if (this.socket === socket) this.lost(this.goodbye);
    };
  }

  /** Tries at once instead of when its time comes. */
  retryNow(): void {
    if (!this.socket || this.socket.readyState === WebSocket.CLOSED) this.connect();
  }

  /** Says what is wanted, now and after every connection. */
  want(want: Want): void {
    if (this.wanted && JSON.stringify(this.wanted) === JSON.stringify(want)) return;
    this.wanted = want;
    this.send({ op: "want", ...want });
  }

  /** Asks the run for something. */
  command(command: string, fields: Record<string, unknown> = {}): Promise<Answer> {
    if (!this.open) return Promise.resolve({ refused: "not connected" });
    if (this.waiting.size >= MAX_COMMANDS) return Promise.resolve({ refused: "too many commands wait" });
    const id = this.nextId++;
    return new Promise((resolve) => {
      this.waiting.set(id, resolve);
      this.send({ op: "command", id, command, ...fields });
    });
  }

  private receive(data: string | ArrayBuffer): void {
    this.receivedAt = performance.now();
    if (typeof data !== "string") {
      this.received += data.byteLength;
      const view = new DataView(data);
      if (data.byteLength < 16 || view.getUint32(0, true) !== MAGIC) return this.listener.invalid("a binary message that is not the feed's");
      this.listener.binary(view.getUint8(4), data);
      return;
    }
    this.received += data.length;
    try {
      const text = parseText(data);
      if (!text) return;
      if (text.op === "done" || text.op === "refused") {
        this.waiting.get(text.id)?.(text.op === "done" ? text : { refused: text.why });
        this.waiting.delete(text.id);
        return;
      }
      if (text.op === "hello") this.attempt = 0;
      if (text.op === "bye") this.goodbye = text.why;
      this.listener.text(text);
    } catch (error) {
      this.listener.invalid(error instanceof Error ? error.message : String(error));
    }
  }

  private send(message: Record<string, unknown>): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  private watch(): void {
    const now = performance.now();
    // While the page itself was suspended, nothing could be received.
    if (now - this.watchedAt > 2500) this.receivedAt = now;
    this.watchedAt = now;
    if (this.open && now - this.receivedAt > SILENCE_MS) {
      const socket = this.socket!;
      this.socket = null;
      socket.close();
      this.lost("the server is silent");
    }
  }

  private lost(why: string | null): void {
    this.socket = null;
    for (const resolve of this.waiting.values()) resolve({ refused: "the connection was lost" });
    this.waiting.clear();
    const wait = backoffMs(this.attempt++);
    this.listener.link("lost", wait, why);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.connect(), wait);
  }
}
