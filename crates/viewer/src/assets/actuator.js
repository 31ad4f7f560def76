// One actuator on the browser: its mesh, its history, the frame that is shown.

import { History } from "./history.js";
import { Points } from "./mesh.js";
import { QUANTITIES } from "./scale.js";

const STALE_MS = 1500;
const TOUCH_MM = 0.35; // nodes this near to the plate touch it
const SPACING_MM = 70; // where the scene does not say where it stands: one behind the other

export class Actuator {
  constructor(name, index, colour, place, plate) {
    const where = place ? { offset: place.offset_mm, flip: place.mirrored ? -1 : 1 } : { offset: [0, 0, index * SPACING_MM], flip: 1 };
    where.scale = [1, where.flip, 1];
    Object.assign(this, { name, colour, place: where, plate, history: new History(), latest: null, shown: null, shape: null, body: null, largest: NaN });
  }

  // Takes a frame that has just come in.
  receive(frame) {
    this.latest = frame;
    if (frame.t_s === null) this.history.keep(frame); // a recording is asked for its shapes
    if (frame.predicted) this.history.add(frame.received_ms, frame);
  }

  // Makes a frame the shown one; `mesh` is the model's, if known.
  show(frame, mesh, quantity) {
    this.shown = frame;
    const fields = frame.fields ?? {};
    const nodes = (fields.x ?? fields.y ?? fields.z)?.length;
    if (!nodes) return; // a state came without its field: the shape stays
    for (const axis of ["x", "y", "z"]) fields[axis] ??= new Float32Array(nodes); // markers of one camera lie in a plane
    const { x, y, z } = fields;
    this.shape = frame;
    if (!this.body || this.model !== frame.model || this.body.nodes !== x.length) {
      this.model = frame.model;
      this.body = mesh && mesh.nodes === x.length ? mesh.copy() : new Points(x.length);
    }
    const values = QUANTITIES[quantity].values(frame) ?? new Float32Array(x.length).fill(NaN);
    this.body.deform(x, y, z, values);
    this.cavities = quantity === "cavities" ? this.body.cavities ?? [] : [];
    const none = new Float32Array(x.length).fill(NaN);
    for (const { walls } of this.cavities) walls.deform(x, y, z, none);
    this.values = this.body.values; // without those of cavities
    this.largest = largest(this.values);
  }

  // Old data: nothing has come for a while, or its flags say so.
  isStale(now, requested_ms) {
    return Boolean(this.latest) && !this.latest.predicted && this.latest.t_s === null &&
      (now - Math.max(this.latest.received_ms, requested_ms) > STALE_MS || this.latest.flags.includes("stale") || this.latest.flags.includes("no-data"));
  }

  // Box around the shown shape.
  box() {
    const { x, y, z } = this.shape?.fields ?? {};
    if (!x) return null;
    const bounds = [x, y, z].map((values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]));
    const { offset, flip } = this.place;
    if (flip < 0) bounds[1] = [-bounds[1][1], -bounds[1][0]];
    return { low: bounds.map(([low], k) => low + offset[k]), high: bounds.map(([, high], k) => high + offset[k]) };
  }

  // About `count` nodes of the shown shape, at their positions in the scene.
  some(count) {
    const { x, y, z } = this.shape?.fields ?? {};
    const { offset, flip } = this.place;
    const every = Math.max(1, Math.floor((x?.length ?? 0) / count));
    return Array.from({ length: x ? Math.ceil(x.length / every) : 0 }, (_, k) => [x[k * every] + offset[0], y[k * every] * flip + offset[1], z[k * every] + offset[2]]);
  }

  // Where it presses on the plate: the middle of the nodes that touch, in the scene, and the force; null when it does not.
  contact() {
    const { contact_force_n: force_n, gap_mm } = this.shown ?? {};
    const { x, y, z } = this.shape?.fields ?? {};
    if (!x || !(force_n > 0) || !Number.isFinite(gap_mm)) return null;
    let [sx, sz, count] = [0, 0, 0];
    for (let k = 0; k < x.length; k++) if (y[k] + gap_mm < TOUCH_MM) { sx += x[k]; sz += z[k]; count++; }
    if (!count) return null;
    const { offset, flip } = this.place;
    return { at: [sx / count + offset[0], -gap_mm * flip + offset[1], sz / count + offset[2]], flip, force_n };
  }

  // Label of a node at the pointer.
  describe(node) {
    const { fields, displacement_halfwidth_mm: bar_mm, von_mises_halfwidth_mpa: bar_mpa } = this.shape;
    const half = (bar, digits) => (Number.isFinite(bar) ? ` ± ${bar.toFixed(digits)}` : "");
    const lines = [`${this.name} · node ${this.body.ids[node]}`, `x ${fields.x[node].toFixed(2)}  y ${fields.y[node].toFixed(2)}  z ${fields.z[node].toFixed(2)} mm`];
    if (fields.displacement) lines.push(`displacement ${fields.displacement[node].toFixed(2)}${half(bar_mm, 2)} mm`);
    if (fields.von_mises) lines.push(`von Mises ${fields.von_mises[node].toFixed(4)}${half(bar_mpa, 4)} MPa`);
    return lines.join("\n");
  }
}

function largest(values) {
  let best = -Infinity;
  for (const value of values) if (value > best) best = value;
  return best;
}
