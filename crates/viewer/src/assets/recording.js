// A recording instead of live data: the time bar spans all of it, and all pages show the same time.

export class Recording {
  constructor(send) {
    Object.assign(this, { send, opened: null, at_s: 0, playing: false, dragging: false });
    const at = (id) => document.getElementById(id);
    this.element = { scrub: at("scrub"), pause: at("pause"), when: at("when"), list: at("recordings") };
    this.element.list.onchange = () => send({ type: "open", name: this.element.list.value });
    this.element.scrub.addEventListener("pointerdown", () => { this.dragging = true; });
    addEventListener("pointerup", () => { this.dragging = false; });
  }

  get on() { return this.opened !== null; }
  get span_ms() { return Math.max(1, 1000 * this.opened.duration_s); }
  get at_ms() { return 1000 * this.at_s; }

  // A recording was opened.
  open(opened) {
    this.opened = opened;
    const { scrub, list } = this.element;
    Object.assign(scrub, { min: 0, max: opened.duration_s, step: 0.01, value: 0 });
    scrub.setAttribute("aria-label", "Seconds of the recording");
    list.hidden = opened.names.length < 2;
    list.replaceChildren(...opened.names.map((name) => new Option(name, name, false, name === opened.name)));
  }

  // All readings of one actuator, each in a separate bin; stress has separate times.
  fill(history, { actuator, t_s, stress_t_s, max_von_mises_mpa, ...columns }) {
    const bins = (times, named) => times.map((t, k) => Object.fromEntries([["t_ms", 1000 * t],
      ...Object.entries(named).filter(([, values]) => Number.isFinite(values[k])).map(([name, values]) => [name, [values[k], values[k], values[k]]])]));
    history.all.bins = [...bins(t_s, columns), ...bins(stress_t_s, { max_von_mises_mpa })].sort((a, b) => a.t_ms - b.t_ms);
  }

  // A frame has the time of the recording.
  follow({ t_s, playing }) {
    Object.assign(this, { at_s: t_s, playing });
    const { scrub, pause, when } = this.element;
    if (!this.dragging) scrub.value = t_s;
    pause.textContent = playing ? "Pause" : "Play";
    pause.setAttribute("aria-pressed", !playing);
    when.textContent = `${t_s.toFixed(1)} / ${this.opened.duration_s.toFixed(1)} s`;
  }

  toggle() { this.send({ type: "play", playing: !this.playing }); }
  seek() { this.send({ type: "seek", at_s: parseFloat(this.element.scrub.value) }); }
}
