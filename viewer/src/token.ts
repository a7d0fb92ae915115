/** The controller's token: taken out of the address, so that a shared view does not give it away. */

const KEY = "hulltouch.token";

/** The token of this tab, if it has one. */
export function takeToken(): string | null {
  const url = new URL(location.href);
  const given = url.searchParams.get("token");
  if (given !== null) {
    url.searchParams.delete("token");
    history.replaceState(null, "", `${url.pathname}${url.search}${url.hash}`);
    store(given);
    return given;
  }
  try {
    return sessionStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function store(token: string): void {
  try {
    sessionStorage.setItem(KEY, token);
  } catch {
    // A browser that keeps nothing forgets the token at the next load.
  }
}

/** Where the feed is, with the token. */
export function feedUrl(token: string | null): string {
  const url = new URL("feed", location.href.replace(/[?#].*$/, ""));
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  if (token) url.searchParams.set("token", token);
  return url.toString();
}
