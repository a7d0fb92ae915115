import assert from "node:assert/strict";
import { test } from "node:test";
import { plain } from "../../src/feed/plain.ts";

test("reasons are shown without addresses, paths and numbers of the system", () => {
  for (const [why, shown] of [
    ["node left (cam_0, cam_1): at unix:/tmp/hulltouch-9/0.sock: cannot connect: No such file or directory (os error 2)", "node left (cam_0, cam_1): cannot connect"],
    ["node left: at 192.168.7.11:7001: cannot connect: Connection refused (os error 111)", "node left: cannot connect"],
    ["node left: at [fe80::1]:7001: the connection broke", "node left: the connection broke"],
    ["node left: at left:7001: cannot connect: its certificate has ended", "node left: cannot connect: its certificate has ended"],
    ["node a: at a:1: cannot connect: refused (os error 111); node b: it has no camera \"c\"", "node a: cannot connect; node b: it has no camera \"c\""],
    ["node left: cannot open /dev/video0: Permission denied (os error 13)", "node left: cannot open /dev/video0"],
    ["node left: cannot open /home/me/empty.png: no picture", "node left: cannot open a file: no picture"],
    ["2 of 6 cameras, 3 needed: node c: at unix:/tmp/hulltouch-9/2.sock: cannot connect: refused (os error 111)", "2 of 6 cameras, 3 needed: node c: cannot connect"],
    ["it films 25 frames/s, expected 30", "it films 25 frames/s, expected 30"],
    ["node left does not answer", "node left does not answer"],
  ]) {
    assert.equal(plain(why), shown);
  }
});
