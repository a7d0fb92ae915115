/** What the person's picture is drawn into, at one size: the coarse march, then the surface with its depth. */
import { DepthTexture, LinearFilter, NearestFilter, NoColorSpace, UnsignedIntType, WebGLRenderTarget } from "three";

/** Pixels a side of a cell of the first pass; the surface pass counts on it. */
export const CELL = 4;

export class Targets {
  readonly start: WebGLRenderTarget;
  readonly surface: WebGLRenderTarget;
  readonly width: number;
  readonly height: number;

  constructor(width: number, height: number) {
    this.width = width;
    this.height = height;
    this.start = new WebGLRenderTarget(Math.ceil(width / CELL), Math.ceil(height / CELL), {
      minFilter: NearestFilter,
      magFilter: NearestFilter,
      colorSpace: NoColorSpace,
      depthBuffer: false,
    });
    const depth = new DepthTexture(width, height, UnsignedIntType);
    depth.minFilter = NearestFilter;
    depth.magFilter = NearestFilter;
    this.surface = new WebGLRenderTarget(width, height, {
      minFilter: LinearFilter,
      magFilter: LinearFilter,
      colorSpace: NoColorSpace,
      depthTexture: depth,
    });
    this.surface.scissorTest = true;
  }

  dispose(): void {
    this.start.dispose();
    this.surface.depthTexture?.dispose();
    this.surface.dispose();
  }
}
