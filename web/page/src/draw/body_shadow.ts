/** How far the light reaches before it meets a body: for the shadows of bodies on the person. */
import { DepthTexture, DoubleSide, type DirectionalLight, Matrix4, MeshBasicMaterial, NearestFilter, NoColorSpace, OrthographicCamera, type Scene, UnsignedIntType, WebGLRenderTarget, type WebGLRenderer } from "three";
import { ONLY_BODIES } from "./bodies.ts";

export class BodyShadow {
  /** World to the map: shares across, and depth. */
  readonly matrix = new Matrix4();
  private readonly eye = new OrthographicCamera();
  private readonly only = new MeshBasicMaterial({ colorWrite: false, side: DoubleSide });
  private target: WebGLRenderTarget | null = null;

  get depth(): DepthTexture | null {
    return this.target?.depthTexture ?? null;
  }

  /** Looks at the bodies of a scene from the light. */
  draw(renderer: WebGLRenderer, scene: Scene, light: DirectionalLight, size: number): void {
    if (this.target?.width !== size) {
      this.forget();
      const depthTexture = new DepthTexture(size, size, UnsignedIntType);
      depthTexture.minFilter = depthTexture.magFilter = NearestFilter;
      this.target = new WebGLRenderTarget(size, size, { colorSpace: NoColorSpace, depthTexture });
    }
    const { eye } = this;
    eye.copy(light.shadow.camera);
    eye.position.copy(light.position);
    eye.lookAt(light.target.position);
    eye.updateMatrixWorld(true);
    eye.layers.set(ONLY_BODIES);
    this.matrix.makeTranslation(0.5, 0.5, 0.5).multiply(new Matrix4().makeScale(0.5, 0.5, 0.5));
    this.matrix.multiply(eye.projectionMatrix).multiply(eye.matrixWorldInverse);
    const { background } = scene;
    [scene.background, scene.overrideMaterial] = [null, this.only];
    renderer.setRenderTarget(this.target);
    renderer.render(scene, eye);
    renderer.setRenderTarget(null);
    [scene.background, scene.overrideMaterial] = [background, null];
  }

  /** The card lost what was drawn. */
  release(): void {
    this.forget();
    this.only.dispose();
  }

  private forget(): void {
    this.target?.depthTexture?.dispose();
    this.target?.dispose();
    this.target = null;
  }
}
