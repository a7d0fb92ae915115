// Compiles the tests with the compiler of the lock file and runs those of one folder: `node` or `browser`.
import { spawnSync } from "node:child_process";
import { readdirSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const home = dirname(dirname(fileURLToPath(import.meta.url)));
const folder = process.argv[2] ?? "node";
const only = process.argv[3] ?? "";

function run(program, args) {
  const done = spawnSync(program, args, { cwd: home, stdio: "inherit" });
  if (done.status !== 0) process.exit(done.status ?? 1);
}

rmSync(join(home, ".tests"), { recursive: true, force: true });
run(process.execPath, [join(home, "node_modules/typescript/bin/tsc"), "-p", "tests/tsconfig.json"]);
writeFileSync(join(home, ".tests/package.json"), '{"type":"module"}\n');
const built = join(".tests/tests", folder);
const files = readdirSync(join(home, built))
  .filter((name) => name.endsWith(".test.js") && name.includes(only))
  .map((name) => join(built, name));
// Browser tests start programs and share two cores: one file after the other.
run(process.execPath, ["--test", ...(folder === "browser" ? ["--test-concurrency=1"] : []), ...files]);
