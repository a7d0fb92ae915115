/** The page: puts its parts together. */
import "./style.css";
import { version } from "../package.json";
import { Address } from "./app/address.ts";
import { App } from "./app/app.ts";
import { Loop } from "./app/loop.ts";
import { keepAwake, readAudience } from "./audience.ts";
import { type Debug, debug } from "./debug.ts";
import { probeGraphics } from "./draw/graphics.ts";
import { endpointOf } from "./feed/endpoint.ts";
import { forgetToken, takeToken } from "./token.ts";
import { CamerasList } from "./ui/cameras_list.ts";
import { byId, toast } from "./ui/dom.ts";
import { Figures } from "./ui/figures.ts";
import { FirstSeconds } from "./ui/first_seconds.ts";
import { Graphs } from "./ui/graphs.ts";
import { BodyTools } from "./ui/body_tools.ts";
import { bindKeys } from "./ui/keys.ts";
import { Layout } from "./ui/layout.ts";
import { Panel, TOKEN_REFUSED } from "./ui/panel.ts";
import { bindPointer } from "./ui/pointer.ts";
import { copyLink, savePicture } from "./ui/share.ts";
import { StatusLine } from "./ui/status_line.ts";
import { TimelineBar } from "./ui/timeline_bar.ts";
import { writeHash } from "./view/hash.ts";
import type { View } from "./view/orbit.ts";

declare global {
  interface Window {
    hulltouch?: Debug;
  }
}

/** So many faults are shown, then no more. */
const MAX_FAULTS_SHOWN = 3;

const canvas = byId<HTMLCanvasElement>("view");
const graphics = probeGraphics();
const audience = readAudience(location.search);
// A token in the address of an audience's screen is taken out of it and not used.
const token = takeToken(!audience.isClean);
let faults = 0;
/** Whether the pause that was asked for goes round the moment, and from which view that began. */
let circles = false;
let cameFrom: View | null = null;

const app = new App(canvas, graphics, audience.background, endpointOf(location.href, token), {
  run: (before, after) => {
    freeze(before.isPaused, after.isPaused);
    statusLine.changed(before, after);
    panel.paused();
    timeline.update();
  },
  hello: (hello, isFirst) => {
    cameras.build(hello);
    const isRefused = token !== null && !hello.controller;
    panel.hello(hello, isRefused);
    graphs.hello(hello.session);
    if (isRefused && isFirst) toast(TOKEN_REFUSED);
    if (isRefused) forgetToken();
    // A screen before an audience stays where its address says, also when the run comes again with another rig.
    if (isFirst || audience.isClean) applyAddress();
  },
  scene: (scene) => {
    address.followNamed();
    panel.scene(scene);
  },
  status: (status) => {
    cameras.update(status.cameras ?? []);
    figures.update();
    graphs.add(status);
  },
  view: () => {
    app.stage?.bodies.highlight(tools.chosen ?? app.follow);
    app.isOutdated = true;
    panel.update();
    cameras.pressed(app.through);
    timeline.update();
    if (!audience.isClean) address.changed();
  },
  thumbnail: (camera, bitmap) => cameras.thumbnail(camera, bitmap),
  fault: (text) => {
    if (++faults <= MAX_FAULTS_SHOWN) toast(text);
  },
});
const loop = new Loop(app);
const address = new Address(app);
const tools = new BodyTools(app);
const panel = new Panel(app, tools);
const cameras = new CamerasList(app);
const figures = new Figures(app, loop.received, graphics?.name ?? "none");
const graphs = new Graphs(app);
const timeline = new TimelineBar(app);
const statusLine = new StatusLine(app);
const firstSeconds = audience.isClean ? null : new FirstSeconds(app, canvas);

/** The world stands: one goes round the moment, and before an audience back when the world goes on. */
function freeze(wasPaused: boolean, isPaused: boolean): void {
  if (isPaused === wasPaused) return;
  if (isPaused) {
    if (!(circles || audience.isClean) || app.through !== null || !app.frames.playout.live) return;
    cameFrom = app.orbit.now;
    app.orbit.circle();
  } else {
    app.orbit.hold();
    if (audience.isClean && cameFrom) app.orbit.fly(cameFrom);
    cameFrom = null;
    circles = false;
  }
}

/** Goes where the address says; before an audience without what only operators need. */
function applyAddress(): void {
  address.apply(location.hash);
  if (audience.isClean) for (const layer of ["cameras", "images", "touches"] as const) app.setLayer(layer, false);
}

const actions = {
  screenshot: () => void savePicture(loop.screenshot()),
  share: () => void copyLink(writeHash(address.text())),
  help: () => byId<HTMLDialogElement>("help").showModal(),
  pause: () => {
    circles = !app.run.isPaused;
    void panel.togglePause();
  },
  step: () => void panel.step(),
  seekBeside: (direction: 1 | -1) => timeline.seekBeside(direction),
  reset: () => void panel.restart(),
  escape: () => {
    if (tools.placing) tools.placing = false;
    else if (app.through !== null) app.lookThrough(null);
    else if (app.follow !== null) app.followBody(null);
    else if (!app.frames.playout.live) app.goLive();
    canvas.classList.remove("placing");
    app.changed();
  },
};

document.body.classList.toggle("clean", audience.isClean);
document.documentElement.classList.toggle("see-through", audience.background === "transparent");
if (audience.isClean) {
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  keepAwake();
} else {
  bindPointer(canvas, app, tools, () => app.changed());
  bindKeys(canvas, app, actions, () => byId<HTMLInputElement>("shortcuts").checked);
}
if (audience.refused) {
  toast(audience.refused);
  console.warn(audience.refused);
}
byId("screenshot").addEventListener("click", actions.screenshot);
byId("share").addEventListener("click", actions.share);
byId("help-open").addEventListener("click", actions.help);
byId("help-close").addEventListener("click", () => byId<HTMLDialogElement>("help").close());
byId("fullscreen").addEventListener("click", () => {
  if (document.fullscreenElement) void document.exitFullscreen();
  else document.documentElement.requestFullscreen().catch(() => toast("This browser has no full screen."));
});
window.addEventListener("hashchange", applyAddress);
// Whatever is touched: the view is the viewer's again.
for (const input of ["pointerdown", "wheel", "keydown"]) {
  window.addEventListener(input, () => app.orbit.hold(), { capture: true, passive: true });
}

if (!graphics) {
  canvas.hidden = true;
  document.body.classList.add("no-view");
  byId("plain").hidden = false;
}
const layout = new Layout(app);
byId("cameras-gone").addEventListener("click", ({ detail }) => {
  layout.openPanel(true);
  cameras.showGone(detail === 0);
});
setInterval(() => {
  statusLine.update();
  timeline.update();
  timeline.seeThrough();
  firstSeconds?.update();
  graphs.update();
}, 250);
app.connection.connect();
loop.start();
window.hulltouch = debug(app, tools, version);
