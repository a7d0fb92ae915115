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
  /** Whether small images are drawn on the frusta. */
  areSeen(): boolean;
  /** Whether a moment is looked back at: small images on the frusta stay as they are, as the person does. */
  areHeld(): boolean;
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

  /** Decodes a message and hands its images on; resolves when that is done, to whether it changes the picture. */
  async came(message: ArrayBuffer, hello: Hello): Promise<boolean> {
    if (this.setup !== hello) {
      this.setup = hello;
      this.decoder.setup({ cameras: hello.cameras, volume: hello.volume, offImageIsOutside: true });
    }
    const outcome = await this.decoder.decode({ message, contours: false, colour: true });
    if (outcome.op === "failed") this.users.fault(outcome.why);
    if (outcome.op !== "decoded") return false;
    const cameras = this.users.cameras();
    const areHeld = this.users.areHeld();
    let isSeen = false;
    for (const part of outcome.cameras) {
      if (!part.image) continue;
      if (outcome.thumbnails) {
        this.users.thumbnail(part.camera, part.image);
        if (cameras && !(areHeld && cameras.hasThumbnail(part.camera))) {
          cameras.thumbnail(part.camera, part.image);
          isSeen ||= this.users.areSeen();
        } else {
          part.image.close();
        }
      } else if (part.camera === this.users.through() && cameras && !(areHeld && cameras.hasImageBehind)) {
        cameras.behindImage(part.image);
        isSeen = true;
      } else {
        part.image.close();
      }
    }
    return isSeen;
  }
}
