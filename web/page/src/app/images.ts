/** Whole images of cameras: small ones for the list and the frusta, one behind the scene. */
import { Decoder } from "../decode/decoder.ts";
import type { Cameras } from "../draw/cameras.ts";
import type { Hello } from "../feed/text.ts";

/** What images are drawn into. */
export interface ImageUsers {
  /** The frusta and the image behind the scene; null without WebGL2. */
  cameras(): Cameras | null;
  /** The camera that is looked through. */
  through(): number | null;
  thumbnail(camera: number, bitmap: ImageBitmap): void;
  fault(text: string): void;
}

export class Images {
  private readonly decoder = new Decoder();
  private readonly users: ImageUsers;
  private setup: Hello | null = null;

  constructor(users: ImageUsers) {
    this.users = users;
  }

  /** Decodes a message and hands its images on; resolves when that is done. */
  async came(message: ArrayBuffer, hello: Hello): Promise<void> {
    if (this.setup !== hello) {
      this.setup = hello;
      this.decoder.setup({ cameras: hello.cameras, volume: hello.volume, offImageIsOutside: true });
    }
    const outcome = await this.decoder.decode({ message, contours: false, colour: true });
    if (outcome.op === "failed") this.users.fault(outcome.why);
    if (outcome.op !== "decoded") return;
    const cameras = this.users.cameras();
    for (const part of outcome.cameras) {
      if (!part.image) continue;
      if (outcome.thumbnails) {
        this.users.thumbnail(part.camera, part.image);
        if (cameras) cameras.thumbnail(part.camera, part.image);
        else part.image.close();
      } else if (part.camera === this.users.through() && cameras) {
        cameras.behindImage(part.image);
      } else {
        part.image.close();
      }
    }
  }
}
