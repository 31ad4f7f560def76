// WebGL2: bodies with a colour table, plates with grid, shadow and contact patch, points when no mesh is known. No library.

import { BLUR_FS, BODY_FS, BODY_VS, CAST_FS, CAST_VS, PLATE_FS, PLATE_VS, SQUARE_VS } from "./shaders.js";

const SLOW_MS = 45; // a software renderer that needs longer draws fewer pixels
const COARSEST = 0.5;
const CAST_SIZE = [256, 128];
const BLURRED_SIZE = [128, 64]; // enough for what is blurred, and a quarter of the work
const BLUR_MM = 0.8; // distance of the blur's samples: three of them are its standard deviation
const HIDDEN_ALPHA = 0.5; // of what shows through other things

export class Painter {
  constructor(canvas, table) {
    const software = drawsInSoftware();
    const gl = canvas.getContext("webgl2", { antialias: !software, alpha: true, premultipliedAlpha: true });
    if (!gl) throw new Error("this browser has no WebGL2; use a current Firefox, Chrome, Edge or Safari");
    Object.assign(this, { canvas, gl, software, sharpness: 1, buffers: new WeakMap() });
    this.body = program(gl, BODY_VS, BODY_FS);
    this.cast = program(gl, CAST_VS, CAST_FS);
    this.blur = program(gl, SQUARE_VS, BLUR_FS);
    this.plate = program(gl, PLATE_VS, PLATE_FS);
    this.square = gl.createVertexArray();
    gl.bindVertexArray(this.square);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.casts = [CAST_SIZE, BLURRED_SIZE, BLURRED_SIZE].map((size) => target(gl, size));
    this.table = texture(gl, [256, 1], gl.RGB8, gl.RGB, table);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  begin(camera) {
    const { gl, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2) * this.sharpness;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    this.toScreen();
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { right, up, toward } = camera.axes();
    const from = (r, u, t) => {
      const sum = right.map((v, k) => r * v + u * up[k] + t * toward[k]);
      return sum.map((v) => v / Math.hypot(...sum));
    };
    this.frame = { matrix: camera.matrix(), eye: camera.eye(), key: from(-0.45, 0.75, 0.6), fill: from(0.8, 0.1, 0.6) };
  }

  toScreen() {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
  }

  // Without a graphics card pixels are dear: what took too long is drawn coarser from then on.
  pace(took_ms) {
    if (this.software && took_ms > SLOW_MS) this.sharpness = Math.max(COARSEST, this.sharpness * 0.9);
  }

  // `mesh` has positions, normals, values and corners, or no corners at all (then points are drawn). `plain`: the colour
  // where there is no value; `through`: shows faintly through what hides it.
  drawBody(mesh, { offset, scale }, { range, lit, lines, plain = [0.45, 0.45, 0.45], through = false }) {
    const { gl, body, frame } = this;
    const buffers = this.buffersOf(mesh);
    gl.useProgram(body.program);
    gl.uniformMatrix4fv(body.at.matrix, false, frame.matrix);
    for (const name of ["eye", "key", "fill"]) gl.uniform3fv(body.at[name], frame[name]);
    gl.uniform3fv(body.at.offset, offset);
    gl.uniform3fv(body.at.scale, scale);
    gl.uniform3fv(body.at.plain, plain);
    gl.uniform2fv(body.at.range, range);
    gl.uniform1f(body.at.lit, lit ? 1 : 0);
    gl.uniform1f(body.at.size, 2.5 * (devicePixelRatio || 1));
    gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.bindVertexArray(buffers.array);
    if (!mesh.corners) { gl.drawArrays(gl.POINTS, 0, mesh.values.length); return; }
    const draw = (kind, name) => {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[name]);
      gl.drawElements(kind, mesh[name].length, gl.UNSIGNED_INT, 0);
    };
    if (through) {
      gl.uniform4f(body.at.flat_colour, ...plain, HIDDEN_ALPHA);
      gl.depthFunc(gl.GREATER);
      gl.depthMask(false);
      draw(gl.TRIANGLES, "corners");
      gl.depthMask(true);
      gl.depthFunc(gl.LEQUAL); // a material lies in the skin
      gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0);
    }
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    this.withoutBacks(mesh, scale, () => draw(gl.TRIANGLES, "corners"));
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.depthFunc(gl.LESS);
    if (lines) {
      gl.uniform4f(body.at.flat_colour, 0, 0, 0, 0.22);
      draw(gl.LINES, "edges");
    }
  }

  // Leaves out the half of a closed surface that looks away: it is behind the other half.
  withoutBacks(mesh, scale, draw) {
    const { gl } = this;
    if (!mesh.outward) { draw(); return; }
    gl.frontFace(mesh.outward * scale[0] * scale[1] * scale[2] > 0 ? gl.CCW : gl.CW);
    gl.enable(gl.CULL_FACE);
    draw();
    gl.disable(gl.CULL_FACE);
  }

  // The plate's top with the soft shadow of a body on it and, when they touch, the patch where.
  drawPlate({ low, high }, body, { plate, grid, mark, touching }) {
    const { gl } = this;
    this.castOn({ low, high }, body, touching);
    gl.useProgram(this.plate.program);
    gl.uniformMatrix4fv(this.plate.at.matrix, false, this.frame.matrix);
    for (const [name, value] of Object.entries({ low, high, plate, grid, mark })) gl.uniform3fv(this.plate.at[name], value);
    gl.uniform1f(this.plate.at.alpha, this.frame.eye[1] > high[1] ? 1 : 0.3); // from below it must not hide the body
    gl.bindTexture(gl.TEXTURE_2D, this.casts[2].texture);
    gl.bindVertexArray(this.square);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  // Draws shadow and contact of a body, as seen from above the plate, into the first of three pictures, and blurs them into the last.
  castOn({ low, high }, { mesh, offset, scale }, touching) {
    const { gl, casts, cast, blur } = this;
    gl.disable(gl.DEPTH_TEST);
    gl.viewport(0, 0, ...CAST_SIZE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, casts[0].frame);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (mesh?.corners) {
      const buffers = this.buffersOf(mesh);
      gl.useProgram(cast.program);
      for (const [name, value] of Object.entries({ offset, scale, low, high })) gl.uniform3fv(cast.at[name], value);
      gl.uniform1f(cast.at.touching, touching ? 1 : 0);
      gl.bindVertexArray(buffers.array);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.corners);
      gl.blendEquation(gl.MAX);
      // Both are decided by the lowest point, which is on a face that looks at the plate, also at a mirrored one.
      this.withoutBacks(mesh, [1, 1, 1], () => gl.drawElements(gl.TRIANGLES, mesh.corners.length, gl.UNSIGNED_INT, 0));
      gl.blendEquation(gl.FUNC_ADD);
    }
    gl.useProgram(blur.program);
    gl.bindVertexArray(this.square);
    gl.viewport(0, 0, ...BLURRED_SIZE);
    [[BLUR_MM / (high[0] - low[0]), 0], [0, BLUR_MM / (high[2] - low[2])]].forEach((along, k) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, casts[k + 1].frame);
      gl.bindTexture(gl.TEXTURE_2D, casts[k].texture);
      gl.uniform2fv(blur.at.along, along);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    });
    gl.enable(gl.DEPTH_TEST);
    this.toScreen();
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

function texture(gl, [width, height], inside, format, data) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, gl.UNSIGNED_BYTE, data);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return made;
}

// A picture that can be drawn into.
function target(gl, size) {
  const made = { texture: texture(gl, size, gl.RGBA8, gl.RGBA, null), frame: gl.createFramebuffer() };
  gl.bindFramebuffer(gl.FRAMEBUFFER, made.frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.texture, 0);
  return made;
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
