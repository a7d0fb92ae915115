/** Where rays meet the hull: a coarse march of cells first, then the tiles that have something. */
import { HULL, PRECISION, RAYS } from "./common.ts";

/** A rectangle of the picture: middle and half size in clip space. */
export const QUAD_VERTEX = /* glsl */ `
in vec3 position;
uniform vec4 uPart;
void main() { gl_Position = vec4(uPart.xy + position.xy * uPart.zw, 0.0, 1.0); }
`;

/** Low resolution: where no ray of the cell can have met the hull yet. */
export const START_FRAGMENT = /* glsl */ `${PRECISION}${HULL}${RAYS}
uniform float uCell;
out vec4 start;
void main() {
  vec3 dir = ray(gl_FragCoord.xy * uCell);
  vec2 span = within(uEye, dir);
  // The cell's corner rays may enter the box where its middle ray does not.
  float grow = 0.75 * uCell * uPixel;
  float t = max(span.x - grow * span.x, 0.0);
  float end = span.y;
  if (span.x > span.y) {
    vec3 middle = 0.5 * (uLow + uHigh);
    float along = dot(middle - uEye, dir);
    float radius = 0.5 * length(uHigh - uLow);
    if (length(middle - uEye - dir * along) > radius + grow * max(along, 0.0)) discard;
    t = max(along - radius, 0.0);
    end = along + radius;
  }
  bool hit = false;
  for (int i = 0; i < 64; i++) {
    if (t > end) break;
    float rho = grow * t;
    float h = hull(uEye + dir * t);
    hit = true;
    if (h <= rho) break;
    hit = false;
    t += max(h - rho, 0.004);
    if (i == 63) hit = t <= end;
  }
  if (!hit) discard;
  start = vec4(pack16((t - 0.004 - uRange.x) / uRange.y), 0.0, 1.0);
}
`;

/** Tiles of 8 × 8 pixels; those without a start are folded away. */
export const TILE_VERTEX = /* glsl */ `
precision highp float;
precision highp int;
precision highp sampler2D;
in vec3 position;
uniform sampler2D uStart;
uniform vec4 uTiles;
uniform vec2 uSize;
void main() {
  int across = int(uTiles.z);
  ivec2 tile = ivec2(uTiles.xy) + ivec2(gl_InstanceID % across, gl_InstanceID / across);
  ivec2 most = textureSize(uStart, 0) - 1;
  ivec2 cell = tile * 2;
  float any_ = texelFetch(uStart, min(cell, most), 0).a + texelFetch(uStart, min(cell + ivec2(1, 0), most), 0).a
    + texelFetch(uStart, min(cell + ivec2(0, 1), most), 0).a + texelFetch(uStart, min(cell + ivec2(1, 1), most), 0).a;
  vec2 corner = (vec2(tile) + position.xy * 0.5 + 0.5) * 8.0 / uSize * 2.0 - 1.0;
  gl_Position = any_ > 0.0 ? vec4(corner, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
`;
