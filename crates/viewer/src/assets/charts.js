// Strip charts: one quantity each, one line an actuator, a dashed one for what a load cell measures.

import { ticks } from "./scale.js";

export const COLOURS = ["#2f81f7", "#e8742c", "#2da44e", "#a475f9", "#d4a72c", "#e85aad"];
const BREAK_MS = 300; // a longer silence interrupts a line, unless readings come slower than that
const BREAK_TIMES = 6; // their usual distance
const LEFT = 44;
const LOW = 44; // pixels; a lower chart has room for two numbers at its side
const NEWEST = 40; // bins that are searched for quantities

const STRIPS = [
  { key: "pressure_mpa", name: "pressure", unit: "MPa", digits: 4, why: () => "no reading yet" },
  { key: "contact_force_n", beside: "measured_force_n", name: "contact force", unit: "N", digits: 3, why: () => "no state is published, only fields" },
  { key: "gap_mm", name: "gap", unit: "mm", digits: 2, why: () => "no plate: no gap is given or measured" },
  { key: "max_von_mises_mpa", name: "largest von Mises stress", unit: "MPa", digits: 3,
    why: (mode) => (mode === "recording" ? "not recorded; softtwin view FILE.twin computes it" : "no field with von_mises is published") },
  { key: "latency_ms", name: "latency, sensor to published", unit: "ms", digits: 3, log: true,
    why: (mode) => (mode === "whatif" ? "a prediction here has no sensor" : "readings carry no time stamp") },
];

const ESTIMATE = "estimate ";
const BAND = 1.645; // half of a 90 % band in standard deviations
const UNITS = { mm: ["mm", 2], mpa: ["MPa", 4], n: ["N", 3] };

// The strip of an estimated quantity, by the name of its column.
function estimateStrip(key) {
  const quantity = key.slice(ESTIMATE.length);
  const [, name, unit] = quantity.match(/^(.*)_(mm|mpa|n)$/) ?? [null, quantity, null];
  const [shown, digits] = UNITS[unit] ?? ["-", 4];
  return { key, band: `sigma ${quantity}`, name: `estimated ${name.replaceAll("_", " ")}, 90 % band`, unit: shown, digits, why: () => "no estimate in this time" };
}

export class Charts {
  constructor(parent) {
    this.parent = parent;
    this.strips = [];
    this.add(STRIPS);
  }

  add(strips) {
    this.strips.push(...strips.map((strip) => {
      const make = (tag, className) => Object.assign(document.createElement(tag), { className });
      const [box, name, canvas, why] = [make("div", "chart"), make("div", "name"), make("canvas", ""), make("div", "why")];
      const [label, values] = [make("span", ""), make("span", "")];
      label.textContent = `${strip.name} (${strip.unit})`;
      canvas.setAttribute("aria-label", `${strip.name} over time`);
      name.append(label, values);
      box.append(name, canvas, why);
      this.parent.append(box);
      return { ...strip, canvas, values, whyBox: why };
    }));
  }

  // Strips for quantities that are estimated, as soon as there are any.
  addEstimated(series) {
    const keys = new Set(series.flatMap(({ bins }) => bins.slice(-NEWEST).flatMap((bin) => Object.keys(bin))));
    const known = new Set(this.strips.map(({ key }) => key));
    this.add([...keys].filter((key) => key.startsWith(ESTIMATE) && !known.has(key)).map(estimateStrip));
  }

  // `series`: [{ bins, shift_ms, isSteady, colour }] (steady: a value holds until the next one); of the window `now` is the right end, `age_ms` where the cursor stands before it.
  // `mode`: what is shown, for the word on an empty chart: "live", "waiting", "recording" or "whatif".
  draw(series, window, style, mode) {
    this.addEstimated(series);
    for (const strip of this.strips) this.drawStrip(strip, series, window, style, mode);
  }

  drawStrip(strip, series, { now, age_ms, span_ms }, { ink, line, faint }, mode) {
    const { canvas, key, beside, band, digits, values, whyBox, why } = strip;
    const lines = series.flatMap(({ bins, shift_ms, isSteady, colour }, k) => [{ bins, shift_ms, isSteady, colour, key, dash: k ? [7, 5] : [], wide: k ? 1.7 : series.length > 1 ? 3.2 : 1.9 },
      ...(beside ? [{ bins, shift_ms, colour: ink, key: beside, dash: [2, 3], wide: 1.5 }] : [])]);
    const shown = lines.map((entry) => ({ ...entry, bins: within(entry, now, span_ms) })).filter(({ bins }) => bins.length);
    whyBox.textContent = shown.length ? "" : mode === "waiting" ? "waiting for readings" : why(mode);
    values.replaceChildren(...shown.map(({ bins, shift_ms, colour, key: shownKey }) => number(valueAt(bins, shownKey, now - age_ms - shift_ms), digits, colour, shownKey !== key)));
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    Object.assign(canvas, { width: width * ratio, height: height * ratio });
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const place = strip.log ? Math.log10 : (value) => value;
    const [low, high] = rangeOf(shown, place, strip.log, band);
    const [top, bottom] = [7, height - 7];
    const y = (value) => bottom - ((place(value) - low) / (high - low)) * (bottom - top);
    const x = (time) => LEFT + (1 - Math.max(0, now - time) / span_ms) * (width - LEFT - 3);
    this.drawGrid(context, strip, { low, high, y, width, height, empty: !shown.length }, { line, faint });
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT, height);
    context.clip();
    for (const entry of band ? shown : []) drawBand(context, entry, band, x, y);
    for (const entry of shown) drawLine(context, entry, x, y);
    context.restore();
    if (age_ms > 0) {
      context.fillStyle = ink;
      context.fillRect(x(now - age_ms), 2, 1, bottom - 2);
    }
  }

  drawGrid(context, { log }, { low, high, y, width, height, empty }, { line, faint }) {
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    const { at, digits } = log ? decades(low, high, height < LOW ? 1 : 3) : ticks(low, high, height > 110 ? 4 : 2);
    for (const value of empty ? [] : at) {
      context.fillStyle = faint;
      context.fillText(log ? String(value) : value.toFixed(digits), LEFT - 6, y(value));
      context.fillStyle = line;
      context.fillRect(LEFT, Math.round(y(value)), width - LEFT, 1);
    }
    if (empty) { context.fillStyle = line; context.fillRect(LEFT, Math.round(height / 2) + 12, width - LEFT, 1); }
  }
}

function within({ bins, shift_ms, key }, now, span_ms) {
  const end = now - shift_ms;
  return bins.filter((bin) => bin[key] && bin.t_ms <= end && bin.t_ms >= end - span_ms - BREAK_TIMES * BREAK_MS);
}

function valueAt(bins, key, t_ms) {
  let best = bins[0];
  for (const bin of bins) if (bin.t_ms <= t_ms) best = bin;
  return best[key][2];
}

function number(value, digits, colour, measured) {
  const text = document.createElement("i");
  text.textContent = `${measured ? "measured " : ""}${value.toFixed(digits).replace("-", "−")}`;
  text.style.color = colour;
  return text;
}

// One stroke a bin from its smallest to its largest value; a silence interrupts the line.
function drawLine(context, { bins, shift_ms, isSteady, key, colour, dash, wide }, x, y) {
  Object.assign(context, { strokeStyle: colour, lineWidth: wide, lineJoin: "round" });
  context.globalAlpha = wide > 3 ? 0.55 : 1; // the lower of two lines shows beside the upper one
  context.setLineDash(dash);
  context.beginPath();
  const usual_ms = (bins[bins.length - 1].t_ms - bins[0].t_ms) / Math.max(1, bins.length - 1);
  const break_ms = isSteady ? Infinity : Math.max(BREAK_MS, BREAK_TIMES * usual_ms);
  let last = -Infinity;
  for (const bin of bins) {
    const [low, high, newest] = bin[key];
    const at = x(bin.t_ms + shift_ms);
    if (bin.t_ms - last > break_ms) context.moveTo(at, y(low)); else context.lineTo(at, y(low));
    if (high > low) { context.lineTo(at, y(high)); context.lineTo(at, y(newest)); }
    last = bin.t_ms;
  }
  if (isSteady) context.lineTo(x(Infinity), y(bins[bins.length - 1][key][2]));
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

// The band of a quantity around its newest values.
function drawBand(context, { bins, shift_ms, key, colour }, band, x, y) {
  const known = bins.filter((bin) => bin[band]);
  const edge = (bin, sign) => [x(bin.t_ms + shift_ms), y(bin[key][2] + sign * BAND * bin[band][2])];
  context.beginPath();
  for (const bin of known) context.lineTo(...edge(bin, 1));
  for (const bin of known.toReversed()) context.lineTo(...edge(bin, -1));
  Object.assign(context, { fillStyle: colour, globalAlpha: 0.2 });
  context.fill();
  context.globalAlpha = 1;
}

function rangeOf(lines, place, log, band) {
  let [low, high] = [Infinity, -Infinity];
  for (const { bins, key } of lines) for (const bin of bins) {
    const half = band && bin[band] ? BAND * bin[band][2] : 0;
    low = Math.min(low, bin[key][0] - half);
    high = Math.max(high, bin[key][1] + half);
  }
  if (!(high >= low)) return [0, 1];
  if (log) return [Math.floor(place(Math.max(low, 1e-4))), Math.max(Math.ceil(place(Math.max(high, 1e-4))), Math.floor(place(Math.max(low, 1e-4))) + 1)];
  if (low > 0 && low < 0.6 * high) low = 0;
  const margin = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1;
  return [low === 0 ? 0 : low - margin, high + margin];
}

// Powers of ten, not more than `steps` steps apart.
function decades(low, high, steps) {
  const every = Math.ceil((high - low) / steps);
  return { at: Array.from({ length: Math.floor((high - low) / every) + 1 }, (_, k) => Number((10 ** (low + every * k)).toPrecision(1))), digits: 0 };
}
