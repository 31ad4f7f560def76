// Strip charts of the last minute: one quantity each, one line an actuator.

import { ticks } from "./scale.js";

export const COLOURS = ["#2f81f7", "#e8742c", "#2da44e", "#a475f9", "#d4a72c", "#e85aad"];

const STRIPS = [
  { key: "pressure_mpa", name: "pressure", unit: "MPa" },
  { key: "contact_force_n", name: "contact force", unit: "N" },
  { key: "gap_mm", name: "gap", unit: "mm" },
  { key: "max_von_mises_mpa", name: "largest von Mises stress", unit: "MPa" },
  { key: "latency_ms", name: "latency, sensor to published", unit: "ms" },
];

export class Charts {
  constructor(parent) {
    this.strips = STRIPS.map((strip) => {
      const box = document.createElement("div");
      box.className = "chart";
      const name = document.createElement("div");
      name.className = "name";
      const [label, span] = [document.createElement("span"), document.createElement("span")];
      label.textContent = `${strip.name} (${strip.unit})`;
      name.append(label, span);
      const canvas = document.createElement("canvas");
      box.append(name, canvas);
      parent.append(box);
      return { ...strip, canvas, span };
    });
  }

  // `series`: [{ states, colour }]; of the window `now` is the right end, `age_ms` where the cursor stands before it.
  draw(series, window, style) {
    for (const strip of this.strips) this.drawStrip(strip, series, window, style);
  }

  drawStrip({ canvas, span, key }, series, { now, age_ms, span_ms }, { ink, line, faint }) {
    span.textContent = `${(span_ms / 1000).toFixed(span_ms < 10000 ? 1 : 0)} s`;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const [left, bottom] = [38, height - 4];
    const [low, high] = rangeOf(series, key);
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - 6);
    const x = (time) => left + (1 - (now - time) / span_ms) * (width - left - 2);
    context.font = "10px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    const { at, digits } = ticks(low, high, 3);
    for (const value of at) {
      context.fillStyle = faint;
      context.fillText(value.toFixed(digits), left - 5, y(value));
      context.fillStyle = line;
      context.fillRect(left, Math.round(y(value)), width - left, 1);
    }
    context.lineWidth = 1.6;
    for (const { states, colour } of series) this.drawLine(context, states, key, colour, x, y);
    if (age_ms > 0) {
      context.fillStyle = ink;
      context.fillRect(x(now - age_ms), 2, 1, bottom - 2);
    }
  }

  // A gap in time or a value that is not a number interrupts the line.
  drawLine(context, states, key, colour, x, y) {
    context.strokeStyle = colour;
    context.beginPath();
    let last = -Infinity;
    for (const state of states) {
      const value = state[key];
      if (!Number.isFinite(value)) { last = -Infinity; continue; }
      if (state.received_ms - last > 1000) context.moveTo(x(state.received_ms), y(value));
      else context.lineTo(x(state.received_ms), y(value));
      last = state.received_ms;
    }
    context.stroke();
  }
}

function rangeOf(series, key) {
  let [low, high] = [Infinity, -Infinity];
  for (const { states } of series) {
    for (const state of states) {
      const value = state[key];
      if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
    }
  }
  if (!(high >= low)) return [0, 1];
  if (low > 0 && low < 0.6 * high) low = 0;
  const margin = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1;
  return [low === 0 ? 0 : low - margin, high + margin];
}
