// "What if": one slider for each input of the model drives a prediction in the viewer's own process; no sensor, no twin.

const STEPS = 400;
const WIDER = 0.25; // beyond the trained range, as a fraction of it: leaving it is allowed and shown

export class WhatIf {
  constructor(send, changed) {
    Object.assign(this, { send, active: false, waiting: false, again: false, model: null, sliders: [] });
    const at = (id) => document.getElementById(id);
    this.element = { toggle: at("whatif-toggle"), box: at("sliders"), text: at("whatif-text") };
    this.element.toggle.onclick = () => { this.set(!this.active); changed(); };
  }

  useModel(model) {
    this.model = model;
    if (!model) return;
    this.sliders = model.inputs.filter(({ range: [low, high] }) => high > low).map(slider);
    this.sliders.forEach(({ input }) => { input.oninput = () => this.request(); });
    this.element.box.replaceChildren(...this.sliders.map(({ label }) => label));
  }

  // Without a model the panel opens all the same and says what to do.
  set(active) {
    const { toggle, box, text } = this.element;
    this.active = active && Boolean(this.model);
    toggle.setAttribute("aria-pressed", active && this.model !== null);
    toggle.setAttribute("aria-expanded", active);
    box.hidden = !this.active;
    if (this.model) text.textContent = this.active ? `Predicted by ${this.model.name}, no sensor.` : "Predict any state without a sensor.";
    else text.replaceChildren("This needs a model. End the viewer and start it with one: ", command("softtwin view FILE.twin"));
    if (this.active) this.request();
  }

  // One request at a time. Until its answer comes, only the newest slider position is kept.
  request() {
    const inputs = {};
    for (const { card, input, output, note } of this.sliders) {
      const value = parseFloat(input.value);
      inputs[card.key] = value;
      output.textContent = `${value.toFixed(digitsOf(card))} ${card.unit}`;
      note.textContent = value < card.range[0] || value > card.range[1] ? "outside the trained range" : `trained ${card.range.map((v) => v.toFixed(Math.max(0, digitsOf(card) - 1))).join(" to ")}`;
    }
    for (const { key, range: [low, high] } of this.model.inputs) if (low === high) inputs[key] = low;
    if (this.waiting) { this.again = true; return; }
    this.waiting = true;
    this.send({ type: "predict", model: this.model.id, inputs });
  }

  answered() {
    this.waiting = false;
    if (this.again) { this.again = false; this.request(); }
  }

  reset() { this.waiting = this.again = false; }
}

function slider(card) {
  const [low, high] = card.range;
  const margin = WIDER * (high - low);
  const step = 10 ** Math.floor(Math.log10((high - low) / STEPS));
  const make = (tag, className) => Object.assign(document.createElement(tag), { className });
  const [label, output, note, input] = [make("label", "slider"), make("output", ""), make("small", ""), make("input", "")];
  const whole = (value) => Math.round(value / step) * step;
  Object.assign(input, { type: "range", id: `input-${card.name}`, min: whole(Math.max(card.limits[0], low - margin)), max: whole(high + margin), step });
  input.value = card.nominal ?? whole((low + high) / 2);
  input.setAttribute("aria-label", `${card.name} in ${card.unit}`);
  label.append(card.name, output, input, note);
  return { card, label, input, output, note };
}

function digitsOf({ range: [low, high] }) {
  return Math.max(0, -Math.floor(Math.log10((high - low) / STEPS)));
}

function command(text) {
  return Object.assign(document.createElement("code"), { textContent: text });
}
