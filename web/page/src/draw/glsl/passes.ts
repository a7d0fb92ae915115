/** The passes around the surface: cameras' depth maps, composing, reading back, shadows. */
import { HULL, PRECISION } from "./common.ts";

/** What one camera sees of the hull: how far it is, at low resolution. */
export const DEPTH_FRAGMENT = /* glsl */ `${PRECISION}${HULL}
uniform int uCamera;
uniform vec2 uMap;
uniform float uDepthRange;
out vec4 depth;
void main() {
  vec4 box = CAM(uCamera, 10);
  vec2 n = box.xy + gl_FragCoord.xy / uMap * (box.zw - box.xy);
  // Beside its own silhouette a camera sees nothing of the hull; a texel of margin for those that are shared.
  depth = vec4(0.0);
  vec2 texel = (CAM(uCamera, 7).zw - CAM(uCamera, 7).xy) / uMap;
  if (fieldAt(uCamera, toImage(uCamera, n)) > max(texel.x, texel.y)) return;
  vec3 dir = CAM(uCamera, 0).xyz * n.x + CAM(uCamera, 1).xyz * n.y + CAM(uCamera, 2).xyz;
  float stretch = length(dir);
  dir /= stretch;
  vec3 eye = CAM(uCamera, 11).xyz;
  vec2 span = within(eye, dir);
  float t = span.x;
  bool hit = false;
  for (int i = 0; i < 64; i++) {
    if (t > span.y) break;
    float h = hull(eye + dir * t);
    if (h <= 0.002) { hit = true; break; }
    t += max(h, 0.006);
  }
  if (!hit) return;
  depth = vec4(pack16(t / stretch / uDepthRange), 1.0, 1.0);
}
`;

/** Onto the screen: edges softened over a pixel, unless many pictures are blended; and the depth as it was found. */
export const COMPOSE_FRAGMENT = /* glsl */ `${PRECISION}
uniform sampler2D uColour;
uniform sampler2D uSurface;
uniform vec2 uScreen;
uniform float uFade;
// Whether a pixel is covered or not, as it was found, in a picture of the screen's size: 1, or 0.
uniform int uSharp;
// How far the light gets before it meets a body.
uniform sampler2D uShadow;
// Whether it is there: 1, or 0.
uniform int uShadows;
uniform float uBias;
uniform mat4 uToShadow;
uniform mat4 uToWorld;
uniform vec3 uLight;
out vec4 colour;

const float SHADOW = 0.28;

vec3 worldAt(ivec2 at, float depth, vec2 size) {
  vec4 clip = vec4((vec2(at) + 0.5) / size, depth, 1.0) * 2.0 - 1.0;
  clip.w = 1.0;
  vec4 world = uToWorld * clip;
  return world.xyz / world.w;
}

// From a point of the surface to its neighbours along one direction; beside the outline to one of them.
vec3 along(ivec2 at, ivec2 step_, float depth, vec2 size) {
  float before = texelFetch(uSurface, at - step_, 0).r;
  float after = texelFetch(uSurface, at + step_, 0).r;
  return worldAt(after < 1.0 ? at + step_ : at, after < 1.0 ? after : depth, size) - worldAt(before < 1.0 ? at - step_ : at, before < 1.0 ? before : depth, size);
}

// The share of light that bodies take from a point of the surface, if it faces the light. Loops, because drawing by the
// processor goes through branches that are not taken.
float shadowAt(ivec2 at, float depth, vec2 size) {
  at = clamp(at, ivec2(2), ivec2(size) - 3);
  vec3 to = (uToShadow * vec4(worldAt(at, depth, size), 1.0)).xyz;
  float inside = depth < 1.0 && all(greaterThan(to, vec3(0.0))) && all(lessThan(to, vec3(1.0))) ? 0.25 : 0.0;
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 aside = (vec2(float(i & 1), float(i >> 1)) - 0.5) / vec2(textureSize(uShadow, 0));
    sum += inside * step(textureLod(uShadow, to.xy + aside, 0.0).r, to.z - uBias);
  }
  for (int i = 0; i < int(ceil(sum)); i++) {
    vec3 normal = cross(along(at, ivec2(2, 0), depth, size), along(at, ivec2(0, 2), depth, size));
    sum *= smoothstep(-0.2, 0.3, dot(normalize(normal + 1e-12), uLight));
  }
  return sum;
}

void main() {
  vec2 size = vec2(textureSize(uColour, 0));
  vec2 uv = gl_FragCoord.xy / uScreen;
  vec2 step_ = 0.5 / size;
  vec4 sum = 0.25 * (textureLod(uColour, uv + step_, 0.0) + textureLod(uColour, uv - step_, 0.0)
    + textureLod(uColour, uv + vec2(step_.x, -step_.y), 0.0) + textureLod(uColour, uv + vec2(-step_.x, step_.y), 0.0));
  if (uSharp == 1) sum = texelFetch(uColour, ivec2(gl_FragCoord.xy), 0);
  if (sum.a < 0.02) discard;
  ivec2 pixel = ivec2(uv * size);
  ivec2 most = ivec2(size) - 1;
  float alpha = texelFetch(uColour, min(pixel, most), 0).a;
  float depth = texelFetch(uSurface, min(pixel, most), 0).r;
  if (alpha < 0.5) {
    depth = 1.0;
    for (int i = 0; i < 9; i++) {
      ivec2 at = clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), most);
      depth = min(depth, texelFetch(uSurface, at, 0).r);
    }
  }
  // Inside, the picture as sharp as it is; only its edge is softened.
  vec4 here = textureLod(uColour, uv, 0.0);
  vec3 rgb = sum.a > 0.98 ? here.rgb / here.a : sum.rgb / sum.a;
  float grey = dot(rgb, vec3(0.299, 0.587, 0.114));
  rgb = mix(rgb, vec3(grey) * 0.7, uFade);
  for (int i = 0; i < uShadows; i++) rgb *= 1.0 - SHADOW * shadowAt(pixel, depth, size);
  colour = vec4(rgb * sum.a, sum.a);
  gl_FragDepth = depth;
}
`;

/** Depth as bytes, for pictures that are read back. */
export const READ_FRAGMENT = /* glsl */ `${PRECISION}
uniform sampler2D uSurface;
uniform vec2 uFrom;
out vec4 bytes;
void main() {
  float depth = texelFetch(uSurface, ivec2(gl_FragCoord.xy + uFrom), 0).r;
  float whole = floor(depth * 16777215.0 + 0.5);
  float a = floor(whole / 65536.0);
  float b = floor((whole - a * 65536.0) / 256.0);
  bytes = vec4(a, b, whole - a * 65536.0 - b * 256.0, 255.0) / 255.0;
}
`;

/** The shadow: the hull along the light's rays, into the light's own depth. */
export const SHADOW_VERTEX = /* glsl */ `
in vec3 position;
uniform mat4 modelMatrix;
uniform mat4 viewMatrix;
uniform mat4 projectionMatrix;
out vec3 world;
void main() {
  vec4 at = modelMatrix * vec4(position, 1.0);
  world = at.xyz;
  gl_Position = projectionMatrix * viewMatrix * at;
}
`;

export const SHADOW_FRAGMENT = /* glsl */ `${PRECISION}${HULL}
uniform mat4 viewMatrix;
uniform mat4 projectionMatrix;
uniform vec3 uLight;
in vec3 world;
out vec4 none;
void main() {
  vec3 eye = world + uLight * 20.0;
  vec3 dir = -uLight;
  vec2 span = within(eye, dir);
  float t = span.x;
  bool hit = false;
  for (int i = 0; i < 48; i++) {
    if (t > span.y) break;
    float h = hull(eye + dir * t);
    if (h <= 0.004) { hit = true; break; }
    t += max(h, 0.01);
  }
  if (!hit) discard;
  vec4 clip = projectionMatrix * viewMatrix * vec4(eye + dir * t, 1.0);
  gl_FragDepth = clamp(0.5 * clip.z / clip.w + 0.5, 0.0, 1.0);
  none = vec4(1.0);
}
`;
