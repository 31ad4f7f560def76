// Orbit camera: a target, two angles and a distance; perspective with a narrow angle, as technical drawings like it.

const VIEW_ANGLE = 0.45; // rad, full height
const FILLED = 0.9; // of the free part
const ROOM = 6; // pixels around what is shown
const VIEWS = { iso: [0.45, 0.30], side: [0, 0.02], top: [0, 1.5], end: [1.45, 0.12] };

export class Camera {
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, moved: false, azimuth: 0.45, elevation: 0.3, distance: 420, target: [55, -30, 16] });
    let drag = null;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      drag = { x: event.clientX, y: event.clientY, pan: event.button !== 0 || event.shiftKey };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!drag) return;
      const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
      [drag.x, drag.y] = [event.clientX, event.clientY];
      this.moved = true;
      if (drag.pan) this.pan(dx, dy); else this.turn(dx, dy);
    });
    const release = () => { drag = null; };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.moved = true;
      this.zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0015));
    }, { passive: false });
  }

  turn(dx, dy) {
    this.azimuth -= dx * 0.008;
    this.elevation = Math.max(-1.55, Math.min(1.55, this.elevation + dy * 0.008));
    this.changed();
  }

  pan(dx, dy) {
    const { right, up } = this.axes();
    const mm = (2 * Math.tan(VIEW_ANGLE / 2) * this.distance) / this.canvas.clientHeight;
    this.target = this.target.map((v, k) => v - right[k] * dx * mm + up[k] * dy * mm);
    this.changed();
  }

  zoom(factor) {
    this.distance = Math.max(5, Math.min(20000, this.distance * factor));
    this.changed();
  }

  view(name) {
    [this.azimuth, this.elevation] = VIEWS[name];
    this.changed();
  }

  // Steps back until all points are inside the free part of the canvas, and centres them there. Exact: each point says how
  // far away the eye must be for it, on each of four sides.
  fit(points) {
    const { right, up, toward } = this.axes();
    const along = (axis, p) => axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
    const seen = points.map((p) => [along(right, p), along(up, p), along(toward, p)]);
    if (!seen.length) return;
    const high = Math.tan(VIEW_ANGLE / 2) * FILLED;
    const slopes = [(high * this.canvas.clientWidth) / Math.max(1, this.canvas.clientHeight), high];
    // The eye at (c, d): |s_k - c| <= slope (d - s_2) for each point, so both ends give a bound on c for a given d.
    const ends = slopes.map((slope, k) => [Math.max(...seen.map((s) => s[k] + slope * s[2])), Math.min(...seen.map((s) => s[k] - slope * s[2]))]);
    const eye = Math.max(...ends.map(([top, bottom], k) => (top - bottom) / (2 * slopes[k])));
    const middle = ends.map(([top, bottom]) => (top + bottom) / 2);
    const depth = (Math.max(...seen.map((s) => s[2])) + Math.min(...seen.map((s) => s[2]))) / 2;
    this.distance = Math.max(5, eye - depth);
    this.target = right.map((_, k) => right[k] * middle[0] + up[k] * middle[1] + toward[k] * depth);
    this.changed();
  }

  axes() {
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    return { right: [ca, 0, -sa], up: [-sa * se, ce, -ca * se], toward: [sa * ce, se, ca * ce] };
  }

  eye() {
    const { toward } = this.axes();
    return this.target.map((v, k) => v + toward[k] * this.distance);
  }

  // Column-major world-to-clip matrix.
  matrix() {
    const { right, up, toward } = this.axes();
    const eye = this.eye();
    const f = 1 / Math.tan(VIEW_ANGLE / 2);
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    const [near, far] = [this.distance * 0.05, this.distance * 20];
    const rows = [right.map((v) => (v * f) / aspect), up.map((v) => v * f)];
    const depth = toward.map((v) => (v * (far + near)) / (near - far));
    const dot = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
    const [a, b] = rows;
    return new Float32Array([
      a[0], b[0], depth[0], -toward[0],
      a[1], b[1], depth[1], -toward[1],
      a[2], b[2], depth[2], -toward[2],
      -dot(a), -dot(b), -dot(depth) + (2 * far * near) / (near - far), dot(toward),
    ]);
  }

  // Pixel of a point, for labels; null behind the eye.
  project(point) {
    const m = this.matrix();
    const clip = [0, 1, 2, 3].map((r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r]);
    if (clip[3] <= 0) return null;
    return [((clip[0] / clip[3] + 1) / 2) * this.canvas.clientWidth, ((1 - clip[1] / clip[3]) / 2) * this.canvas.clientHeight];
  }

  // Whether all points are on the canvas; nothing else can be said of one without a size.
  shows(points) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const isOutside = ([x, y]) => x < ROOM || y < ROOM || x > width - ROOM || y > height - ROOM;
    return !width || !height || !points.some((point) => isOutside(this.project(point) ?? [-1, -1]));
  }

  // Ray through a pixel: origin and direction.
  ray(x, y) {
    const { right, up, toward } = this.axes();
    const t = Math.tan(VIEW_ANGLE / 2);
    const u = ((2 * x) / this.canvas.clientWidth - 1) * t * (this.canvas.clientWidth / this.canvas.clientHeight);
    const v = (1 - (2 * y) / this.canvas.clientHeight) * t;
    return [this.eye(), right.map((r, k) => r * u + up[k] * v - toward[k])];
  }
}
