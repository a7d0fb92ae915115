import type { Hello, Scene, Status } from "../feed/text.ts";
import type { RunState } from "./run_state.ts";

/** Gets every change: implemented by the panel, the status line, the address. */
export interface Observer {
  run(before: RunState, after: RunState): void;
  /** `isFirst`: nothing was shown before. */
  hello(hello: Hello, isFirst: boolean): void;
  scene(scene: Scene): void;
  status(status: Status): void;
  /** The view, or what is drawn. */
  view(): void;
  thumbnail(camera: number, bitmap: ImageBitmap): void;
  fault(text: string): void;
}
