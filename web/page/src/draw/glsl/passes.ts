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

/** Onto the screen: edges softened over a pixel, and the depth as it was found. */
export const COMPOSE_FRAGMENT = /* glsl */ `${PRECISION}
uniform sampler2D uColour;
uniform sampler2D uSurface;
uniform vec2 uScreen;
uniform float uFade;
out vec4 colour;
void main() {
  vec2 size = vec2(textureSize(uColour, 0));
  vec2 uv = gl_FragCoord.xy / uScreen;
  vec2 step_ = 0.5 / size;
  vec4 sum = 0.25 * (textureLod(uColour, uv + step_, 0.0) + textureLod(uColour, uv - step_, 0.0)
    + textureLod(uColour, uv + vec2(step_.x, -step_.y), 0.0) + textureLod(uColour, uv + vec2(-step_.x, step_.y), 0.0));
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
