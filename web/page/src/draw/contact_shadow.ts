/**
 * The soft dark rim where bodies stand on the floor: how near each point of the floor is to what is above it, seen from
 * below, and softened.
 */
import {
  type BufferGeometry,
  DoubleSide,
  GLSL3,
  Mesh,
  NoBlending,
  NoColorSpace,
  OrthographicCamera,
  PlaneGeometry,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  Vector2,
  Vector3,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import { PRECISION } from "./glsl/index.ts";
import { ONLY_BODIES } from "./bodies.ts";

/** Half of what it covers, metres. */
const REACH_M = 3;
/** A body so high above the floor darkens it to a third, metres. */
const HEIGHT_M = 0.08;
/** How far the rim reaches round a body, metres. */
const RIM_M = 0.07;
/** The darkest that it becomes, as a share of light. */
const DARKEST = 0.55;

const QUAD = "in vec3 position; out vec2 at; void main() { at = position.xy * 0.5 + 0.5; gl_Position = vec4(position.xy, 0.0, 1.0); }";

/** Five samples between texels with the weights of a bell, along one axis. */
const BLUR = /* glsl */ `${PRECISION}
uniform sampler2D uFrom;
uniform vec2 uStep;
in vec2 at;
out vec4 colour;
void main() {
  float sum = 0.0;
  float weights = 0.0;
  for (int i = -2; i <= 2; i++) {
    float weight = exp(-float(i * i) / 2.0);
    sum += weight * textureLod(uFrom, at + float(i) * uStep, 0.0).r;
    weights += weight;
  }
  colour = vec4(sum / weights);
}
`;

const VERTEX = /* glsl */ `
out vec2 at;
void main() {
  at = uv;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}
`;

const FRAGMENT = /* glsl */ `
uniform sampler2D uDark;
uniform float uDarkest;
in vec2 at;
void main() { gl_FragColor = vec4(0.0, 0.0, 0.0, uDarkest * texture2D(uDark, vec2(at.x, 1.0 - at.y)).r); }
`;

export class ContactShadow {
  /** Lies on the floor, in the ground's frame. */
  readonly plane: Mesh<PlaneGeometry, ShaderMaterial>;
  private readonly near: ShaderMaterial;
  private readonly blur: RawShaderMaterial;
  private readonly eye = new OrthographicCamera(-REACH_M, REACH_M, REACH_M, -REACH_M, -0.05, 4 * HEIGHT_M);
  private readonly scene = new Scene();
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  private readonly targets: readonly [WebGLRenderTarget, WebGLRenderTarget];

  constructor() {
    const target = () => new WebGLRenderTarget(1, 1, { colorSpace: NoColorSpace, generateMipmaps: false });
    this.targets = [target(), target()];
    this.near = new ShaderMaterial({
      uniforms: { uHeight: { value: HEIGHT_M } },
      vertexShader: "out float deep; void main() { vec4 at = modelViewMatrix * vec4(position, 1.0); deep = -at.z; gl_Position = projectionMatrix * at; }",
      fragmentShader: "uniform float uHeight; in float deep; void main() { gl_FragColor = vec4(exp(-max(0.0, deep) / uHeight)); }",
      side: DoubleSide,
      toneMapped: false,
    });
    this.blur = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: QUAD,
      fragmentShader: BLUR,
      uniforms: { uFrom: { value: null }, uStep: { value: new Vector2() } },
      depthTest: false,
      depthWrite: false,
      blending: NoBlending,
    });
    const quad = new Mesh(new PlaneGeometry(2, 2), this.blur);
    quad.frustumCulled = false;
    this.scene.add(quad);
    this.plane = new Mesh(
      new PlaneGeometry(2 * REACH_M, 2 * REACH_M),
      new ShaderMaterial({
        vertexShader: VERTEX,
        fragmentShader: FRAGMENT,
        uniforms: { uDark: { value: this.targets[0].texture }, uDarkest: { value: DARKEST } },
        transparent: true,
        depthWrite: false,
        toneMapped: false,
      }),
    );
    this.plane.rotation.x = -Math.PI / 2;
    this.eye.layers.set(ONLY_BODIES);
  }

  /** Looks at the bodies of a scene from below the floor; `size` in texels across. */
  draw(renderer: WebGLRenderer, scene: Scene, size: number): void {
    const { eye, plane } = this;
    for (const target of this.targets) target.setSize(size, size);
    // The eye's axes are those of the plane, so that what it sees lies on the plane as it is.
    plane.updateWorldMatrix(true, false);
    const e = plane.matrixWorld.elements;
    const [x, y] = [new Vector3(e[0], e[1], e[2]), new Vector3(e[4], e[5], e[6])];
    eye.matrixWorld.makeBasis(x, y.clone().negate(), new Vector3(-e[8], -e[9], -e[10])).setPosition(e[12], e[13], e[14]);
    eye.matrixWorldInverse.copy(eye.matrixWorld).invert();
    eye.matrixWorldAutoUpdate = false;
    const [near, far] = this.targets;
    const alpha = renderer.getClearAlpha();
    renderer.setClearAlpha(0);
    renderer.setRenderTarget(near);
    const { background } = scene;
    [scene.background, scene.overrideMaterial] = [null, this.near];
    renderer.render(scene, eye);
    [scene.background, scene.overrideMaterial] = [background, null];
    const { uFrom, uStep } = this.blur.uniforms;
    const step = RIM_M / 2 / (2 * REACH_M);
    for (const [from, to, dx, dy] of [[near, far, step, 0], [far, near, 0, step]] as const) {
      uFrom.value = from.texture;
      uStep.value.set(dx, dy);
      renderer.setRenderTarget(to);
      renderer.render(this.scene, this.flat);
    }
    renderer.setRenderTarget(null);
    renderer.setClearAlpha(alpha);
  }

  /** Lets go of what is on the card; it is made again with its next use. */
  release(): void {
    for (const target of this.targets) target.dispose();
    for (const material of [this.near, this.blur, this.plane.material]) material.dispose();
    (this.scene.children[0] as Mesh<BufferGeometry>).geometry.dispose();
    this.plane.geometry.dispose();
  }
}
