/** The page: puts its parts together. */
import "./style.css";
import { App } from "./app/app.ts";
import { type Debug, debug } from "./debug.ts";
import { hasEnded } from "./feed/text.ts";
import { feedUrl, takeToken } from "./token.ts";
import { CamerasList } from "./ui/cameras_list.ts";
import { announce, byId, setText, toast } from "./ui/dom.ts";
import { Figures } from "./ui/figures.ts";
import { Hands } from "./ui/hands.ts";
import { bindKeys } from "./ui/keys.ts";
import { Panel } from "./ui/panel.ts";
import { bindPointer } from "./ui/pointer.ts";
import { TimelineBar } from "./ui/timeline_bar.ts";
import { writeHash } from "./view/hash.ts";

declare global {
  interface Window {
    hulltouch?: Debug;
  }
}

const VERSION = "0.1.0";

/** Whether there is WebGL2, and on what. A context of its own, given back at once. */
function probe(): { antialias: boolean; software: boolean; name: string } | null {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { antialias: false, depth: false });
  if (!gl) return null;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  const software = /swiftshader|llvmpipe|software|basic render/i.test(name);
  return { antialias: !software, software, name };
}

const canvas = byId<HTMLCanvasElement>("view");
const graphics = probe();
const token = takeToken();
let lostSince: number | null = null;
let lostWhy: string | null = null;
/** What the program said when it went because all was over. */
let ended: string | null = null;
let retryAt: number | null = null;

const app = new App(canvas, graphics, () => feedUrl(token), {
  link: (state, retryInMs, why) => {
    byId("link").dataset.state = state;
    if (state === "open") {
      if (lostSince !== null) announce("Connected again.");
      lostSince = null;
      byId("banner").hidden = true;
    } else if (state === "lost") {
      // What is said first is why: that nobody answers after it is no news.
      ended = hasEnded(why) ? why : ended;
      if (lostSince === null) announce(ended ? sentence(ended) : "The connection was lost.");
      lostSince ??= performance.now();
      retryAt = performance.now() + (retryInMs ?? 0);
      lostWhy = why;
      byId("banner").classList.toggle("calm", ended !== null);
      byId("retry").hidden = ended !== null;
    }
    showLink();
  },
  hello: (hello) => {
    blindBefore = null;
    ended = null;
    cameras.build(hello);
    panel.hello(hello);
    byId("banner").hidden = true;
  },
  scene: (scene) => panel.scene(scene),
  status: (status) => {
    cameras.update(status.cameras ?? []);
    figures.update();
    panel.paused();
    showBlind(status.blind ?? status.progress?.blind ?? null);
  },
  view: () => {
    app.stage?.bodies.highlight(hands.chosen ?? app.follow);
    app.placeAnew();
    panel.update();
    cameras.pressed(app.through);
    timeline.update();
  },
  thumbnail: (camera, bitmap) => cameras.thumbnail(camera, bitmap),
  fault: (text) => fault(text),
});
const hands = new Hands(app);
const panel = new Panel(app, hands);
const cameras = new CamerasList(app);
const figures = new Figures(app, graphics?.name ?? "none");
const timeline = new TimelineBar(app);

const actions = {
  screenshot: () => void screenshot(),
  share: () => void share(),
  help: () => byId<HTMLDialogElement>("help").showModal(),
  pause: () => void panel.togglePause(),
  step: () => void panel.ask("step", { steps: 1 }),
  reset: () => void panel.ask("reset"),
  escape: () => {
    if (hands.placing) hands.placing = false;
    else if (app.through !== null) app.lookThrough(null);
    else if (app.follow !== null) app.followBody(null);
    else if (!app.frames.playout.live) app.goLive();
    canvas.classList.remove("placing");
    app.changed();
  },
};

bindPointer(canvas, app, hands, () => app.changed());
bindKeys(canvas, app, actions, () => byId<HTMLInputElement>("shortcuts").checked);
byId("screenshot").addEventListener("click", actions.screenshot);
byId("share").addEventListener("click", actions.share);
byId("help-open").addEventListener("click", actions.help);
byId("help-close").addEventListener("click", () => byId<HTMLDialogElement>("help").close());
byId("retry").addEventListener("click", () => app.connection.retryNow());
byId("fullscreen").addEventListener("click", () => {
  if (document.fullscreenElement) void document.exitFullscreen();
  else document.documentElement.requestFullscreen().catch(() => toast("This browser has no full screen."));
});
byId("panel-toggle").addEventListener("click", () => openPanel(document.body.classList.contains("panel-closed")));
window.addEventListener("hashchange", () => app.address.apply(location.hash));

function openPanel(open: boolean): void {
  document.body.classList.toggle("panel-closed", !open);
  byId("panel-toggle").setAttribute("aria-expanded", String(open));
  app.wantsThumbnails = open;
  app.updateWant();
  measure();
}

/** Tells how much of the canvas is covered. */
function measure(): void {
  const sheet = byId("panel").getBoundingClientRect();
  const strip = document.querySelector(".timeline")!.getBoundingClientRect();
  const beside = sheet.width > 0 && sheet.width < innerWidth * 0.6;
  const below = sheet.width > 0 && !beside;
  app.covered = [beside ? innerWidth - sheet.left : 0, innerHeight - (below ? sheet.top : strip.top)];
  app.invalidate();
}
window.addEventListener("resize", measure);

// On a phone the picture comes first.
openPanel(matchMedia("(min-width: 721px)").matches);
if (!graphics) {
  canvas.hidden = true;
  document.body.classList.add("no-view");
  byId("plain").hidden = false;
}
setInterval(() => {
  showLink();
  timeline.update();
}, 250);
app.start();
window.hulltouch = debug(app, hands, VERSION);

function showLink(): void {
  const state = byId("link").dataset.state;
  if (state === "open") {
    const now = performance.now();
    const frames = app.frames.rate.perSecond(now);
    setText(byId("link-text"), app.paused ? "Paused" : app.hello && app.stage ? `${app.hello.replay ? "Recorded" : "Live"} · ${frames.toFixed(0)} frames/s` : "Connected");
    return;
  }
  setText(byId("link-text"), ended ? "Ended" : state === "lost" ? "Link lost" : "Connecting…");
  if (lostSince === null) return;
  if (ended) {
    setText(byId("banner-text"), `${sentence(ended)} You see its last picture; the bar below looks back.`);
    byId("banner").hidden = false;
    return;
  }
  const left = Math.max(0, Math.ceil(((retryAt ?? 0) - performance.now()) / 1000));
  const reason = lostWhy ? ` (${lostWhy})` : "";
  setText(byId("banner-text"), state === "lost" && left > 0 ? `The link to the program is gone${reason}. Trying again in ${left} s.` : `The link to the program is gone${reason}. Trying again…`);
  byId("banner").hidden = false;
}

function sentence(text: string): string {
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}

/** Says why there is no hull, as long as there is none. */
function showBlind(why: string | null): void {
  if (lostSince !== null || why === blindBefore) return;
  blindBefore = why;
  const banner = byId("banner");
  banner.classList.toggle("calm", why !== null);
  byId("retry").hidden = why !== null;
  if (why) setText(byId("banner-text"), `Nobody is seen: ${why}`);
  banner.hidden = why === null;
}

let blindBefore: string | null = null;
let faults = 0;

/** Something that came made no sense: told a few times, then only counted. */
function fault(text: string): void {
  faults++;
  if (faults <= 3) toast(text);
}

async function screenshot(): Promise<void> {
  const blob = await app.screenshot();
  if (!blob) return toast("There is no picture to save.");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = `hulltouch-${new Date().toISOString().slice(0, 19).replace(/[:T]/g, "-")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  toast("Picture saved.");
}

async function share(): Promise<void> {
  const url = `${location.origin}${location.pathname}#${writeHash(app.address.text())}`;
  try {
    await navigator.clipboard.writeText(url);
    toast("A link to this view is copied.");
  } catch {
    // No clipboard without a secure page: the address bar has it too.
    history.replaceState(null, "", url);
    toast("The address bar holds a link to this view.");
  }
}
