// The colour scale: which quantity, which range (fixed or following), the bar and its ticks.

export const QUANTITIES = {
  von_mises: { unit: "MPa", values: (frame) => frame.fields.von_mises },
  displacement: { unit: "mm", values: (frame) => frame.fields.displacement },
  stress_halfwidth: { unit: "%", values: (frame) => share(frame.von_mises_halfwidth_mpa, frame.fields.von_mises) },
  cavities: { unit: "", values: () => undefined },
  displacement_halfwidth: { unit: "%", values: (frame) => share(frame.displacement_halfwidth_mm, frame.fields.displacement) },
};

// The half-width of the confidence interval in percent of each node's value; not a number where either is unknown.
function share(halfwidth, values) {
  return values && Number.isFinite(halfwidth) ? values.map((v) => (100 * halfwidth) / v) : undefined;
}

// About `count` round numbers within a range, with the digits that tell them apart.
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return { at: [low], digits: 3 };
  const power = 10 ** Math.floor(Math.log10(span / count));
  const factor = [1, 2, 2.5, 5, 10].find((f) => f * power >= (span / count) * (1 - 1e-9));
  const step = factor * power;
  const digits = Math.max(0, (factor === 2.5 ? 1 : 0) - Math.floor(Math.log10(step) + 1e-9));
  const at = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * span; k++) at.push(k * step);
  return { at, digits };
}

export class Scale {
  constructor(table, changed) {
    Object.assign(this, { table, range: [0, 1], mode: "most", quantity: "von_mises", largest: NaN });
    const names = ["field", "follow", "bar", "ticks", "range", "low", "high", "largest"];
    this.element = Object.fromEntries(names.map((id) => [id, document.getElementById(id)]));
    const { field, follow, low, high, bar } = this.element;
    bar.width = 256;
    const image = new ImageData(256, 1);
    for (let k = 0; k < 256; k++) image.data.set([table[3 * k], table[3 * k + 1], table[3 * k + 2], 255], 4 * k);
    const context = bar.getContext("2d");
    for (let y = 0; y < bar.height; y++) context.putImageData(image, 0, y);
    field.onchange = () => { this.quantity = field.value; if (this.mode === "fixed") this.mode = "most"; this.range = [0, 0]; this.show(); changed(); };
    follow.onchange = () => { this.choose(follow.value); changed(); };
    const typed = () => {
      const range = [parseFloat(low.value), parseFloat(high.value)];
      if (range[1] > range[0]) { this.range = range; this.show(); changed(); }
    };
    low.onchange = high.onchange = typed;
    this.show();
  }

  get title() { return this.element.field.selectedOptions[0].textContent; }

  // "most": the range ends where 99 % of the nodes lie, so that single corners do not take all colours; "peak": at the
  // largest value; "fixed": it stays.
  choose(mode) {
    this.mode = mode;
    this.show();
  }

  // Follows the values of the bodies shown: up at once, down slowly, in round steps, so that colours do not flicker.
  follow(bodies) {
    this.largest = Math.max(...bodies.map((body) => body.largest).filter(Number.isFinite));
    const { unit } = QUANTITIES[this.quantity];
    for (const name of ["bar", "ticks", "follow"]) this.element[name].hidden = this.quantity === "cavities";
    if (this.quantity === "cavities") { this.showCavities(bodies); return; }
    const unbounded = bodies.some((body) => body.largest === Infinity) ? "no limit where the value itself is 0" : "no value to colour by";
    this.element.largest.textContent = Number.isFinite(this.largest) ? `largest of the outer skin ${this.largest.toPrecision(3)} ${unit}` : unbounded;
    if (this.mode === "fixed") return;
    const tops = bodies.map(({ values, largest }) => (this.mode === "peak" || !values ? largest : quantile(values, 0.99)));
    const largest = Math.max(...tops.filter(Number.isFinite));
    if (!Number.isFinite(largest) || largest <= 0) return;
    const limited = this.quantity.endsWith("_halfwidth") ? Math.min(largest, 100) : largest;
    const target = roundUp(limited);
    if (target > this.range[1] || target < 0.6 * this.range[1]) {
      this.range = [0, target];
      this.show();
    }
  }

  // Models with several cavities or materials can be coloured by them.
  offerCavities(has) {
    if (has) this.element.field.querySelector("[value=cavities]").hidden = false;
  }

  // The legend: name, colour and pressure of each cavity, name and colour of each material.
  showCavities(bodies) {
    this.element.largest.replaceChildren(...bodies.flatMap(({ name, shown, cavities }) => cavities.map((cavity) => {
      const entry = Object.assign(document.createElement("span"), { className: "cavity" });
      const dot = Object.assign(document.createElement("span"), { className: "dot" });
      dot.style.background = cavity.colour;
      const at = shown?.input_names?.indexOf(cavity.input) ?? -1;
      const mpa = at < 0 ? null : shown.inputs[at];
      entry.append(dot, `${bodies.length > 1 ? `${name} ` : ""}${cavity.name}${Number.isFinite(mpa) ? ` ${(1000 * mpa).toFixed(1)} kPa` : ""} `);
      return entry;
    })));
  }

  show() {
    const { follow, range, low, high, ticks: list } = this.element;
    follow.value = this.mode;
    range.hidden = this.mode !== "fixed";
    [low.value, high.value] = this.range;
    const { at, digits } = ticks(...this.range, 5);
    list.replaceChildren(...at.map((value) => {
      const span = document.createElement("span");
      const share = (value - this.range[0]) / (this.range[1] - this.range[0] || 1);
      span.textContent = value.toFixed(digits);
      span.className = share > 0.97 ? "end" : "";
      span.style.left = `${100 * share}%`;
      return span;
    }));
  }
}

function quantile(values, share) {
  const sorted = Float32Array.from(values).sort();
  return sorted[Math.floor(share * (sorted.length - 1))];
}

function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find((f) => f * power >= value * (1 - 1e-6));
}
