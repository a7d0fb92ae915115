import { defineConfig } from "vite";

// `npm run dev` serves the page and passes the sockets on to a program that runs: HULLTOUCH=http://host:port.
const program = process.env.HULLTOUCH ?? "http://127.0.0.1:8470";

export default defineConfig({
  base: "./",
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
