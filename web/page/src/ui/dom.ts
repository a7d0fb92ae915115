/** The page's elements, by their ids; one that is missing is a fault of the page itself. */
export function byId<T extends HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page lacks #${id}`);
  return found as T;
}

/** Sets text only where it changed: layout is not free. */
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

export function option(value: string, text: string): HTMLOptionElement {
  const made = document.createElement("option");
  made.value = value;
  made.textContent = text;
  return made;
}

export function setPressed(button: HTMLElement, pressed: boolean): void {
  const value = String(pressed);
  if (button.getAttribute("aria-pressed") !== value) button.setAttribute("aria-pressed", value);
}

/** 12.3 MB and the like. */
export function bytesText(bytes: number): string {
  if (bytes < 1000) return `${Math.round(bytes)} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(bytes < 1e4 ? 1 : 0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

let toastTimer: ReturnType<typeof setTimeout> | undefined;

/** A message stays for so long; one with a button, until it can be read and reached; milliseconds. */
const TOAST_MS = 4000;
const TOAST_WITH_BUTTON_MS = 10_000;

/** Says something for some seconds, with a button that does something about it. */
export function toast(text: string, button: { readonly label: string; readonly press: () => void } | null = null): void {
  const element = byId("toast");
  byId("toast-text").textContent = text;
  const action = byId<HTMLButtonElement>("toast-action");
  action.hidden = button === null;
  action.textContent = button?.label ?? "";
  action.onclick = () => {
    element.hidden = true;
    button?.press();
  };
  element.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => (element.hidden = true), button ? TOAST_WITH_BUTTON_MS : TOAST_MS);
}

/** Says something to those who listen instead of looking. */
export function announce(text: string): void {
  byId("live-region").textContent = text;
}
