/** The shaders of the person. One way to the hull for all of them: sphere tracing on silhouette distances. */
import { MARGIN_PIXELS, NEAR_PIXELS } from "../feed/distance.ts";

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

const PRECISION = /* glsl */ `
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
`;

/** The hull as a distance, and rays to march along. */
const HULL = /* glsl */ `
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
const RAYS = /* glsl */ `
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

/** Full resolution: the hull's surface, its normal and colour, and its depth. */
export const SURFACE_FRAGMENT = /* glsl */ `${PRECISION}${HULL}${RAYS}
uniform sampler2D uStart;
uniform sampler2DArray uImage;
uniform sampler2DArray uDepth;
uniform float uDepthRange;
uniform mat4 uClip;
uniform int uMode;
uniform int uTests;
uniform vec3 uLight;
uniform vec3 uUp;
out vec4 colour;

// Outward and smooth: cameras whose cones pass within some millimetres all have a say, so that the edges
// between their cones are rounded. The distances are read on a ring, wider than the outline's steps.
vec3 normalAt(vec3 P, float reached) {
  vec3 sum = vec3(0.0);
  for (int k = 0; k < N; k++) {
    if (abs(CAM(k, 4).w - 1.0) > 0.5) continue;
    vec3 c = cone(k, P);
    float say = exp((c.x - reached) / 0.016);
    if (c.y < 0.0 || say < 0.02) continue;
    vec3 X = toCamera(k, P);
    vec2 n = X.xy / X.z;
    vec2 px = toImage(k, n);
    // Rings of about three centimetres and half of it, four pixels at least: outlines are noisy.
    vec4 m = CAM(k, 3);
    float ring = clamp(0.03 * m.x / X.z, 4.0, 20.0 * CAM(k, 6).w);
    vec2 g = vec2(0.0);
    for (int i = 0; i < 12; i++) {
      float angle = float(i) * 0.52359878;
      vec2 to = vec2(cos(angle), sin(angle)) * ((i & 1) == 0 ? ring : 0.6 * ring);
      g += to * clamp(fieldAt(k, px + to), -ring, ring);
    }
    g /= ring;
    float length_ = length(g);
    if (length_ < 0.2) continue;
    g /= length_;
    vec2 f = vec2(m.x * g.x, m.y * g.x + CAM(k, 4).x * g.y);
    vec3 world = f.x * (CAM(k, 0).xyz - n.x * CAM(k, 2).xyz) + f.y * (CAM(k, 1).xyz - n.y * CAM(k, 2).xyz);
    sum += say * normalize(world);
  }
  float length_ = length(sum);
  return length_ > 1e-4 ? sum / length_ : vec3(0.0);
}

// How much camera k sees of a point, by its depth map; slack metres behind the surface still count.
float visible(int k, vec2 n, float depth, float slack) {
  vec4 box = CAM(k, 10);
  ivec2 size = textureSize(uDepth, 0).xy;
  vec2 at = (n - box.xy) / (box.zw - box.xy) * vec2(size) - 0.5;
  ivec2 cell = ivec2(floor(at));
  vec2 share = at - vec2(cell);
  float seen = 0.0;
  for (int i = 0; i < 4; i++) {
    ivec2 corner = ivec2(i & 1, i >> 1);
    vec3 texel = texelFetch(uDepth, ivec3(clamp(cell + corner, ivec2(0), size - 1), k), 0).rgb;
    float there = texel.b > 0.5 ? unpack16(texel.rg) * uDepthRange : 1e3;
    vec2 w = mix(1.0 - share, share, vec2(corner));
    seen += w.x * w.y * (1.0 - smoothstep(0.02 + slack, 0.045 + slack, depth - there));
  }
  return seen;
}

vec3 imageAt(int k, vec2 px) {
  vec4 crop = CAM(k, 8);
  vec4 scale = CAM(k, 9);
  vec2 uv = (clamp(px, crop.xy + scale.zw, crop.zw - scale.zw) - crop.xy) * scale.xy;
  return textureLod(uImage, vec3(uv, float(k)), 0.0).rgb;
}

// The colour that the cameras agree on, and in w how much they do not.
vec4 photo(vec3 P, vec3 normal, vec3 eyeDir, float slack) {
  float base[N];
  float angle[N];
  vec2 place[N];
  float least = 10.0;
  for (int k = 0; k < N; k++) {
    base[k] = 0.0;
    if (CAM(k, 11).w < 0.5 || CAM(k, 4).w < 0.5) continue;
    vec3 X = toCamera(k, P);
    if (X.z < 0.05) continue;
    vec2 n = X.xy / X.z;
    if (dot(n, n) > CAM(k, 4).z * CAM(k, 4).z) continue;
    vec2 px = toImage(k, n);
    vec2 past = max(-px, px - CAM(k, 6).yz);
    if (max(past.x, past.y) > 0.0) continue;
#ifdef IGNORING
    // What stands before the camera there is not the person.
    if (ignoredAt(k, px) < 0.0) continue;
#endif
    vec3 toCam = normalize(CAM(k, 11).xyz - P);
    float facing = dot(normal, toCam);
    // Who looks at the back of it has no say, unless nobody looks at its front.
    if (facing < -0.6) continue;
    // Never quite nothing: a colour is better than none.
    float w = 1e-3 + smoothstep(-1.0, 3.5, -fieldAt(k, px));
    w *= 0.02 + smoothstep(0.03, 0.45, facing);
    w *= 1e-4 + (w > 1e-4 ? visible(k, n, X.z, slack) : 0.0);
    base[k] = w;
    angle[k] = acos(clamp(dot(toCam, -eyeDir), -1.0, 1.0));
    place[k] = px;
    if (w > 0.02) least = min(least, angle[k]);
  }
  if (least > 9.0) {
    for (int k = 0; k < N; k++) if (base[k] > 0.0) least = min(least, angle[k]);
  }
  vec3 sum = vec3(0.0);
  vec3 squares = vec3(0.0);
  float total = 0.0;
  for (int k = 0; k < N; k++) {
    if (base[k] <= 0.0) continue;
    float a = (angle[k] - least) / 0.22;
    float w = base[k] * exp(-min(a * a, 40.0));
    if (w < 1e-9) continue;
    vec3 c = imageAt(k, place[k]);
    sum += w * c;
    squares += w * c * c;
    total += w;
  }
  if (total <= 0.0) return vec4(0.0, 0.0, 0.0, -1.0);
  sum /= total;
  vec3 spread = max(squares / total - sum * sum, 0.0);
  return vec4(sum, spread.x + spread.y + spread.z);
}

// A lamp that stands, and a weaker one at the eye: from behind a person is no shadow.
vec3 clay(vec3 normal, vec3 dir) {
  float key = max(dot(normal, uLight), 0.0);
  float fill = 0.5 + 0.5 * dot(normal, uUp);
  float facing = max(dot(normal, -dir), 0.0);
  float rim = pow(1.0 - facing, 3.0);
  vec3 lit = vec3(0.84, 0.80, 0.75) * (0.58 * key + 0.20 * facing + 0.06) + vec3(0.13, 0.16, 0.20) * fill + vec3(0.10, 0.13, 0.17) * rim;
  return lit;
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 start = texelFetch(uStart, pixel / 4, 0);
  if (start.a < 0.5) discard;
  vec3 dir = ray(gl_FragCoord.xy);
  vec2 span = within(uEye, dir);
  float t = max(unpack16(start.xy) * uRange.y + uRange.x, span.x);
  // Forward until inside, then halving between the last point outside and the first inside: one loop, so
  // that the hull is compiled once.
  float outside = t;
  float inside = -1.0;
  float reached = 0.0;
  int halvings = 0;
  for (int i = 0; i < 100; i++) {
    float h = hull(uEye + dir * t);
    if (h <= 0.0) {
      inside = t;
      reached = h;
    } else {
      outside = t;
    }
    if (inside < 0.0) {
      t += max(h, max(0.0012, 0.5 * uPixel * t));
      if (t > span.y) break;
    } else {
      if (halvings == 4) break;
      halvings++;
      t = 0.5 * (outside + inside);
    }
  }
  if (inside < 0.0) discard;
  t = inside;
  vec3 P = uEye + dir * t;
  vec3 normal = normalAt(P, reached);
  if (dot(normal, normal) < 0.25) normal = -dir;
  vec4 best = vec4(-1.0);
  if (uMode == 0) {
    // Where cameras disagree the hull lies before the person: a few steps inwards they may agree.
    float inward = max(0.006, 1.5 * uPixel * t);
    vec3 surface = P;
    float cost = 1e3;
    for (int i = 0; i <= uTests; i++) {
      float carved = inward * float(i);
      vec3 Q = surface + dir * carved;
      if (i > 0 && hull(Q) > 0.004) break;
      vec4 tried = photo(Q, normal, dir, carved);
      if (tried.w < 0.0) break;
      bool agreed = tried.w < 0.004;
      if (agreed || tried.w + 0.0012 * float(i) < cost) {
        cost = tried.w + 0.0012 * float(i);
        best = tried;
        P = Q;
      }
      if (agreed) break;
    }
  }
  colour = vec4(best.w >= 0.0 ? best.rgb : clay(normal, dir), 1.0);
  vec4 clip = uClip * vec4(P, 1.0);
  gl_FragDepth = clamp(0.5 * clip.z / clip.w + 0.5, 0.0, 1.0);
}
`;

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
