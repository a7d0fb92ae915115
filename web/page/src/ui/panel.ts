/** The panel's buttons and fields: what they do, and what they show. */
import type { App } from "../app/app.ts";
import type { Hello, Scene } from "../feed/text.ts";
import type { HullMode, Layer } from "../view/hash.ts";
import { BackgroundTaking } from "./background.ts";
import { byId, option, setPressed, setText, toast } from "./dom.ts";
import type { BodyTools, ShapeKind } from "./body_tools.ts";
import { ParameterSliders } from "./parameters.ts";
import { takeAway } from "./take_away.ts";

const NO_TOKEN = "You are a viewer. To steer, open the page with its token.";
const NO_STEP = "Live film goes on and cannot be stepped: only bodies would move. A recording can be stepped.";
export const TOKEN_REFUSED = "The token was refused: you are a viewer. To steer, open the address that the program printed when it started.";

export class Panel {
  private readonly app: App;
  private readonly tools: BodyTools;
  private readonly sliders: ParameterSliders;

  constructor(app: App, tools: BodyTools) {
    this.app = app;
    this.tools = tools;
    this.sliders = new ParameterSliders(app, (fields) => void this.ask("set", fields));
    this.bindView();
    this.bindWorld();
    this.bindFigures();
    new BackgroundTaking(app);
  }

  /** `isRefused`: a token was shown, and is not the run's. */
  hello(hello: Hello, isRefused: boolean): void {
    const camera = byId<HTMLSelectElement>("camera");
    camera.replaceChildren(option("", "None: free view"), ...hello.cameras.map((c, index) => option(String(index), index < 9 ? `${c.name} (${index + 1})` : c.name)));
    const scene = byId<HTMLSelectElement>("scene");
    scene.replaceChildren(...hello.scenes.map((name) => option(name, name)));
    const response = byId<HTMLSelectElement>("response");
    response.replaceChildren(...(hello.responses.length > 0 ? hello.responses : ["paper", "off"]).map((name) => option(name, name === "off" ? "Off" : "Moves bodies")));
    for (const part of document.querySelectorAll<HTMLFieldSetElement | HTMLButtonElement | HTMLSelectElement>(".steer")) {
      part.disabled = !hello.controller || (hello.replay && part.classList.contains("change"));
    }
    const step = byId<HTMLButtonElement>("step");
    step.hidden = !hello.film_waits;
    // A viewer cannot steer: the view is what there is.
    if (!hello.controller) byId<HTMLDetailsElement>("view-part").open = true;
    byId("viewer-note").hidden = hello.controller;
    setText(byId("viewer-note"), isRefused ? TOKEN_REFUSED : NO_TOKEN);
    byId("replay-note").hidden = !hello.replay;
    for (const id of ["insecure", "insecure-note"]) byId(id).hidden = hello.insecure === null;
    byId("insecure").title = hello.insecure ?? "";
    setText(byId("insecure-note"), hello.insecure === null ? "" : `Not encrypted: ${hello.insecure}`);
    const role = byId("role");
    role.hidden = false;
    setText(role, hello.controller ? "Controller" : "Viewer");
    if (this.app.scene) this.scene(this.app.scene);
  }

  scene(scene: Scene): void {
    const select = byId<HTMLSelectElement>("scene");
    if (![...select.options].some(({ value }) => value === scene.scene) && scene.scene) select.append(option(scene.scene, scene.scene));
    select.value = scene.scene;
    const { answers_hull } = scene.parameters;
    if (answers_hull !== undefined && answers_hull !== null) {
      const response = byId<HTMLSelectElement>("response");
      const answering = [...response.options].find(({ value }) => value !== "off");
      response.value = answers_hull ? (answering?.value ?? "") : "off";
    }
    this.sliders.show(scene.parameters);
    byId<HTMLSelectElement>("body").replaceChildren(option("", "None"), ...scene.bodies.map(({ id, name }) => option(String(id), name)));
    if (this.tools.chosen !== null && !scene.bodies.some(({ id }) => id === this.tools.chosen)) this.tools.chosen = null;
    this.update();
  }

  /** Shows the state of the view. */
  update(): void {
    const { app, tools } = this;
    for (const button of byId("modes").querySelectorAll<HTMLButtonElement>("[data-mode]")) setPressed(button, button.dataset.mode === app.mode);
    for (const box of byId("layers").querySelectorAll<HTMLInputElement>("[data-layer]")) box.checked = app.layers.has(box.dataset.layer as Layer);
    byId<HTMLSelectElement>("camera").value = app.through === null ? "" : String(app.through);
    byId("through").hidden = app.through === null;
    byId<HTMLInputElement>("opacity").value = String(Math.round(app.opacity * 100));
    setText(byId("opacity-text"), `${Math.round(app.opacity * 100)} %`);
    byId<HTMLInputElement>("in-front").checked = app.inFront;
    byId<HTMLSelectElement>("body").value = String(tools.chosen ?? app.follow ?? "");
    setPressed(byId("follow"), app.follow !== null);
    byId<HTMLButtonElement>("follow").disabled = tools.chosen === null && app.follow === null;
    const chosen = tools.chosen === null ? null : app.stage?.bodies.text(tools.chosen);
    byId("chosen-row").hidden = !chosen || !app.steers;
    if (chosen) setText(byId("chosen"), chosen.name);
    setPressed(byId("place"), tools.placing);
    byId("hint").hidden = !tools.placing;
    this.paused();
    const through = app.through === null ? "free view" : `through ${app.rig[app.through]?.name}`;
    setText(byId("summary"), `${through}; person ${app.mode}; ${app.stage?.bodies.count ?? 0} bodies.`);
  }

  /** Shows whether the world is paused. */
  paused(): void {
    const { isPaused } = this.app.run;
    const button = byId("pause");
    setPressed(button, isPaused);
    setText(button.querySelector("span")!, isPaused ? "Go on" : "Pause");
    button.querySelector("use")!.setAttribute("href", isPaused ? "#i-play" : "#i-pause");
  }

  async togglePause(): Promise<void> {
    await this.ask(this.app.run.isPaused ? "resume" : "pause");
  }

  /** Makes one step of bodies and person; of live film there is none. */
  async step(): Promise<void> {
    if (this.app.hello?.film_waits) await this.ask("step", { steps: 1 });
    else toast(NO_STEP);
  }

  /** Begins the scene again; the world before it can come back. */
  async restart(): Promise<void> {
    await takeAway(this.app, "reset", {}, "The scene was restarted.");
  }

  async ask(command: string, fields: Record<string, unknown> = {}): Promise<void> {
    const answer = await this.app.command(command, fields);
    if ("refused" in answer) toast(answer.refused);
  }

  private bindView(): void {
    const { app } = this;
    byId("modes").addEventListener("click", (event) => {
      const mode = (event.target as HTMLElement).closest<HTMLElement>("[data-mode]")?.dataset.mode;
      if (mode) app.setMode(mode as HullMode);
    });
    for (const button of document.querySelectorAll<HTMLElement>("[data-preset]")) button.addEventListener("click", () => app.preset(button.dataset.preset!));
    byId("layers").addEventListener("change", (event) => {
      const box = event.target as HTMLInputElement;
      if (box.dataset.layer) app.setLayer(box.dataset.layer as Layer, box.checked);
    });
    const camera = byId<HTMLSelectElement>("camera");
    camera.addEventListener("change", () => app.lookThrough(camera.value === "" ? null : Number(camera.value)));
    const opacity = byId<HTMLInputElement>("opacity");
    opacity.addEventListener("input", () => {
      app.opacity = Number(opacity.value) / 100;
      app.changed();
    });
    const body = byId<HTMLSelectElement>("body");
    body.addEventListener("change", () => {
      this.tools.chosen = body.value === "" ? null : Number(body.value);
      app.followBody(app.follow === null ? null : this.tools.chosen);
    });
    byId("follow").addEventListener("click", () => app.followBody(app.follow === null ? this.tools.chosen : null));
    const inFront = byId<HTMLInputElement>("in-front");
    inFront.addEventListener("change", () => {
      app.inFront = inFront.checked;
      app.changed();
    });
  }

  private bindWorld(): void {
    const { app, tools } = this;
    byId("pause").addEventListener("click", () => void this.togglePause());
    byId("step").addEventListener("click", () => void this.step());
    byId("reset").addEventListener("click", () => void this.restart());
    const scene = byId<HTMLSelectElement>("scene");
    scene.addEventListener("change", () => void takeAway(app, "choose", { scene: scene.value }, `Scene ${scene.value} was chosen.`));
    const shape = byId<HTMLSelectElement>("shape");
    shape.addEventListener("change", () => (tools.kind = shape.value as ShapeKind));
    const size = byId<HTMLInputElement>("size");
    size.addEventListener("input", () => {
      tools.sizeM = Number(size.value) / 100;
      setText(byId("size-text"), `${size.value} cm`);
    });
    byId("place").addEventListener("click", () => {
      tools.placing = !tools.placing;
      byId("view").classList.toggle("placing", tools.placing);
      app.changed();
    });
    byId("drop").addEventListener("click", () => void tools.drop());
    byId("push").addEventListener("click", () => void tools.push());
    byId("remove").addEventListener("click", () => void tools.remove());
    const response = byId<HTMLSelectElement>("response");
    response.addEventListener("change", () => void this.ask("set", { answers_hull: response.value !== "off" }));
  }

  private bindFigures(): void {
    const { app } = this;
    const quality = byId<HTMLSelectElement>("quality");
    quality.addEventListener("change", () => {
      app.quality.fixed = quality.value === "auto" ? null : quality.value === "high" ? 0 : 4;
      app.changed();
    });
    const colour = byId<HTMLSelectElement>("colour");
    colour.addEventListener("change", () => {
      app.colour = colour.value as App["colour"];
      app.changed();
    });
  }
}
