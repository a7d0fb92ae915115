/** The page's end of the decoding worker: one job at a time, and only the newest of those that wait. */
import type { Decoded, Failed, Job, Setup } from "./work.ts";

/** How a job ended: decoded, skipped for a newer one, or an invalid message. */
export type Outcome = Decoded | { readonly op: "skipped" } | { readonly op: "failed"; readonly why: string };

interface Waiting {
  readonly job: Omit<Job, "id" | "op">;
  readonly done: (outcome: Outcome) => void;
}

export class Decoder {
  private readonly worker: Worker;
  private running: { id: number; done: (outcome: Outcome) => void } | null = null;
  private next: Waiting | null = null;
  private id = 0;

  constructor() {
    this.worker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module" });
    this.worker.onmessage = (event: MessageEvent<Decoded | Failed>) => this.finished(event.data);
    this.worker.onerror = (event) => this.finished({ op: "failed", id: this.running?.id ?? 0, why: event.message });
  }

  setup(setup: Omit<Setup, "op">): void {
    this.worker.postMessage({ op: "setup", ...setup } satisfies Setup);
  }

  /** Whether a message is being decoded. */
  get isBusy(): boolean {
    return this.running !== null;
  }

  /** Decodes a message. The buffer is copied: the caller keeps it. */
  decode(job: Omit<Job, "id" | "op">): Promise<Outcome> {
    return new Promise((done) => {
      if (this.running) {
        this.next?.done({ op: "skipped" });
        this.next = { job, done };
      } else {
        this.start({ job, done });
      }
    });
  }

  private start({ job, done }: Waiting): void {
    const id = ++this.id;
    this.running = { id, done };
    this.worker.postMessage({ op: "decode", id, ...job } satisfies Job);
  }

  private finished(result: Decoded | Failed): void {
    const running = this.running;
    if (!running || running.id !== result.id) {
      if (result.op === "decoded") for (const part of result.cameras) part.image?.close();
      return;
    }
    this.running = null;
    const next = this.next;
    this.next = null;
    if (next) this.start(next);
    running.done(result);
  }
}
