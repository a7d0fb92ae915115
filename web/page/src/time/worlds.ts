/** The worlds of the last seconds, and which of them belongs to a frame on the screen. */
import type { BodyPose, WorldMessage } from "../feed/message.ts";
import { between } from "./bodies.ts";

/** Twelve seconds at 60 a second. */
const MAX_WORLDS = 720;
/** Touches make worlds large; older ones go when all together exceed this. */
const MAX_BYTES = 24 * 1024 * 1024;

/** The bodies of one moment, and the world they were taken from. */
export interface Moment {
  readonly world: WorldMessage;
  readonly bodies: readonly BodyPose[];
}

export class Worlds {
  private readonly worlds: WorldMessage[] = [];
  private bytes = 0;

  /** A world came. After a reset, what lay before it stays for looking back, in order of arrival. */
  add(world: WorldMessage): void {
    this.worlds.push(world);
    this.bytes += world.bytes;
    while (this.worlds.length > MAX_WORLDS || (this.bytes > MAX_BYTES && this.worlds.length > 2)) {
      this.bytes -= this.worlds.shift()!.bytes;
    }
  }

  newest(): WorldMessage | null {
    return this.worlds.at(-1) ?? null;
  }

  get length(): number {
    return this.worlds.length;
  }

  /** The worlds that came after one (null: all) up to another; none if that is forgotten. */
  after(last: WorldMessage | null, upTo: WorldMessage): readonly WorldMessage[] {
    return this.worlds.slice(last ? this.worlds.lastIndexOf(last) + 1 : 0, this.worlds.lastIndexOf(upTo) + 1);
  }

  clear(): void {
    this.worlds.length = 0;
    this.bytes = 0;
  }

  /**
   * The bodies as they were so many seconds after the step that first saw a frame: hull and bodies of one
   * moment. Null if no world has seen this frame or a later one yet.
   */
  atFrame(frame: number, afterS: number): Moment | null {
    let first = -1;
    for (let index = this.worlds.length - 1; index >= 0; index--) {
      const seen = this.worlds[index].frame;
      if (seen === null || seen > frame) continue;
      if (seen < frame) {
        if (first < 0 && index === this.worlds.length - 1) return null;
        if (first < 0) first = index + 1;
        break;
      }
      first = index;
    }
    if (first < 0 || first >= this.worlds.length) return null;
    return this.atFilm(first, this.worlds[first].filmS + afterS);
  }

  /** The newest bodies, a moment before the newest step so that there is something to move towards. */
  live(behindS: number): Moment | null {
    const newest = this.newest();
    if (!newest) return null;
    return this.atFilm(Math.max(0, this.worlds.length - 8), newest.filmS - behindS);
  }

  private atFilm(from: number, filmS: number): Moment {
    let after = from;
    const { generation } = this.worlds[from];
    while (after + 1 < this.worlds.length && this.worlds[after].filmS < filmS && this.worlds[after + 1].generation === generation) after++;
    const world = this.worlds[after];
    const before = this.worlds[Math.max(0, after - 1)];
    return { world, bodies: between(before, world, filmS) };
  }
}
