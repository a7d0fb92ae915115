/** What the shaders of the person share: the hull as a distance, and the rays that are marched by it. */
import { MARGIN_PIXELS, NEAR_PIXELS } from "../../feed/distance.ts";

/** What depends on the rig and is compiled in. */
export interface Compiled {
  readonly cameras: number;
  readonly offImageIsOutside: boolean;
  readonly minViews: number;
  /** No camera has a lens that bends. */
  readonly straight: boolean;
  /** Some camera ignores pixels. */
  readonly ignoring: boolean;
}

export function defines(compiled: Compiled): Record<string, string | number> {
  return {
    N: Math.max(1, compiled.cameras),
    MIN_VIEWS: compiled.minViews,
    ...(compiled.offImageIsOutside ? { OUTSIDE: 1 } : {}),
    ...(compiled.straight ? { STRAIGHT: 1 } : {}),
    ...(compiled.ignoring ? { IGNORING: 1 } : {}),
  };
}

export const PRECISION = /* glsl */ `
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
`;

/** The hull as a distance, and rays to march along. */
export const HULL = /* glsl */ `
layout(std140) uniform Cameras { vec4 cam[N * 16]; };
#define CAM(k, i) cam[(k) * 16 + (i)]
uniform sampler2DArray uField;
#ifdef IGNORING
uniform sampler2DArray uIgnored;
#endif
uniform vec3 uLow;
uniform vec3 uHigh;

// World to camera frame.
vec3 toCamera(int k, vec3 P) {
  vec4 a = CAM(k, 0), b = CAM(k, 1), c = CAM(k, 2);
  return vec3(dot(a.xyz, P) + a.w, dot(b.xyz, P) + b.w, dot(c.xyz, P) + c.w);
}

// Normalised coordinates to the image, half a pixel on: pixel (i, j) covers i to i + 1.
vec2 toImage(int k, vec2 n) {
  vec4 m = CAM(k, 3);
#ifdef STRAIGHT
  return vec2(m.x * n.x + m.y * n.y + m.z, CAM(k, 4).x * n.y + m.w) + 0.5;
#endif
  vec4 bend = CAM(k, 5);
  float k3 = CAM(k, 6).x;
  float r2 = dot(n, n);
  float c = 1.0 + r2 * (bend.x + r2 * (bend.y + r2 * k3));
  float xy = n.x * n.y;
  vec2 d = c * n + vec2(2.0 * bend.z * xy + bend.w * (r2 + 2.0 * n.x * n.x), bend.z * (r2 + 2.0 * n.y * n.y) + 2.0 * bend.w * xy);
  return vec2(m.x * d.x + m.y * d.y + m.z, CAM(k, 4).x * d.y + m.w) + 0.5;
}

// Pixels to what a texture of distances is of, positive outside; rect: what a layer holds, scale: pixels to it.
float readField(highp sampler2DArray field, int k, vec2 px, vec4 rect, vec2 scale) {
  float texel = CAM(k, 6).w;
  vec2 off = px - clamp(px, rect.xy, rect.zw);
  float r = dot(off, off);
  if (r > 0.0) return sqrt(r) + ${MARGIN_PIXELS.toFixed(1)} * texel;
  vec2 half_ = vec2(0.5 * texel);
  vec2 uv = (clamp(px, rect.xy + half_, rect.zw - half_) - rect.xy) * scale;
  return (textureLod(field, vec3(uv, float(k)), 0.0).r * 127.5 - ${NEAR_PIXELS.toFixed(1)}) * texel;
}

// Pixels to the silhouette and what is ignored, positive outside.
float fieldAt(int k, vec2 px) {
  return readField(uField, k, px, CAM(k, 7), CAM(k, 12).xy);
}

#ifdef IGNORING
// Pixels to what camera k ignores, below zero within.
float ignoredAt(int k, vec2 px) {
  vec2 scale = CAM(k, 12).zw;
  return scale.x > 0.0 ? readField(uIgnored, k, px, CAM(k, 13), scale) : 1e3;
}
#endif

// At least how far, in metres, a point is from where camera k's answer changes; below zero inside. What one
// cannot see is negative in y: then x tells how far its view is. Zero in y: an ignored pixel, where one neither
// sees nor carves; z tells how far it is from one that is not.
vec3 cone(int k, vec3 P) {
  vec4 scale = CAM(k, 4);
  vec3 X = toCamera(k, P);
  if (X.z < 1e-3) return vec3(max(0.01, -X.z), -1.0, 0.0);
  vec2 n = X.xy / X.z;
  float s2 = 1.0 + dot(n, n);
  float s = sqrt(s2);
  float beyond = s2 - 1.0 > scale.z * scale.z ? sqrt(s2 - 1.0) - scale.z : 0.0;
  if (beyond > 0.0) return vec3(beyond * X.z / (s + beyond), -1.0, 0.0);
  vec2 px = toImage(k, n);
  float d = scale.w > 1.5 ? 400.0 : fieldAt(k, px);
  // The chamfer is up to a twelfth too long.
  if (d > 0.0) d *= 0.924;
#ifndef OUTSIDE
  vec2 past = max(-px, px - CAM(k, 6).yz);
  float edge = max(past.x, past.y);
  if (edge > 0.0) return vec3(edge * X.z / (scale.y * s + edge), -1.0, 0.0);
  if (d > 0.0) d = min(d, max(-edge, 0.25));
#endif
#ifdef IGNORING
  float deep = -0.924 * ignoredAt(k, px);
  if (deep >= 0.0) return vec3(min(d, 0.0) * X.z / (scale.y * s), 0.0, deep * X.z / (scale.y * s + deep));
#endif
  return vec3(d * X.z / (scale.y * s + max(d, 0.0)), 1.0, 0.0);
}

// At least how far a point is from the hull: below zero inside.
float hull(vec3 P) {
  float farthest = -1e3;
  float view = 1e3;
  int inside = 0;
  for (int k = 0; k < N; k++) {
    if (CAM(k, 4).w < 0.5) continue;
    vec3 c = cone(k, P);
#ifndef OUTSIDE
    if (c.y < 0.0) {
      view = min(view, c.x);
      continue;
    }
#endif
    farthest = max(farthest, c.x);
#ifdef IGNORING
    if (c.y == 0.0) {
      view = min(view, c.z);
      continue;
    }
#endif
    inside++;
  }
  // Too few cameras to call it inside: it is as far as to the nearest view.
  if (inside < MIN_VIEWS && farthest <= 0.0) return max(view, 0.01);
  return farthest;
}

// Where a ray is within the hull's box: from x to y; nothing if x > y.
vec2 within(vec3 eye, vec3 dir) {
  vec3 over = 1.0 / (dir + vec3(equal(dir, vec3(0.0))) * 1e-9);
  vec3 a = (uLow - eye) * over;
  vec3 b = (uHigh - eye) * over;
  vec3 near = min(a, b);
  vec3 far = max(a, b);
  return vec2(max(max(near.x, near.y), max(near.z, 0.0)), min(far.x, min(far.y, far.z)));
}

vec2 pack16(float share) {
  float whole = floor(clamp(share, 0.0, 1.0) * 65535.0);
  float high = floor(whole / 256.0);
  return vec2(high, whole - high * 256.0) / 255.0;
}

float unpack16(vec2 bytes) {
  return dot(floor(bytes * 255.0 + 0.5), vec2(256.0, 1.0)) / 65535.0;
}
`;

/** Rays through the pixels of a view: a pinhole, or a camera with its lens. */
export const RAYS = /* glsl */ `
uniform vec3 uEye;
// Camera frame to world.
uniform mat3 uTurn;
// fx, fy, cx, cy of the picture as it is drawn, in its own pixels; pixel (i, j) covers i to i + 1.
uniform vec4 uPinhole;
uniform float uSkew;
// k1 k2 p1 p2, k3, whether there are any.
uniform vec4 uBend;
uniform vec2 uBend3;
// Metres a pixel covers at one metre.
uniform float uPixel;
// Where starts of rays are kept: least distance and range, metres.
uniform vec2 uRange;

vec3 ray(vec2 px) {
  float y = (px.y - uPinhole.w) / uPinhole.y;
  vec2 d = vec2((px.x - uPinhole.z - uSkew * y) / uPinhole.x, y);
  vec2 n = d;
  if (uBend3.y > 0.5) {
    for (int i = 0; i < 12; i++) {
      float r2 = dot(n, n);
      float c = 1.0 + r2 * (uBend.x + r2 * (uBend.y + r2 * uBend3.x));
      vec2 t = vec2(2.0 * uBend.z * n.x * n.y + uBend.w * (r2 + 2.0 * n.x * n.x), uBend.z * (r2 + 2.0 * n.y * n.y) + 2.0 * uBend.w * n.x * n.y);
      n = (d - t) / max(c, 0.2);
    }
  }
  return normalize(uTurn * vec3(n, 1.0));
}
`;
