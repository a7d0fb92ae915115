import assert from "node:assert/strict";
import { test } from "node:test";
import { endpointOf } from "../../src/feed/endpoint.ts";

const TOKEN = "a-Token_of.16~ch";

test("the socket's address never holds the token", () => {
  const { url, protocols } = endpointOf(`https://studio.example/run/?token=${TOKEN}#eye=1,2,3`, TOKEN);
  assert.equal(url, "wss://studio.example/run/feed");
  assert.deepEqual(protocols, ["hulltouch.feed.v1", `hulltouch.token.${TOKEN}`]);
});

test("a viewer offers no token, nor does one whose token cannot be any", () => {
  for (const token of [null, "", "short", "with space", "semi;colon", "x".repeat(129)]) {
    assert.deepEqual(endpointOf("http://127.0.0.1:8470/", token), { url: "ws://127.0.0.1:8470/feed", protocols: ["hulltouch.feed.v1"] });
  }
});
