/** The controller's token: taken out of the address, so that a shared view does not give it away. */

const KEY = "hulltouch.token";

/** The token of this tab, if it has one and may use it. */
export function takeToken(mayUse = true): string | null {
  const url = new URL(location.href);
  const given = url.searchParams.get("token");
  if (given !== null) {
    url.searchParams.delete("token");
    history.replaceState(null, "", `${url.pathname}${url.search}${url.hash}`);
    if (mayUse) store(given);
    return mayUse ? given : null;
  }
  if (!mayUse) return null;
  try {
    return sessionStorage.getItem(KEY);
  } catch {
    return null;
  }
}

/** It was refused: it is of another run. */
export function forgetToken(): void {
  try {
    sessionStorage.removeItem(KEY);
  } catch {
    // Nothing was kept.
  }
}

function store(token: string): void {
  try {
    sessionStorage.setItem(KEY, token);
  } catch {
    // A browser that keeps nothing forgets the token at the next load.
  }
}
