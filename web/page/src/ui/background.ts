/** The background taken again: a countdown that can be read and heard from across the room, then film of the empty room. */
import type { App } from "../app/app.ts";
import { byId, setText, toast } from "./dom.ts";
import { bringBack } from "./take_away.ts";

/** Time to leave the room before film begins, seconds. */
const LEAVE_S = 5;
const LEAST_S = 1;
const MOST_S = 30;

/** Tones: a second to leave, film begins, a good and a bad end; hertz. */
const TICK_HZ = 440;
const FILM_HZ = 880;
const GOOD_HZ = 1320;
const BAD_HZ = 220;

export class BackgroundTaking {
  private readonly app: App;
  private readonly button = byId<HTMLButtonElement>("background");
  private readonly dialog = byId<HTMLDialogElement>("emptying");
  private timer: ReturnType<typeof setInterval> | undefined;
  private sound: AudioContext | null = null;

  constructor(app: App) {
    this.app = app;
    this.button.addEventListener("click", () => this.begin());
    byId("emptying-stop").addEventListener("click", () => this.stop());
    this.dialog.addEventListener("cancel", () => this.stop());
  }

  private begin(): void {
    const seconds = Math.max(LEAST_S, Math.min(MOST_S, Number(byId<HTMLInputElement>("background-seconds").value) || 3));
    // Browsers let a page sound after it was clicked; some machines cannot.
    try {
      this.sound ??= new AudioContext();
    } catch {
      this.sound = null;
    }
    let left = LEAVE_S;
    this.show("Leave the room", left, "Stop");
    this.tone(TICK_HZ);
    this.dialog.showModal();
    this.timer = setInterval(() => {
      left--;
      if (left > 0) {
        this.show("Leave the room", left, "Stop");
        this.tone(TICK_HZ);
        return;
      }
      clearInterval(this.timer);
      void this.film(seconds);
    }, 1000);
  }

  private stop(): void {
    clearInterval(this.timer);
    this.dialog.close();
  }

  /** Has the cameras film, and says what they answer. */
  private async film(seconds: number): Promise<void> {
    this.button.disabled = true;
    let left = Math.ceil(seconds);
    this.show("Stay out: the empty room is filmed", left, "Hide");
    this.tone(FILM_HZ);
    this.timer = setInterval(() => this.show("Stay out: the empty room is filmed", left > 0 ? --left : 0, "Hide"), 1000);
    const changed = byId<HTMLInputElement>("background-changed");
    const answer = await this.app.command("take_background", { seconds, allow_foreground: changed.checked });
    this.button.disabled = false;
    this.stop();
    if ("refused" in answer) {
      this.tone(BAD_HZ);
      toast(`No background was taken: ${answer.refused}`);
      setText(byId("background-outcome"), `No background was taken: ${answer.refused}.`);
      return;
    }
    this.tone(GOOD_HZ);
    changed.checked = false;
    setText(byId("background-outcome"), "");
    toast("All cameras have a new background.", { label: "Undo", press: () => void bringBack(this.app, answer.id) });
  }

  private show(text: string, left: number, button: string): void {
    setText(byId("emptying-text"), text);
    setText(byId("emptying-left"), left > 0 ? String(left) : "…");
    setText(byId("emptying-stop"), button);
  }

  private tone(hz: number): void {
    const { sound } = this;
    if (!sound) return;
    const [tone, volume] = [sound.createOscillator(), sound.createGain()];
    tone.frequency.value = hz;
    volume.gain.setValueAtTime(0.2, sound.currentTime);
    volume.gain.exponentialRampToValueAtTime(0.001, sound.currentTime + 0.3);
    tone.connect(volume).connect(sound.destination);
    tone.start();
    tone.stop(sound.currentTime + 0.3);
  }
}
