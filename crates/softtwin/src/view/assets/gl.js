// WebGL2: bodies with a colour table, plates with a grid, points when no mesh is known. No library.

const BODY_VS = `#version 300 es
uniform mat4 matrix; uniform vec3 offset; uniform vec2 range; uniform float size; uniform vec4 shadow; uniform float flip;
layout(location = 0) in vec3 position; layout(location = 1) in vec3 normal; layout(location = 2) in float value;
out vec3 n; out float t; out vec3 where;
void main() {
  vec3 side = vec3(1.0, flip, 1.0);
  vec3 p = position * side + offset;
  if (shadow.w > 0.0) p = vec3(p.xz + shadow.xz * (p.y - shadow.y), 0.0).xzy + vec3(0.0, shadow.y, 0.0);
  n = normal * side; where = p; t = (value - range.x) / max(range.y - range.x, 1e-30);
  gl_Position = matrix * vec4(p, 1.0); gl_PointSize = size;
}`;

const BODY_FS = `#version 300 es
precision highp float;
uniform sampler2D table; uniform vec3 key; uniform vec3 eye; uniform float lit; uniform vec4 flat_colour;
in vec3 n; in float t; in vec3 where; out vec4 colour;
void main() {
  if (flat_colour.a > 0.0) { colour = vec4(flat_colour.rgb * flat_colour.a, flat_colour.a); return; }
  vec3 base = isnan(t) ? vec3(0.45) : texture(table, vec2((clamp(t, 0.0, 1.0) * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  float size = length(n);
  if (lit > 0.5 && size > 0.0) {
    vec3 view = normalize(eye - where);
    vec3 m = n / size; if (dot(m, view) < 0.0) m = -m;
    float light = 0.60 + 0.40 * max(dot(m, key), 0.0) + 0.10 * max(dot(m, view), 0.0);
    float gloss = 0.07 * pow(max(dot(m, normalize(key + view)), 0.0), 24.0);
    base = pow(pow(base, vec3(2.2)) * light + gloss, vec3(1.0 / 2.2));
  }
  colour = vec4(base, 1.0);
}`;

const PLATE_VS = `#version 300 es
uniform mat4 matrix; uniform vec3 low; uniform vec3 high;
layout(location = 0) in vec2 corner; out vec2 at;
void main() {
  at = mix(low.xz, high.xz, corner);
  gl_Position = matrix * vec4(at.x, high.y, at.y, 1.0);
}`;

const PLATE_FS = `#version 300 es
precision highp float;
uniform vec3 plate; uniform vec3 grid; in vec2 at; out vec4 colour;
void main() {
  vec2 cell = abs(fract(at / 10.0 - 0.5) - 0.5) * 10.0;
  vec2 width = fwidth(at);
  float line = max(1.0 - min(cell.x / width.x, 1.0), 1.0 - min(cell.y / width.y, 1.0));
  vec3 c = mix(plate, grid, line);
  colour = vec4(c * 0.86, 0.86);
}`;

const SLOW_MS = 45; // a software renderer that needs longer draws fewer pixels
const COARSEST = 0.5;
const SHADOW_SLOPE = [0.18, 0.25]; // mm to the side for each mm of height

export class Painter {
  constructor(canvas, table) {
    const software = drawsInSoftware();
    const gl = canvas.getContext("webgl2", { antialias: !software, alpha: true, premultipliedAlpha: true, stencil: true });
    if (!gl) throw new Error("this browser has no WebGL2; use a current Firefox, Chrome, Edge or Safari");
    Object.assign(this, { canvas, gl, software, sharpness: 1, buffers: new WeakMap() });
    this.body = program(gl, BODY_VS, BODY_FS);
    this.plate = program(gl, PLATE_VS, PLATE_FS);
    this.square = gl.createVertexArray();
    gl.bindVertexArray(this.square);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, table);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  begin(camera) {
    const { gl, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2) * this.sharpness;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const { right, up, toward } = camera.axes();
    const key = right.map((r, k) => -0.45 * r + 0.75 * up[k] + 0.6 * toward[k]);
    const length = Math.hypot(...key);
    this.frame = { matrix: camera.matrix(), eye: camera.eye(), key: key.map((v) => v / length) };
  }

  // Without a graphics card pixels are dear: what took too long is drawn coarser from then on.
  pace(took_ms) {
    if (this.software && took_ms > SLOW_MS) this.sharpness = Math.max(COARSEST, this.sharpness * 0.9);
  }

  // The shadow of a body on the plate, under a light from above; the stencil lets each pixel be darkened once.
  drawShadow(mesh, { offset, flip }, height) {
    if (!mesh.corners) return;
    const { gl, body } = this;
    const buffers = this.buffersOf(mesh);
    gl.useProgram(body.program);
    gl.uniformMatrix4fv(body.at.matrix, false, this.frame.matrix);
    gl.uniform3fv(body.at.offset, offset);
    gl.uniform1f(body.at.flip, flip);
    gl.uniform4f(body.at.shadow, SHADOW_SLOPE[0], height + 0.02, SHADOW_SLOPE[1], 1);
    gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0.22);
    gl.bindVertexArray(buffers.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.corners);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 0xff);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    gl.drawElements(gl.TRIANGLES, mesh.corners.length, gl.UNSIGNED_INT, 0);
    gl.depthMask(true);
    gl.disable(gl.STENCIL_TEST);
    gl.uniform4f(body.at.shadow, 0, 0, 0, 0);
  }

  // `mesh` has positions, normals, values and corners, or no corners at all (then points are drawn).
  drawBody(mesh, { offset, flip }, { range, lit, lines }) {
    const { gl, body, frame } = this;
    const buffers = this.buffersOf(mesh);
    gl.useProgram(body.program);
    gl.uniformMatrix4fv(body.at.matrix, false, frame.matrix);
    gl.uniform3fv(body.at.eye, frame.eye);
    gl.uniform3fv(body.at.key, frame.key);
    gl.uniform3fv(body.at.offset, offset);
    gl.uniform1f(body.at.flip, flip);
    gl.uniform2fv(body.at.range, range);
    gl.uniform1f(body.at.lit, lit ? 1 : 0);
    gl.uniform4f(body.at.shadow, 0, 0, 0, 0);
    gl.uniform1f(body.at.size, 2.5 * (devicePixelRatio || 1));
    gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0);
    gl.bindVertexArray(buffers.array);
    if (!mesh.corners) { gl.drawArrays(gl.POINTS, 0, mesh.values.length); return; }
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.corners);
    gl.drawElements(gl.TRIANGLES, mesh.corners.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    if (lines) {
      gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0.22);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.edges);
      gl.drawElements(gl.LINES, mesh.edges.length, gl.UNSIGNED_INT, 0);
    }
  }

  drawPlate(low, high, plate, grid) {
    const { gl } = this;
    gl.useProgram(this.plate.program);
    gl.uniformMatrix4fv(this.plate.at.matrix, false, this.frame.matrix);
    gl.uniform3fv(this.plate.at.low, low);
    gl.uniform3fv(this.plate.at.high, high);
    gl.uniform3fv(this.plate.at.plate, plate);
    gl.uniform3fv(this.plate.at.grid, grid);
    gl.bindVertexArray(this.square);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  // Sends what changed since the last frame to the card.
  buffersOf(mesh) {
    const { gl } = this;
    let buffers = this.buffers.get(mesh);
    if (!buffers) {
      buffers = { array: gl.createVertexArray(), data: [0, 1, 2].map(() => gl.createBuffer()), version: -1 };
      gl.bindVertexArray(buffers.array);
      buffers.data.forEach((buffer, k) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.enableVertexAttribArray(k);
        gl.vertexAttribPointer(k, k < 2 ? 3 : 1, gl.FLOAT, false, 0, 0);
      });
      for (const name of mesh.corners ? ["corners", "edges"] : []) {
        buffers[name] = gl.createBuffer();
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[name]);
        gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh[name], gl.STATIC_DRAW);
      }
      this.buffers.set(mesh, buffers);
    }
    if (buffers.version !== mesh.version) {
      [mesh.positions, mesh.normals, mesh.values].forEach((data, k) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffers.data[k]);
        gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      });
      buffers.version = mesh.version;
    }
    return buffers;
  }
}

function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const found = names ? /swiftshader|llvmpipe|software/i.test(gl.getParameter(names.UNMASKED_RENDERER_WEBGL)) : false;
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}

function program(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const at = {};
  for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
    const { name } = gl.getActiveUniform(program, k);
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}
