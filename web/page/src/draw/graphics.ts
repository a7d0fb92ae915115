/** What there is to draw with. */

export interface Graphics {
  /** Edges are smoothed where that costs little. */
  readonly antialias: boolean;
  /** Drawn by the processor. */
  readonly software: boolean;
  readonly name: string;
}

/** Whether there is WebGL2, and on what. A context of its own, given back at once. */
export function probeGraphics(): Graphics | null {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { antialias: false, depth: false });
  if (!gl) return null;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  const software = /swiftshader|llvmpipe|software|basic render/i.test(name);
  return { antialias: !software, software, name };
}
