/** The feed's address for a page, and how the page offers its token. */
import type { Endpoint } from "./connection.ts";

/** The subprotocol, with the format's version. */
const SUBPROTOCOL = "hulltouch.feed.v1";
/** A token is offered as a subprotocol of its own: browsers print a socket's address when it fails, never these. */
const TOKEN_PREFIX = "hulltouch.token.";
/** What can be a token; browsers take no other characters in a subprotocol. */
const TOKEN = /^[A-Za-z0-9_.~-]{8,128}$/;

/** The feed beside a page. */
export function endpointOf(pageUrl: string, token: string | null): Endpoint {
  const url = new URL("feed", pageUrl.replace(/[?#].*$/, ""));
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  const offered = token !== null && TOKEN.test(token) ? [`${TOKEN_PREFIX}${token}`] : [];
  return { url: url.toString(), protocols: [SUBPROTOCOL, ...offered] };
}
