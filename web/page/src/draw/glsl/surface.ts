/** The surface at full resolution: normals, and the colours of the cameras that see it. */
import { HULL, PRECISION, RAYS } from "./common.ts";

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
    // A camera behind the surface does not count, unless none is in front of it.
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
