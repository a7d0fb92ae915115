// A run's world in plain JavaScript: the JSON socket, and a picture from above. No library.

/** A connection to a run's JSON socket. */
export class World {
  #socket;
  #waiting = new Map();
  #nextId = 1;

  /**
   * @param {string} address where the run's page is, like "127.0.0.1:8470"
   * @param {{token?: string, rate?: number, onState: (state: object) => void, onEnd?: () => void}} options
   */
  constructor(address, { token, rate = 30, onState, onEnd = () => {} }) {
    const query = new URLSearchParams({ rate: String(rate), ...(token ? { token } : {}) });
    this.#socket = new WebSocket(`ws://${address}/state?${query}`);
    this.#socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      if (message.op === "state") {
        onState(message);
      } else {
        this.#answer(message);
      }
    });
    this.#socket.addEventListener("close", () => {
      for (const { reject } of this.#waiting.values()) reject(new Error("the run has ended"));
      this.#waiting.clear();
      onEnd();
    });
  }

  /** Asks for something, like command("push", { body: 3, impulse: [0, 1, 0] }); resolves once it is done. */
  command(command, fields = {}) {
    const id = this.#nextId++;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject });
      this.#socket.send(JSON.stringify({ op: "command", id, command, ...fields }));
    });
  }

  close() {
    this.#socket.close();
  }

  #answer({ op, id, why, body }) {
    const waiting = this.#waiting.get(id);
    this.#waiting.delete(id);
    if (op === "done") waiting?.resolve(body);
    else waiting?.reject(new Error(why));
  }
}

/**
 * Draws the bodies from above into a square canvas that shows so many metres: the person's right is left, and he
 * looks down.
 *
 * @param {CanvasRenderingContext2D} context
 */
export function drawFromAbove(context, state, metres = 4) {
  const { width, height } = context.canvas;
  const scale = width / metres;
  context.clearRect(0, 0, width, height);
  context.font = "12px sans-serif";
  for (const { name, id, position_m: [x, y, z], inside_samples: inside } of state.bodies) {
    const across = width / 2 + scale * x;
    const down = height / 2 + scale * z;
    context.beginPath();
    // Higher bodies look larger.
    context.arc(across, down, 5 + 5 * Math.max(0, y), 0, 2 * Math.PI);
    context.fillStyle = inside > 0 ? "#c33" : "#48a";
    context.fill();
    context.fillText(name ?? String(id), across + 14, down + 4);
  }
}
