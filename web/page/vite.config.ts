import { readdirSync, readFileSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";
import { defineConfig, type Plugin } from "vite";

// `npm run dev` serves the page and passes the sockets on to a program that runs: HULLTOUCH=http://host:port.
const program = process.env.HULLTOUCH ?? "http://127.0.0.1:8470";

/** Beside each file of the page the same, compressed: name.br and name.gz. The program serves what a browser takes. */
function compressed(): Plugin {
  let home = "";
  return {
    name: "compressed",
    apply: "build",
    configResolved: ({ root, build }) => void (home = join(root, build.outDir)),
    closeBundle() {
      for (const name of readdirSync(home, { recursive: true, encoding: "utf8" })) {
        const path = join(home, name);
        if (!statSync(path).isFile()) continue;
        const bytes = readFileSync(path);
        writeFileSync(`${path}.br`, brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length } }));
        writeFileSync(`${path}.gz`, gzipSync(bytes, { level: 9 }));
      }
    },
  };
}

export default defineConfig({
  base: "./",
  plugins: [compressed()],
  build: {
    target: "es2022",
    sourcemap: false,
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 900,
  },
  worker: { format: "es" },
  server: { proxy: { "/feed": { target: program.replace(/^http/, "ws"), ws: true } } },
});
