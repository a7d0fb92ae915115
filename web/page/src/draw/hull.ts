/**
 * The person: the visual hull of a frame set, found per pixel, coloured from the cameras that see it. It is
 * drawn into a picture of its own, with depth, and laid among the bodies by {@link HullView.compose}.
 */
import {
  BufferGeometry,
  DataArrayTexture,
  Float32BufferAttribute,
  GLSL3,
  InstancedBufferGeometry,
  Mesh,
  NearestFilter,
  NoBlending,
  NoColorSpace,
  CustomBlending,
  OneFactor,
  OneMinusSrcAlphaFactor,
  OrthographicCamera,
  RawShaderMaterial,
  Scene,
  type Texture,
  Vector2,
  Vector3,
  Vector4,
  Matrix3,
  Matrix4,
  WebGLArrayRenderTarget,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import type { Box } from "../decode/hull_box.ts";
import type { Decoded } from "../decode/work.ts";
import { type DistanceField, distanceField, fieldStep, Scratch } from "../feed/distance.ts";
import type { Camera } from "../view/lens.ts";
import type { HullMode } from "../view/hash.ts";
import { CameraBlock } from "./camera_block.ts";
import type { Eye } from "./eye.ts";
import * as glsl from "./glsl/index.ts";
import { Layers } from "./layers.ts";
import { CELL, Targets } from "./targets.ts";

/** Depth maps hold distances up to this, metres: no studio is larger. */
const DEPTH_RANGE_M = 40;
const TILE = 8;
/** Depth maps are this large: about a quarter of the silhouettes' own pixels. */
const MAPS = [64, 96, 128] as const;

/** What may be left out to draw faster. */
export interface Effort {
  /** Steps inwards that the photo test may make, 0 to 8. */
  readonly photoTests: number;
  /** Halvings of the depth maps' size. */
  readonly coarseMaps: number;
}

export class HullView {
  /** To be added to the scene, after opaque things. */
  readonly compose: Mesh;
  /** The box around the hull; null if there is none. */
  box: Box | null = null;
  readonly block: CameraBlock;
  readonly offImageIsOutside: boolean;
  readonly compiled: glsl.Compiled;
  readonly common: Record<string, { value: unknown }>;
  private readonly fields: Layers;
  private readonly images: Layers;
  /** Of each camera the distances to what it ignores, and their texture: both only if any camera ignores pixels. */
  private readonly ignored: readonly (DistanceField | null)[];
  private readonly ignoring: Layers | null;
  private ignoredAreUp = false;
  private readonly depths: WebGLArrayRenderTarget;
  private readonly start: RawShaderMaterial;
  private readonly surface: RawShaderMaterial;
  private readonly depth: RawShaderMaterial;
  private readonly read: RawShaderMaterial;
  private readonly composing: RawShaderMaterial;
  private readonly tiles: InstancedBufferGeometry;
  private readonly quad: Mesh;
  private readonly tiled: Mesh;
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  private readonly scene = new Scene();
  private targets: Targets | null = null;
  private reading: WebGLRenderTarget | null = null;
  private mapsAreOld = true;
  /** The longest side of the fields, texels. */
  private fieldSide = 1;
  private hasColour = false;
  /** Counts frame sets: with the view, what the picture in the targets is of. */
  private version = 0;
  private drawnKey = "";
  private drawnPart = new Vector4(0, 0, 1, 1);

  constructor(cameras: readonly Camera[], compiled: glsl.Compiled) {
    this.compiled = compiled;
    this.offImageIsOutside = compiled.offImageIsOutside;
    this.block = new CameraBlock(cameras);
    this.fields = new Layers(cameras.length, "field");
    this.images = new Layers(cameras.length, "image");
    const scratch = new Scratch();
    this.ignored = cameras.map(({ ignored, width, height }) => (ignored ? distanceField(ignored, true, fieldStep(width, height), scratch) : null));
    this.ignoring = compiled.ignoring ? new Layers(cameras.length, "field") : null;
    this.depths = new WebGLArrayRenderTarget(MAPS[0], MAPS[0], Math.max(1, cameras.length), {
      minFilter: NearestFilter,
      magFilter: NearestFilter,
      colorSpace: NoColorSpace,
      depthBuffer: false,
    });
    this.common = {
      uField: { value: this.fields.texture as DataArrayTexture },
      ...(this.ignoring ? { uIgnored: { value: this.ignoring.texture as DataArrayTexture } } : {}),
      uLow: { value: new Vector3() },
      uHigh: { value: new Vector3() },
      uLight: { value: new Vector3(0.4, 0.8, 0.45).normalize() },
      uUp: { value: new Vector3(0, 1, 0) },
      uDepthRange: { value: DEPTH_RANGE_M },
    };
    const whole = () => ({ value: new Vector4(0, 0, 1, 1) });
    const rays = {
      uEye: { value: new Vector3() },
      uTurn: { value: new Matrix3() },
      uPinhole: { value: new Vector4() },
      uSkew: { value: 0 },
      uBend: { value: new Vector4() },
      uBend3: { value: new Vector2() },
      uPixel: { value: 0.001 },
      uRange: { value: new Vector2(0, 16) },
      uStart: { value: null as Texture | null },
    };
    this.start = this.material(glsl.QUAD_VERTEX, glsl.START_FRAGMENT, { ...this.common, ...rays, uCell: { value: CELL }, uPart: whole() });
    this.surface = this.material(glsl.TILE_VERTEX, glsl.SURFACE_FRAGMENT, {
      ...this.common,
      ...rays,
      uImage: { value: this.images.texture as DataArrayTexture },
      uDepth: { value: this.depths.texture },
      uClip: { value: null },
      uMode: { value: 0 },
      uTests: { value: 8 },
      uTiles: { value: new Vector4() },
      uSize: { value: new Vector2() },
    });
    this.surface.depthTest = true;
    this.surface.depthWrite = true;
    this.depth = this.material(glsl.QUAD_VERTEX, glsl.DEPTH_FRAGMENT, { ...this.common, uCamera: { value: 0 }, uMap: { value: new Vector2() }, uPart: whole() });
    this.read = this.material(glsl.QUAD_VERTEX, glsl.READ_FRAGMENT, { uSurface: { value: null }, uFrom: { value: new Vector2() }, uPart: whole() }, false);
    this.composing = this.material(
      glsl.QUAD_VERTEX,
      glsl.COMPOSE_FRAGMENT,
      { uColour: { value: null }, uSurface: { value: null }, uScreen: { value: new Vector2() }, uFade: { value: 0 }, uPart: whole(), uSharp: { value: 0 }, uShadow: { value: null }, uShadows: { value: 0 }, uBias: { value: 0 }, uToShadow: { value: new Matrix4() }, uToWorld: { value: new Matrix4() }, uLight: this.common.uLight },
      false,
    );
    this.composing.depthTest = true;
    this.composing.depthWrite = true;
    this.composing.transparent = true;
    this.composing.blending = CustomBlending;
    this.composing.blendSrc = OneFactor;
    this.composing.blendDst = OneMinusSrcAlphaFactor;
    this.composing.premultipliedAlpha = true;
    const square = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0];
    const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(square, 3));
    this.tiles = new InstancedBufferGeometry();
    this.tiles.setAttribute("position", new Float32BufferAttribute(square, 3));
    this.tiles.instanceCount = 0;
    this.quad = new Mesh(geometry, this.start);
    this.tiled = new Mesh(this.tiles, this.surface);
    this.compose = new Mesh(geometry.clone(), this.composing);
    for (const mesh of [this.quad, this.tiled, this.compose]) mesh.frustumCulled = false;
    this.compose.renderOrder = -10;
    this.compose.visible = false;
  }

  /** Takes a decoded frame set onto the graphics card. Its bitmaps are closed. */
  upload(renderer: WebGLRenderer, set: Decoded): void {
    let [fieldWidth, fieldHeight, imageWidth, imageHeight] = [1, 1, 1, 1];
    for (const part of set.cameras) {
      fieldWidth = Math.max(fieldWidth, part.field?.columns ?? 1);
      fieldHeight = Math.max(fieldHeight, part.field?.rows ?? 1);
      imageWidth = Math.max(imageWidth, part.image?.width ?? 1);
      imageHeight = Math.max(imageHeight, part.image?.height ?? 1);
    }
    this.fieldSide = Math.max(fieldWidth, fieldHeight);
    this.fields.fit(fieldWidth, fieldHeight);
    this.images.fit(imageWidth, imageHeight);
    this.common.uField.value = this.fields.texture;
    this.surface.uniforms.uImage.value = this.images.texture;
    if (!this.ignoredAreUp) this.uploadIgnored(renderer);
    for (let k = 0; k < this.block.count; k++) this.block.absent(k);
    this.hasColour = false;
    for (const part of set.cameras) {
      if (part.field) this.fields.put(renderer, part.camera, part.field.bytes, part.field.columns, part.field.rows);
      if (part.image) {
        this.images.put(renderer, part.camera, part.image, part.image.width, part.image.height);
        this.hasColour = true;
      }
      this.block.show(part, this.fields.layer, part.image ? this.images.layer : null);
      part.image?.close();
    }
    this.box = set.box;
    if (set.box) {
      (this.common.uLow.value as Vector3).fromArray(set.box.low);
      (this.common.uHigh.value as Vector3).fromArray(set.box.high);
    }
    this.mapsAreOld = true;
    this.version++;
  }

  /** What cameras ignore never changes: it goes onto the card once. */
  private uploadIgnored(renderer: WebGLRenderer): void {
    this.ignoredAreUp = true;
    if (!this.ignoring) return;
    for (const field of this.ignored) if (field) this.ignoring.fit(field.columns, field.rows);
    this.common.uIgnored.value = this.ignoring.texture;
    for (const [k, field] of this.ignored.entries()) {
      if (!field) continue;
      this.ignoring.put(renderer, k, field.bytes, field.columns, field.rows);
      this.block.ignore(k, field, this.ignoring.layer);
    }
  }

  /** The card lost everything: lets go of what was on it. There is nothing to see until the next frame set. */
  release(): void {
    this.box = null;
    this.version++;
    this.mapsAreOld = true;
    this.targets?.dispose();
    this.targets = null;
    this.reading?.dispose();
    this.depths.dispose();
    this.fields.forget();
    this.images.forget();
    this.ignoring?.forget();
    this.ignoredAreUp = false;
    this.common.uField.value = this.fields.texture;
    this.surface.uniforms.uImage.value = this.images.texture;
    for (const material of [this.start, this.surface, this.depth, this.read, this.composing]) material.dispose();
    for (const mesh of [this.quad, this.tiled, this.compose]) mesh.geometry.dispose();
    this.block.group.dispose();
  }

  set up(up: readonly [number, number, number]) {
    (this.common.uUp.value as Vector3).fromArray(up);
  }

  /** Towards the light, unit, world. */
  set light(light: Vector3) {
    (this.common.uLight.value as Vector3).copy(light);
  }

  set fade(share: number) {
    this.composing.uniforms.uFade.value = share;
  }

  /** Bodies darken the person: the light's depth map of them, or none; `bias` in its depth. */
  shade(depth: Texture | null, toShadow: Matrix4, bias: number): void {
    const { uShadow, uShadows, uToShadow, uBias } = this.composing.uniforms;
    uShadow.value = depth;
    uShadows.value = depth === null ? 0 : 1;
    uBias.value = bias;
    (uToShadow.value as Matrix4).copy(toShadow);
  }

  /** Draws the hull for a view into its own picture and readies it for the scene that is drawn next. */
  draw(renderer: WebGLRenderer, eye: Eye, width: number, height: number, mode: HullMode, effort: Effort, screen: readonly [number, number]): void {
    const targets = this.targetsFor(width, height, mode);
    if (!targets) return;
    const key = [this.version, mode, effort.photoTests, ...eye.position, ...eye.turn, ...eye.pinhole].join();
    if (key !== this.drawnKey) {
      this.drawnKey = key;
      this.drawnPart = this.render(renderer, targets, eye, mode, effort, [0, 1]);
    }
    this.ready(targets, eye, screen, false);
  }

  /** Draws some rows of the hull's picture, shares of those that it can cover, from the bottom; the picture is as large as the screen. */
  drawRows(renderer: WebGLRenderer, eye: Eye, width: number, height: number, mode: HullMode, effort: Effort, rows: readonly [number, number]): void {
    const before = this.targets;
    const targets = this.targetsFor(width, height, mode);
    if (!targets) return;
    if (targets !== before) {
      // Depths are read at the pointer, also of rows that are not drawn yet.
      renderer.setRenderTarget(targets.surface);
      renderer.clear();
      renderer.setRenderTarget(null);
    }
    this.drawnKey = "";
    this.drawnPart = this.render(renderer, targets, eye, mode, effort, rows);
  }

  /** Readies a picture that was drawn by rows for the scene that is drawn next; sharp: a pixel is covered by the hull or not. */
  readyRows(eye: Eye, width: number, height: number, mode: HullMode, isSharp: boolean): void {
    const targets = this.targetsFor(width, height, mode);
    if (targets) this.ready(targets, eye, [width, height], isSharp);
  }

  /** What the hull is drawn into; null if it is not drawn. */
  private targetsFor(width: number, height: number, mode: HullMode): Targets | null {
    const visible = this.box !== null && mode !== "off";
    this.compose.visible = visible;
    if (!visible) return null;
    if (this.targets?.width === width && this.targets.height === height) return this.targets;
    this.targets?.dispose();
    this.targets = new Targets(width, height);
    this.drawnKey = "";
    return this.targets;
  }

  private ready(targets: Targets, eye: Eye, screen: readonly [number, number], isSharp: boolean): void {
    const uniforms = this.composing.uniforms;
    (uniforms.uPart.value as Vector4).copy(this.drawnPart);
    uniforms.uColour.value = targets.surface.texture;
    uniforms.uSurface.value = targets.surface.depthTexture;
    (uniforms.uScreen.value as Vector2).set(screen[0], screen[1]);
    (uniforms.uToWorld.value as Matrix4).copy(eye.clip).invert();
    uniforms.uSharp.value = isSharp ? 1 : 0;
  }

  /** The hull alone from any view: colours and depths, row by row from the bottom. */
  picture(renderer: WebGLRenderer, eye: Eye, width: number, height: number, mode: "photo" | "shaded"): { rgba: Uint8Array; depth: Float32Array } {
    const rgba = new Uint8Array(width * height * 4);
    const depth = new Float32Array(width * height).fill(1);
    if (!this.box) return { rgba, depth };
    const targets = new Targets(width, height);
    this.render(renderer, targets, eye, mode, { photoTests: 8, coarseMaps: 0 }, [0, 1]);
    renderer.readRenderTargetPixels(targets.surface, 0, 0, width, height, rgba);
    this.reading ??= new WebGLRenderTarget(1, 1, { colorSpace: NoColorSpace, depthBuffer: false });
    this.reading.setSize(width, height);
    this.read.uniforms.uSurface.value = targets.surface.depthTexture;
    (this.read.uniforms.uFrom.value as Vector2).set(0, 0);
    this.pass(renderer, this.quad, this.read, this.reading);
    const bytes = new Uint8Array(width * height * 4);
    renderer.readRenderTargetPixels(this.reading, 0, 0, width, height, bytes);
    for (let i = 0; i < depth.length; i++) depth[i] = (bytes[i * 4] * 65536 + bytes[i * 4 + 1] * 256 + bytes[i * 4 + 2]) / 16777215;
    targets.dispose();
    renderer.setRenderTarget(null);
    return { rgba, depth };
  }

  /** The depth at a point of the picture that was drawn last, shares from the top left; null beside the person. */
  depthAt(renderer: WebGLRenderer, x: number, y: number): number | null {
    if (!this.targets || !this.compose.visible) return null;
    const { width, height, surface } = this.targets;
    const [column, row] = [Math.floor(x * width), Math.floor((1 - y) * height)];
    if (column < 0 || row < 0 || column >= width || row >= height) return null;
    this.reading ??= new WebGLRenderTarget(1, 1, { colorSpace: NoColorSpace, depthBuffer: false });
    this.reading.setSize(1, 1);
    this.read.uniforms.uSurface.value = surface.depthTexture;
    (this.read.uniforms.uFrom.value as Vector2).set(column, row);
    this.pass(renderer, this.quad, this.read, this.reading);
    const bytes = new Uint8Array(4);
    renderer.readRenderTargetPixels(this.reading, 0, 0, 1, 1, bytes);
    const depth = (bytes[0] * 65536 + bytes[1] * 256 + bytes[2]) / 16777215;
    return depth < 1 ? depth : null;
  }

  dispose(): void {
    this.targets?.dispose();
    this.reading?.dispose();
    this.fields.dispose();
    this.images.dispose();
    this.ignoring?.dispose();
    this.depths.dispose();
    this.block.group.dispose();
    for (const material of [this.start, this.surface, this.depth, this.read, this.composing]) material.dispose();
    this.tiles.dispose();
    this.quad.geometry.dispose();
    this.compose.geometry.dispose();
  }

  /** Compiles what is needed, without stalling where the browser can do it aside. */
  async compile(renderer: WebGLRenderer): Promise<void> {
    for (const [mesh, material] of [
      [this.quad, this.start],
      [this.tiled, this.surface],
      [this.quad, this.depth],
      [this.compose, this.composing],
    ] as const) {
      const scene = new Scene();
      mesh.material = material;
      const parent = mesh.parent;
      scene.add(mesh);
      await renderer.compileAsync(scene, this.flat);
      scene.remove(mesh);
      parent?.add(mesh);
    }
  }

  /** Draws rows into targets, shares of those that the hull can be in; returns the part of the picture that it can be in. */
  private render(renderer: WebGLRenderer, targets: Targets, eye: Eye, mode: HullMode, effort: Effort, [from, to]: readonly [number, number]): Vector4 {
    const photo = mode === "photo" && this.hasColour;
    if (photo) this.drawMaps(renderer, effort.coarseMaps);
    const { width, height } = targets;
    this.setRays(eye, height);
    const [left, bottom, right, top] = this.bounds(eye, width, height);
    const part = new Vector4((left + right) / width - 1, (bottom + top) / height - 1, (right - left) / width, (top - bottom) / height);
    // Cells at the edge are larger than the picture.
    const [across, up] = [targets.start.width * CELL, targets.start.height * CELL];
    (this.start.uniforms.uPart.value as Vector4).set((left + right) / across - 1, (bottom + top) / up - 1, (right - left) / across, (top - bottom) / up);
    // The other rows start from the same picture.
    if (from === 0) this.pass(renderer, this.quad, this.start, targets.start);
    const uniforms = this.surface.uniforms;
    uniforms.uStart.value = targets.start.texture;
    uniforms.uClip.value = eye.clip;
    uniforms.uMode.value = photo ? 0 : 1;
    uniforms.uTests.value = effort.photoTests;
    const [columns, rows] = [Math.ceil((right - left) / TILE), Math.ceil((top - bottom) / TILE)];
    const [first, last] = [Math.round(from * rows), Math.round(to * rows)];
    (uniforms.uTiles.value as Vector4).set(left / TILE, bottom / TILE + first, columns, last - first);
    (uniforms.uSize.value as Vector2).set(width, height);
    this.tiles.instanceCount = columns * (last - first);
    // Rows that are not drawn now keep what was drawn before; what is neither is cleared with the first and the last ones.
    const [y0, y1] = [from === 0 ? 0 : bottom + first * TILE, to === 1 ? height : bottom + last * TILE];
    targets.surface.scissor.set(0, y0, width, Math.max(0, y1 - y0));
    this.pass(renderer, this.tiled, this.surface, targets.surface);
    return part;
  }

  /** The pixels that the hull's box covers, from the lower left, in whole tiles: all of them if it is near. */
  private bounds(eye: Eye, width: number, height: number): readonly [number, number, number, number] {
    const { low, high } = this.box!;
    const t = eye.turn;
    let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let corner = 0; corner < 8; corner++) {
      const d = [0, 1, 2].map((i) => ((corner >> i) & 1 ? high[i] : low[i]) - eye.position[i]);
      const depth = t[2] * d[0] + t[5] * d[1] + t[8] * d[2];
      if (depth < 0.1 || eye.lens.some((k) => k !== 0)) return [0, 0, tiles(width), tiles(height)];
      const [nx, ny] = [(t[0] * d[0] + t[3] * d[1] + t[6] * d[2]) / depth, (t[1] * d[0] + t[4] * d[1] + t[7] * d[2]) / depth];
      const u = eye.pinhole[0] * nx + eye.skew * ny + eye.pinhole[2];
      const v = height - (eye.pinhole[1] * ny + eye.pinhole[3]);
      [x0, y0, x1, y1] = [Math.min(x0, u), Math.min(y0, v), Math.max(x1, u), Math.max(y1, v)];
    }
    const inside = (n: number, most: number) => Math.max(0, Math.min(tiles(most), n));
    const down = (n: number) => Math.floor((n - CELL) / TILE) * TILE;
    const up = (n: number) => Math.ceil((n + CELL) / TILE) * TILE;
    return [inside(down(x0), width), inside(down(y0), height), inside(up(x1), width), inside(up(y1), height)];
  }

  private drawMaps(renderer: WebGLRenderer, coarse: number): void {
    const side = (MAPS.find((map) => map * 5 >= this.fieldSide) ?? MAPS[2]) >> coarse;
    if (!this.mapsAreOld && this.depths.width >= side) return;
    this.mapsAreOld = false;
    if (this.depths.width !== side) this.depths.setSize(side, side, Math.max(1, this.block.count));
    (this.depth.uniforms.uMap.value as Vector2).set(side, side);
    for (let k = 0; k < this.block.count; k++) {
      if (!this.block.hasField(k)) continue;
      this.depth.uniforms.uCamera.value = k;
      this.pass(renderer, this.quad, this.depth, this.depths, k);
    }
  }

  private setRays(eye: Eye, height: number): void {
    const { low, high } = this.box!;
    const middle = [0, 1, 2].map((i) => (low[i] + high[i]) / 2);
    const radius = 0.5 * Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) + 0.01;
    const away = Math.hypot(...middle.map((m, i) => m - eye.position[i]));
    for (const material of [this.start, this.surface]) {
      const u = material.uniforms;
      (u.uEye.value as Vector3).fromArray(eye.position);
      (u.uTurn.value as Matrix3).fromArray(eye.turn as number[]).transpose();
      // Rows count from the bottom where the shader runs.
      const [fx, fy, cx, cy] = eye.pinhole;
      (u.uPinhole.value as Vector4).set(fx, -fy, cx, height - cy);
      u.uSkew.value = eye.skew;
      (u.uBend.value as Vector4).set(eye.lens[0], eye.lens[1], eye.lens[2], eye.lens[3]);
      (u.uBend3.value as Vector2).set(eye.lens[4], eye.lens.some((k) => k !== 0) ? 1 : 0);
      u.uPixel.value = 1 / Math.min(eye.pinhole[0], eye.pinhole[1]);
      const nearest = Math.max(0, away - radius - 0.02);
      (u.uRange.value as Vector2).set(nearest, away + radius + 0.02 - nearest);
    }
  }

  private pass(renderer: WebGLRenderer, mesh: Mesh, material: RawShaderMaterial, target: WebGLRenderTarget, layer = 0): void {
    mesh.material = material;
    this.scene.clear();
    this.scene.add(mesh);
    const autoClear = renderer.autoClear;
    const alpha = renderer.getClearAlpha();
    renderer.autoClear = true;
    renderer.setClearAlpha(0);
    const shadows = renderer.shadowMap.autoUpdate;
    renderer.shadowMap.autoUpdate = false;
    renderer.setRenderTarget(target, layer);
    renderer.render(this.scene, this.flat);
    renderer.setRenderTarget(null);
    renderer.shadowMap.autoUpdate = shadows;
    renderer.autoClear = autoClear;
    renderer.setClearAlpha(alpha);
    this.scene.clear();
  }

  material(vertexShader: string, fragmentShader: string, uniforms: Record<string, { value: unknown }>, withCameras = true): RawShaderMaterial {
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader,
      fragmentShader,
      uniforms,
      defines: withCameras ? glsl.defines(this.compiled) : {},
      depthTest: false,
      depthWrite: false,
      blending: NoBlending,
    });
    if (withCameras) material.uniformsGroups = [this.block.group];
    return material;
  }
}

/** Up to whole tiles. */
function tiles(pixels: number): number {
  return Math.ceil(pixels / TILE) * TILE;
}
