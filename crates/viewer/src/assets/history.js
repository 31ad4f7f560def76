// What has happened: every reading for the charts, and shapes of the last minute at 10 Hz to look back at, coordinates to
// 0.005 mm.

export const SPAN_MS = 60000;
const FINE_MS = 50;
const MOST_BINS = 2400;
const SHAPE_EVERY_MS = 100;
const STEP_MM = 0.01;

// Readings in bins of equal time; of each bin and quantity the smallest, the largest and the newest value, so that nothing
// that stands out is lost. `span_ms`: what is older goes. Without it nothing goes: bins become twice as wide instead.
export class Series {
  constructor(span_ms) {
    Object.assign(this, { span_ms, bin_ms: FINE_MS, bins: [] });
  }

  add(t_ms, values) {
    const start = Math.floor(t_ms / this.bin_ms) * this.bin_ms;
    let at = this.bins.length; // estimates come a little after the states of the same time
    while (at > 0 && this.bins[at - 1].t_ms > start) at -= 1;
    let bin = this.bins[at - 1];
    if (bin?.t_ms !== start) {
      bin = { t_ms: start };
      this.bins.splice(at, 0, bin);
      this.trim();
    }
    for (const [key, value] of Object.entries(values)) if (Number.isFinite(value)) join(bin, key, [value, value, value]);
  }

  trim() {
    const { bins, span_ms } = this;
    if (span_ms) {
      while (bins[bins.length - 1].t_ms - bins[0].t_ms > span_ms) bins.shift();
    } else if (bins.length > MOST_BINS) {
      this.bin_ms *= 2;
      this.bins = bins.filter((bin, k) => {
        if (k === 0 || Math.floor(bin.t_ms / this.bin_ms) !== Math.floor(bins[k - 1].t_ms / this.bin_ms)) return true;
        for (const [key, range] of Object.entries(bin)) if (key !== "t_ms") join(bins[k - 1], key, range);
        return false;
      });
    }
  }
}

// How the browser's clock differs from that of the readings, the same for all actuators: by the shortest way a reading took.
const sender = { shift_ms: Infinity };

function join(bin, key, [low, high, newest]) {
  const range = bin[key];
  if (!range) { bin[key] = [low, high, newest]; return; }
  if (low < range[0]) range[0] = low;
  if (high > range[1]) range[1] = high;
  range[2] = newest;
}

export class History {
  constructor() {
    Object.assign(this, { minute: new Series(SPAN_MS), all: new Series(null), shapes: [], isSent: false });
  }

  add(t_ms, values) {
    this.minute.add(t_ms, values);
    this.all.add(t_ms, values);
  }

  // What to add to the bins' times to have those of the browser.
  get shift_ms() { return this.isSent ? sender.shift_ms : 0; }

  // Readings with the sender's clock, `columns` by name.
  read(t_s, columns, now_ms) {
    this.isSent = true;
    const behind_ms = now_ms - 1000 * t_s[t_s.length - 1];
    if (behind_ms < sender.shift_ms || behind_ms > sender.shift_ms + SPAN_MS) sender.shift_ms = behind_ms;
    t_s.forEach((t, k) => this.add(1000 * t, Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, values[k]]))));
  }

  // Keeps the frame's shape to look back at.
  keep(frame) {
    const { shapes } = this;
    if (!frame.fields || (shapes.length && frame.received_ms - shapes[shapes.length - 1].received_ms < SHAPE_EVERY_MS)) return;
    shapes.push(pack(frame));
    while (frame.received_ms - shapes[0].received_ms > SPAN_MS) shapes.shift();
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
