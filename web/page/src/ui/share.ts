/** The view for others: as a picture, as a link. */
import { toast } from "./dom.ts";

export async function savePicture(made: Promise<Blob | null>): Promise<void> {
  const blob = await made;
  if (!blob) return toast("There is no picture to save.");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = `hulltouch-${new Date().toISOString().slice(0, 19).replace(/[:T]/g, "-")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  toast("Picture saved.");
}

/** Copies a link to the view that an address's hash stands for. */
export async function copyLink(hash: string): Promise<void> {
  const url = `${location.origin}${location.pathname}${location.search}#${hash}`;
  try {
    await navigator.clipboard.writeText(url);
    toast("A link to this view is copied.");
  } catch {
    // No clipboard without a secure page: the address bar has it too.
    history.replaceState(null, "", url);
    toast("The address bar holds a link to this view.");
  }
}
