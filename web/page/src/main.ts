/** The page: puts its parts together. */
import "./style.css";
import { Address } from "./app/address.ts";
import { App } from "./app/app.ts";
import { Loop } from "./app/loop.ts";
import { type Debug, debug } from "./debug.ts";
import { probeGraphics } from "./draw/graphics.ts";
import { endpointOf } from "./feed/endpoint.ts";
import { takeToken } from "./token.ts";
import { CamerasList } from "./ui/cameras_list.ts";
import { byId, toast } from "./ui/dom.ts";
import { Figures } from "./ui/figures.ts";
import { BodyTools } from "./ui/body_tools.ts";
import { bindKeys } from "./ui/keys.ts";
import { Layout } from "./ui/layout.ts";
import { Panel } from "./ui/panel.ts";
import { bindPointer } from "./ui/pointer.ts";
import { copyLink, savePicture } from "./ui/share.ts";
import { StatusLine } from "./ui/status_line.ts";
import { TimelineBar } from "./ui/timeline_bar.ts";
import { writeHash } from "./view/hash.ts";

declare global {
  interface Window {
    hulltouch?: Debug;
  }
}

const VERSION = "0.1.0";
/** So many faults are shown, then no more. */
const MAX_FAULTS_SHOWN = 3;

const canvas = byId<HTMLCanvasElement>("view");
const graphics = probeGraphics();
const token = takeToken();
let faults = 0;

const app = new App(canvas, graphics, endpointOf(location.href, token), {
  run: (before, after) => {
    statusLine.changed(before, after);
    panel.paused();
    timeline.update();
  },
  hello: (hello, isFirst) => {
    cameras.build(hello);
    panel.hello(hello);
    if (isFirst) address.apply(location.hash);
  },
  scene: (scene) => {
    address.followNamed();
    panel.scene(scene);
  },
  status: (status) => {
    cameras.update(status.cameras ?? []);
    figures.update();
  },
  view: () => {
    app.stage?.bodies.highlight(tools.chosen ?? app.follow);
    app.isOutdated = true;
    panel.update();
    cameras.pressed(app.through);
    timeline.update();
    address.changed();
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
const timeline = new TimelineBar(app);
const statusLine = new StatusLine(app);

const actions = {
  screenshot: () => void savePicture(loop.screenshot()),
  share: () => void copyLink(writeHash(address.text())),
  help: () => byId<HTMLDialogElement>("help").showModal(),
  pause: () => void panel.togglePause(),
  step: () => void panel.ask("step", { steps: 1 }),
  reset: () => void panel.ask("reset"),
  escape: () => {
    if (tools.placing) tools.placing = false;
    else if (app.through !== null) app.lookThrough(null);
    else if (app.follow !== null) app.followBody(null);
    else if (!app.frames.playout.live) app.goLive();
    canvas.classList.remove("placing");
    app.changed();
  },
};

bindPointer(canvas, app, tools, () => app.changed());
bindKeys(canvas, app, actions, () => byId<HTMLInputElement>("shortcuts").checked);
byId("screenshot").addEventListener("click", actions.screenshot);
byId("share").addEventListener("click", actions.share);
byId("help-open").addEventListener("click", actions.help);
byId("help-close").addEventListener("click", () => byId<HTMLDialogElement>("help").close());
byId("fullscreen").addEventListener("click", () => {
  if (document.fullscreenElement) void document.exitFullscreen();
  else document.documentElement.requestFullscreen().catch(() => toast("This browser has no full screen."));
});
window.addEventListener("hashchange", () => address.apply(location.hash));

if (!graphics) {
  canvas.hidden = true;
  document.body.classList.add("no-view");
  byId("plain").hidden = false;
}
new Layout(app);
setInterval(() => {
  statusLine.update();
  timeline.update();
}, 250);
app.connection.connect();
loop.start();
window.hulltouch = debug(app, tools, VERSION);
