/** Commands that take something away: what reports them offers to bring it back. */
import type { App } from "../app/app.ts";
import { toast } from "./dom.ts";

/** Gives such a command; `report` says what it did. */
export async function takeAway(app: App, command: string, fields: Record<string, unknown>, report: string): Promise<void> {
  const answer = await app.command(command, fields);
  if ("refused" in answer) toast(answer.refused);
  else if (answer.undo) toast(report, { label: "Undo", press: () => void bringBack(app, answer.id) });
}

/** Brings back what the command of that number took away. */
export async function bringBack(app: App, of: number): Promise<void> {
  const answer = await app.command("undo", { of });
  toast("refused" in answer ? answer.refused : "Undone.");
}
