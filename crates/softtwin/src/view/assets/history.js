// The last minute: every state for the charts, and shapes at 10 Hz to scrub through, coordinates to 0.005 mm.

export const SPAN_MS = 60000;
const SHAPE_EVERY_MS = 100;
const STEP_MM = 0.01;

export class History {
  constructor() {
    this.states = [];
    this.shapes = [];
  }

  add(frame) {
    const now = frame.received_ms;
    const { fields, ...state } = frame;
    this.states.push(state);
    if (fields && (this.shapes.length === 0 || now - this.shapes[this.shapes.length - 1].received_ms >= SHAPE_EVERY_MS))
      this.shapes.push(pack(frame));
    trim(this.states, now);
    trim(this.shapes, now);
  }

  // The shape nearest to `age_ms` before `now`, as a frame; undefined when there is none.
  shape(now, age_ms) {
    const wanted = now - age_ms;
    let best;
    for (const shape of this.shapes)
      if (!best || Math.abs(shape.received_ms - wanted) < Math.abs(best.received_ms - wanted)) best = shape;
    return best && unpack(best);
  }
}

function trim(list, now) {
  let old = 0;
  while (old < list.length && now - list[old].received_ms > SPAN_MS) old++;
  if (old) list.splice(0, old);
}

// 16 bits a value: coordinates in hundredths of a millimetre, the rest in 1/65535 of its largest value.
function pack(frame) {
  const packed = {};
  for (const [name, values] of Object.entries(frame.fields)) {
    if ("xyz".includes(name)) { packed[name] = { step: STEP_MM, data: Int16Array.from(values, (v) => Math.round(v / STEP_MM)) }; continue; }
    const step = values.reduce((a, b) => Math.max(a, b), 0) / 65535 || 1;
    packed[name] = { step, data: Uint16Array.from(values, (v) => Math.round(v / step)) };
  }
  return { ...frame, fields: undefined, packed };
}

function unpack(shape) {
  const fields = {};
  for (const [name, { step, data }] of Object.entries(shape.packed)) fields[name] = Float32Array.from(data, (v) => v * step);
  return { ...shape, packed: undefined, fields };
}
