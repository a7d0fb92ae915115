/** Array textures with a layer a camera, as large as the largest crop needs; they grow on demand. */
import { DataArrayTexture, LinearFilter, NoColorSpace, RedFormat, RGBAFormat, UnsignedByteType, type WebGLRenderer } from "three";

/** Layers grow in steps of so many texels, so that a person who turns does not allocate again each frame. */
const STEP = 64;

export class Layers {
  texture: DataArrayTexture;
  private readonly count: number;
  private readonly kind: "field" | "image";
  private size: readonly [number, number];

  constructor(count: number, kind: "field" | "image") {
    this.count = Math.max(1, count);
    this.kind = kind;
    this.size = [STEP, STEP];
    this.texture = this.allocate();
  }

  get layer(): readonly [number, number] {
    return this.size;
  }

  /** Grows so that a crop of this size fits; true if what was in it is lost. */
  fit(width: number, height: number): boolean {
    if (width <= this.size[0] && height <= this.size[1]) return false;
    const up = (n: number) => Math.ceil(n / STEP) * STEP;
    this.size = [Math.max(this.size[0], up(width)), Math.max(this.size[1], up(height))];
    this.texture.dispose();
    this.texture = this.allocate();
    return true;
  }

  /** Copies a crop into the corner of a camera's layer. */
  put(renderer: WebGLRenderer, camera: number, source: Uint8Array | ImageBitmap, width: number, height: number): void {
    const gl = renderer.getContext() as WebGL2RenderingContext;
    const known = renderer.properties.get(this.texture) as { __webglTexture?: WebGLTexture };
    if (!known.__webglTexture) this.create(renderer);
    const handle = (renderer.properties.get(this.texture) as { __webglTexture?: WebGLTexture }).__webglTexture;
    if (!handle) return;
    renderer.state.activeTexture(gl.TEXTURE0);
    renderer.state.bindTexture(gl.TEXTURE_2D_ARRAY, handle);
    // The renderer leaves its own values behind.
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, 0);
    gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, 0);
    gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, 0);
    gl.pixelStorei(gl.UNPACK_SKIP_ROWS, 0);
    gl.pixelStorei(gl.UNPACK_SKIP_IMAGES, 0);
    if (source instanceof Uint8Array) {
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, camera, width, height, 1, gl.RED, gl.UNSIGNED_BYTE, source);
    } else {
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, camera, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, source);
    }
  }

  /** The card lost what was in it. */
  forget(): void {
    this.texture.dispose();
    this.texture = this.allocate();
  }

  dispose(): void {
    this.texture.dispose();
  }

  /** The renderer makes the texture from zeros, which are not kept. */
  private create(renderer: WebGLRenderer): void {
    const image = this.texture.image as { data: Uint8Array | null };
    const [width, height] = this.size;
    image.data = new Uint8Array(width * height * this.count * (this.kind === "field" ? 1 : 4));
    this.texture.needsUpdate = true;
    renderer.initTexture(this.texture);
    image.data = null;
  }

  private allocate(): DataArrayTexture {
    const [width, height] = this.size;
    const texture = new DataArrayTexture(null, width, height, this.count);
    texture.format = this.kind === "field" ? RedFormat : RGBAFormat;
    texture.type = UnsignedByteType;
    texture.colorSpace = NoColorSpace;
    texture.minFilter = LinearFilter;
    texture.magFilter = LinearFilter;
    texture.generateMipmaps = false;
    texture.unpackAlignment = 1;
    return texture;
  }
}
