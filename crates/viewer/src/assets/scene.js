// Content of the 3-D view: actuators, blocks, plates with shadow and contact patch, force arrows with their labels.

import { HEAD, SHAFT, block } from "./solid.js";

const HERE = { offset: [0, 0, 0], scale: [1, 1, 1] };
const UNIT = block([0, 0, 0], [1, 1, 1]);
const PLATE_MM = 2; // thickness
const ARROW_MM = 26; // of the largest force so far, beside the plate
const ARROW_IN_BLOCK_MM = 13;
const HEAD_MM = 6;
const HEAD_RADIUS_MM = 2.4;
const SHAFT_RADIUS_MM = 0.8;
const GROWN_MM = 1;
const [LABEL_WIDTH, LABEL_HEIGHT] = [76, 24]; // pixels, of a force with its rim
const BESIDE = 10; // pixels from an arrow's point to its force; on its left where the right has no room
const SEEN_NODES = 200; // of a shape, to fit the view to

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);

export class Scene {
  // `shown()`: { actuators, blocks, models } that are visible now.
  constructor(painter, camera, marks, shown) {
    Object.assign(this, { painter, camera, marks, shown, box: null, seen: [], touched: 0, largest_n: 0, labels: [] });
    new ResizeObserver(() => { if (!camera.moved) this.fit(); camera.changed(); }).observe(camera.canvas);
  }

  // A plate below each actuator, unless blocks are what can be touched.
  plates() {
    const { actuators, blocks, models } = this.shown();
    if (blocks.length) return [];
    return actuators.flatMap((actuator) => {
      const model = models.get(actuator.shown?.model);
      const gap = actuator.shown?.gap_mm;
      const plate = actuator.plate ?? model?.obstacle;
      if (!plate || !Number.isFinite(gap)) return [];
      const { x_mm, z_mm } = plate;
      const { offset, flip } = actuator.place;
      const y = -gap * flip + offset[1];
      return [{ actuator, low: [x_mm[0] + offset[0], y, z_mm[0] + offset[2]], high: [x_mm[1] + offset[0], y, z_mm[1] + offset[2]] }];
    });
  }

  // Other things are shown: forget where the former ones were.
  forget() {
    Object.assign(this, { box: null, seen: [], touched: 0, largest_n: 0 });
    this.camera.moved = false;
  }

  // Called with each new shape: until the camera is moved, everything shown so far stays in view.
  follow() {
    const { actuators, blocks } = this.shown();
    const still = [...blocks, ...this.plates().map(({ low, high }) => ({ low: [low[0], low[1] - PLATE_MM, low[2]], high }))];
    const boxes = [...actuators.map((actuator) => actuator.box()).filter(Boolean), ...still];
    for (const actuator of actuators) this.largest_n = Math.max(this.largest_n, actuator.contact()?.force_n ?? 0);
    if (!boxes.length) return;
    const all = this.box ? [...boxes, this.box] : boxes;
    const corner = (name, pick) => [0, 1, 2].map((k) => pick(...all.map((box) => box[name][k])));
    const box = { low: corner("low", Math.min), high: corner("high", Math.max) };
    const grown = !this.box || box.low.some((v, k) => this.box.low[k] - v > GROWN_MM) || box.high.some((v, k) => v - this.box.high[k] > GROWN_MM);
    const tips = this.arrows(this.largest_n).map(({ tip }) => tip);
    const nodes = actuators.flatMap((actuator) => actuator.some(SEEN_NODES)); // they may reach corners of the box that were empty before
    if (!grown && tips.length <= this.touched && (this.camera.moved || this.camera.shows(nodes))) return;
    Object.assign(this, { box, touched: Math.max(tips.length, this.touched) });
    this.seen.push(...tips, ...nodes);
    for (const { low, high } of still) this.seen.push(...cornersOf(low, high));
    if (!this.camera.moved) this.fit();
  }

  fit() {
    if (!this.box) return;
    this.fitted = this.size();
    this.camera.fit(this.seen);
  }

  size() {
    const { clientWidth, clientHeight } = this.camera.canvas;
    return `${clientWidth} x ${clientHeight}`;
  }

  // Force arrows: where they begin, how long they are and where their points are. `all_n`: as if all had this force.
  arrows(all_n) {
    const { actuators, blocks } = this.shown();
    const longest = blocks.length ? ARROW_IN_BLOCK_MM : ARROW_MM;
    return actuators.flatMap((actuator) => {
      const contact = actuator.contact();
      if (!contact) return [];
      const length = (longest * (all_n ?? contact.force_n)) / Math.max(this.largest_n, contact.force_n);
      return [{ ...contact, length, tip: [contact.at[0], contact.at[1] - contact.flip * length, contact.at[2]] }];
    });
  }

  draw({ range, lit, lines }) {
    const { painter, camera } = this;
    const { actuators, blocks } = this.shown();
    const [plate, grid, mark] = ["--plate", "--grid", "--force"].map((name) => rgb(css(name)));
    if (!camera.moved && this.fitted !== this.size()) this.fit(); // a size that came and went between two frames
    painter.begin(camera);
    for (const { body, place } of actuators) if (body) painter.drawBody(body, place, { range, lit, lines });
    for (const { cavities = [], place } of actuators) {
      for (const { walls, colour } of cavities) painter.drawBody(walls, place, { range, lit, lines: false, plain: rgb(colour), through: true });
    }
    for (const { mesh } of blocks) painter.drawBody(mesh, HERE, { range, lit: true, lines: false, plain: plate });
    for (const { actuator, low, high } of this.plates()) {
      const place = { offset: [low[0], low[1] - PLATE_MM, low[2]], scale: [high[0] - low[0], PLATE_MM - 0.1, high[2] - low[2]] };
      if (painter.frame.eye[1] > low[1]) painter.drawBody(UNIT, place, { range, lit: true, lines: false, plain: plate.map((v) => 0.86 * v) });
      painter.drawPlate({ low, high }, { mesh: actuator.body, ...actuator.place }, { plate, grid, mark, touching: actuator.contact() !== null });
    }
    const arrows = this.arrows();
    for (const { at, length, flip } of arrows) {
      const head = Math.min(HEAD_MM, 0.6 * length);
      const paint = { range, lit: true, lines: false, plain: mark, through: true };
      painter.drawBody(SHAFT, { offset: at, scale: [SHAFT_RADIUS_MM, flip * (length - head), SHAFT_RADIUS_MM] }, paint);
      const wide = HEAD_RADIUS_MM * (head / HEAD_MM);
      painter.drawBody(HEAD, { offset: [at[0], at[1] - flip * (length - head), at[2]], scale: [wide, flip * head, wide] }, paint);
    }
    this.label(arrows);
  }

  // The force beside each arrow's point, as a part of the browser; pictures draw `labels` themselves.
  label(arrows) {
    this.labels = arrows.map(({ tip, force_n }) => ({ at: this.camera.project(tip), text: `${force_n.toFixed(3)} N` })).filter(({ at }) => at);
    separate(this.labels);
    while (this.marks.children.length > this.labels.length) this.marks.lastChild.remove();
    this.labels.forEach((label, k) => {
      const { at, text } = label;
      const mark = this.marks.children[k] ?? this.marks.appendChild(Object.assign(document.createElement("div"), { className: "mark" }));
      if (mark.textContent !== text) mark.textContent = text;
      const isInside = at[0] + BESIDE + mark.offsetWidth + 6 <= this.camera.canvas.clientWidth;
      label.left = isInside ? at[0] + BESIDE : Math.max(6, at[0] - BESIDE - mark.offsetWidth);
      mark.style.transform = `translate(${label.left}px, ${at[1] - 11}px)`;
    });
  }
}

// Moves labels down that would cover one above them.
function separate(labels) {
  const sorted = [...labels].sort((a, b) => a.at[1] - b.at[1]);
  sorted.forEach(({ at }, k) => {
    for (const { at: above } of sorted.slice(0, k)) {
      if (Math.abs(at[0] - above[0]) < LABEL_WIDTH && at[1] - above[1] < LABEL_HEIGHT) at[1] = above[1] + LABEL_HEIGHT;
    }
  });
}

function cornersOf(...ends) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [ends[k & 1][0], ends[(k >> 1) & 1][1], ends[k >> 2][2]]);
}
