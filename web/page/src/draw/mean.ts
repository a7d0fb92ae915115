/** The mean of several pictures on the canvas, at its size; it stays on the graphics card until the size changes. */
import {
  BufferGeometry,
  ConstantAlphaFactor,
  CustomBlending,
  Float32BufferAttribute,
  FramebufferTexture,
  GLSL3,
  HalfFloatType,
  Mesh,
  NearestFilter,
  NoBlending,
  NoColorSpace,
  OneMinusConstantAlphaFactor,
  OrthographicCamera,
  RawShaderMaterial,
  Scene,
  type Texture,
  UnsignedByteType,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import { PRECISION } from "./glsl/index.ts";

const VERTEX = "in vec3 position; void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }";
const FRAGMENT = /* glsl */ `${PRECISION}
uniform sampler2D uFrom;
out vec4 colour;
void main() { colour = texelFetch(uFrom, ivec2(gl_FragCoord.xy), 0); }
`;

export class MeanPicture {
  /** What is on the card: the last picture as it was on the canvas (4 bytes a pixel), and the mean (8 bytes, or 4). */
  private kept: { readonly last: FramebufferTexture; readonly mean: WebGLRenderTarget } | null = null;
  private readonly blend = material();
  private readonly copy = material();
  private readonly quad: Mesh<BufferGeometry, RawShaderMaterial>;
  private readonly scene = new Scene();
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  constructor() {
    // Premultiplied colours and alpha alike: the mean over nothing is right too.
    this.blend.blending = CustomBlending;
    this.blend.blendSrc = ConstantAlphaFactor;
    this.blend.blendDst = OneMinusConstantAlphaFactor;
    const corners = [-1, -1, 0, 3, -1, 0, -1, 3, 0];
    this.quad = new Mesh(new BufferGeometry().setAttribute("position", new Float32BufferAttribute(corners, 3)), this.copy);
    this.quad.frustumCulled = false;
    this.scene.add(this.quad);
  }

  /** Adds the picture that was just drawn on the canvas, as the `count`th, and shows the mean of all in its place. */
  add(renderer: WebGLRenderer, width: number, height: number, count: number): void {
    const { last, mean } = this.fit(renderer, width, height);
    renderer.setRenderTarget(null);
    renderer.copyFramebufferToTexture(last);
    this.blend.blendAlpha = 1 / count;
    this.pass(renderer, this.blend, last, mean);
    this.show(renderer);
  }

  /** Draws the mean on the canvas. */
  show(renderer: WebGLRenderer): void {
    if (this.kept) this.pass(renderer, this.copy, this.kept.mean.texture, null);
  }

  /** Lets go of what is on the card; it is made again with its next use. */
  release(): void {
    this.forget();
    for (const each of [this.blend, this.copy]) each.dispose();
    this.quad.geometry.dispose();
  }

  /** The canvas has another size: the memory is free until the next picture stands. */
  forget(): void {
    this.kept?.last.dispose();
    this.kept?.mean.dispose();
    this.kept = null;
  }

  private fit(renderer: WebGLRenderer, width: number, height: number): { last: FramebufferTexture; mean: WebGLRenderTarget } {
    if (this.kept?.mean.width !== width || this.kept.mean.height !== height) this.forget();
    return (this.kept ??= { last: new FramebufferTexture(width, height), mean: target(renderer, width, height) });
  }

  private pass(renderer: WebGLRenderer, how: RawShaderMaterial, from: Texture, to: WebGLRenderTarget | null): void {
    how.uniforms.uFrom.value = from;
    this.quad.material = how;
    const { autoClear } = renderer;
    renderer.autoClear = false;
    renderer.setRenderTarget(to);
    renderer.render(this.scene, this.flat);
    renderer.setRenderTarget(null);
    renderer.autoClear = autoClear;
  }
}

/** Bytes are too coarse for a mean of many, but every card can draw them. */
function target(renderer: WebGLRenderer, width: number, height: number): WebGLRenderTarget {
  const canDrawHalves = ["EXT_color_buffer_float", "EXT_color_buffer_half_float"].some((name) => renderer.extensions.has(name));
  return new WebGLRenderTarget(width, height, {
    type: canDrawHalves ? HalfFloatType : UnsignedByteType,
    colorSpace: NoColorSpace,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    depthBuffer: false,
  });
}

function material(): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: { uFrom: { value: null } },
    depthTest: false,
    depthWrite: false,
    blending: NoBlending,
  });
}
