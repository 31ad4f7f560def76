// The programs of the graphics card.

export const BODY_VS = `#version 300 es
uniform mat4 matrix; uniform vec3 offset; uniform vec3 scale; uniform vec2 range; uniform float size;
layout(location = 0) in vec3 position; layout(location = 1) in vec3 normal; layout(location = 2) in float value;
out vec3 n; out float t; out vec3 where;
void main() {
  where = position * scale + offset; n = normal / scale; t = (value - range.x) / max(range.y - range.x, 1e-30);
  gl_Position = matrix * vec4(where, 1.0); gl_PointSize = size;
}`;

// The light of the pictures that `softtwin draw` draws: a lamp over the left shoulder, a weaker one from the right.
export const BODY_FS = `#version 300 es
precision highp float;
uniform sampler2D table; uniform vec3 key; uniform vec3 fill; uniform vec3 eye; uniform float lit; uniform vec4 flat_colour; uniform vec3 plain;
in vec3 n; in float t; in vec3 where; out vec4 colour;
void main() {
  if (flat_colour.a > 0.0) { colour = vec4(flat_colour.rgb * flat_colour.a, flat_colour.a); return; }
  vec3 base = isnan(t) ? plain : texture(table, vec2((clamp(t, 0.0, 1.0) * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  float size = length(n);
  if (lit > 0.5 && size > 0.0) {
    vec3 view = normalize(eye - where);
    vec3 m = n / size; if (dot(m, view) < 0.0) m = -m;
    float light = 0.56 + 0.42 * max(dot(m, key), 0.0) + 0.14 * max(dot(m, fill), 0.0);
    float gloss = 0.06 * pow(max(dot(m, normalize(key + view)), 0.0), 24.0);
    base = pow(pow(base, vec3(2.2)) * light + gloss, vec3(1.0 / 2.2));
  }
  colour = vec4(base, 1.0);
}`;

// A body seen from straight above the plate: how dark its shadow is there, and where it touches.
export const CAST_VS = `#version 300 es
uniform vec3 offset; uniform vec3 scale; uniform vec3 low; uniform vec3 high;
layout(location = 0) in vec3 position; out float height;
void main() {
  vec3 p = position * scale + offset;
  height = (p.y - low.y) * scale.y;
  gl_Position = vec4((p.xz - low.xz) / (high.xz - low.xz) * 2.0 - 1.0, 0.0, 1.0);
}`;

export const CAST_FS = `#version 300 es
precision highp float;
uniform float touching; in float height; out vec4 colour;
void main() { colour = vec4(exp(-max(height, 0.0) / 18.0), height < 0.6 ? touching : 0.0, 0.0, 1.0); }`;

export const SQUARE_VS = `#version 300 es
layout(location = 0) in vec2 corner; out vec2 at;
void main() { at = corner; gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0); }`;

// One direction of a Gaussian blur.
export const BLUR_FS = `#version 300 es
precision highp float;
uniform sampler2D image; uniform vec2 along; in vec2 at; out vec4 colour;
void main() {
  const float weights[8] = float[](0.13460, 0.12732, 0.10778, 0.08164, 0.05534, 0.03356, 0.01822, 0.00885);
  vec3 sum = weights[0] * texture(image, at).rgb;
  for (int k = 1; k <= 7; k++) sum += weights[k] * (texture(image, at + along * float(k)).rgb + texture(image, at - along * float(k)).rgb);
  colour = vec4(sum, 1.0);
}`;

export const PLATE_VS = `#version 300 es
uniform mat4 matrix; uniform vec3 low; uniform vec3 high;
layout(location = 0) in vec2 corner; out vec2 at; out vec2 where;
void main() { at = corner; where = mix(low.xz, high.xz, corner); gl_Position = matrix * vec4(where.x, high.y, where.y, 1.0); }`;

export const PLATE_FS = `#version 300 es
precision highp float;
uniform sampler2D image; uniform vec3 plate; uniform vec3 grid; uniform vec3 mark; uniform float alpha;
in vec2 at; in vec2 where; out vec4 colour;
void main() {
  vec2 cell = abs(fract(where / 10.0 - 0.5) - 0.5) * 10.0;
  vec2 width = fwidth(where);
  float line = max(1.0 - min(cell.x / width.x, 1.0), 1.0 - min(cell.y / width.y, 1.0));
  vec4 fallen = texture(image, at);
  vec3 c = mix(plate, grid, 0.75 * line) * (1.0 - 0.5 * fallen.r);
  c = mix(c, mark, 0.9 * smoothstep(0.02, 0.14, fallen.g));
  colour = vec4(c * alpha, alpha);
}`;
