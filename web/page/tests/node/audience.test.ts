import assert from "node:assert/strict";
import { test } from "node:test";
import { readAudience } from "../../src/audience.ts";

test("an address says what an audience sees", () => {
  assert.deepEqual(readAudience(""), { isClean: false, background: "room", refused: null });
  for (const on of ["?clean", "?clean=1", "?token=x&clean"]) assert.ok(readAudience(on).isClean, on);
  for (const off of ["?clean=0", "?clean=false", "?cleaner"]) assert.ok(!readAudience(off).isClean, off);
  assert.equal(readAudience("?background=transparent").background, "transparent");
  for (const green of ["?background=00ff00", "?background=%2300FF00"]) assert.equal(readAudience(green).background, 0x00ff00);
});

test("what makes no sense is refused in one sentence, however long it is", () => {
  assert.equal(readAudience("?background=plaid").refused, "background=plaid: expected transparent, or a colour such as 00ff00");
  for (const text of ["x".repeat(10_000), "", "00ff000", "-1", "NaN", "%00", "<b>"]) {
    const { background, refused } = readAudience(`?background=${text}`);
    assert.equal(background, "room");
    assert.ok(refused!.length < 120);
  }
});
