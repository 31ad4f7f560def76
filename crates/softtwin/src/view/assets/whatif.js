// "What if": sliders drive a prediction in the viewer's own process; no sensor, no twin.

export class WhatIf {
  constructor(send, changed) {
    Object.assign(this, { send, active: false, waiting: false, again: false, model: null });
    const at = (id) => document.getElementById(id);
    this.element = { toggle: at("whatif-toggle"), box: at("sliders"), pressure: at("pressure"), gap: at("gap"), pressureOut: at("pressure-out"), gapOut: at("gap-out") };
    this.element.toggle.onclick = () => { this.set(!this.active); changed(); };
    this.element.pressure.oninput = this.element.gap.oninput = () => this.request();
  }

  // The ranges are a quarter wider than what the model was trained on: leaving it is allowed and shown.
  useModel(model) {
    this.model = model;
    this.element.toggle.disabled = !model;
    if (!model) { this.element.toggle.title = "start with --model FILE to predict here"; return; }
    const { pressure, gap } = this.element;
    [pressure.min, pressure.max] = [0, (1.25 * model.pressure_mpa[1]).toFixed(3)];
    pressure.step = 0.0005;
    pressure.value = model.pressure_mpa[1] / 2;
    gap.parentElement.hidden = !model.gap_mm;
    if (model.gap_mm) {
      [gap.min, gap.max] = [0, Math.ceil(1.25 * model.gap_mm[1])];
      gap.step = 0.25;
      gap.value = (model.gap_mm[0] + model.gap_mm[1]) / 2;
    }
  }

  set(active) {
    this.active = active && Boolean(this.model);
    this.element.toggle.setAttribute("aria-pressed", this.active);
    this.element.box.hidden = !this.active;
    if (this.active) this.request();
  }

  // One request at a time. Until its answer comes, only the newest slider position is kept.
  request() {
    const { pressure, gap, pressureOut, gapOut } = this.element;
    const [pressure_mpa, gap_mm] = [parseFloat(pressure.value), this.model.gap_mm ? parseFloat(gap.value) : null];
    pressureOut.textContent = `${pressure_mpa.toFixed(4)} MPa`;
    gapOut.textContent = gap_mm === null ? "" : `${gap_mm.toFixed(2)} mm`;
    if (this.waiting) { this.again = true; return; }
    this.waiting = true;
    this.send({ type: "predict", model: this.model.id, pressure_mpa, gap_mm });
  }

  answered() {
    this.waiting = false;
    if (this.again) { this.again = false; this.request(); }
  }

  reset() { this.waiting = this.again = false; }
}
