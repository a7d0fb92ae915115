import type { LinkState } from "../feed/connection.ts";
import type { Hello, Scene, Status } from "../feed/text.ts";

/** What the panel and the status lines are told. */
export interface Observer {
  link(state: LinkState, retryInMs: number | null, why: string | null): void;
  hello(hello: Hello): void;
  scene(scene: Scene): void;
  status(status: Status): void;
  view(): void;
  thumbnail(camera: number, bitmap: ImageBitmap): void;
  fault(text: string): void;
}
