// A page that needs no server: the model is in the page and answers there, and a recording plays there. To the rest of the page it
// looks like `Link`: the same messages come, the same can be sent.

import { unpack } from "./link.js";

// What an exported page has in itself: colours, module, model, and a recording or null. Null in a page of `softtwin view`.
export async function embedded() {
  const element = document.getElementById("embedded");
  if (!element) return null;
  const { colours, module, model, recording } = JSON.parse(element.textContent);
  element.remove(); // some megabytes of text
  const [plain, compiled, file] = await Promise.all([decode(colours), inflate(module), inflate(model)]);
  return { colours: plain, module: await Model.of(compiled), model: file, recording };
}

const decode = async (base64) => new Uint8Array(await (await fetch(`data:application/octet-stream;base64,${base64}`)).arrayBuffer());

async function inflate(base64) {
  const packed = new Blob([await decode(base64)]).stream();
  return new Uint8Array(await new Response(packed.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
}

// The model, compiled to WebAssembly.
class Model {
  static async of(compiled) {
    const { instance } = await WebAssembly.instantiate(compiled, {});
    return Object.assign(new Model(), { calls: instance.exports });
  }

  // Calls with bytes; returns those of the answer. Throws why there is none.
  ask(call, bytes) {
    const { calls } = this;
    if (bytes) {
      const at = calls.take(bytes.length); // the memory may move when it grows
      new Uint8Array(calls.memory.buffer).set(bytes, at);
    }
    const made = calls[call]();
    const answer = new Uint8Array(calls.memory.buffer, calls.answer_at(), calls.answer_length()).slice();
    if (!made) throw new Error(new TextDecoder().decode(answer));
    return answer;
  }

  predict(inputs, t_ms) {
    return unpack(this.ask("predict", new TextEncoder().encode(JSON.stringify({ inputs, t_ms }))).buffer);
  }
}

export class Computed {
  // `isPredicting`: whether the page shows predictions rather than the recording.
  constructor(page, { onMessage, onFrame, onUp, isPredicting }) {
    Object.assign(this, { page, onMessage, onFrame, isPredicting, requested_ms: Infinity, inputs: null, at_s: 0, playing: true, shown: "", last_ms: performance.now() });
    const hello = JSON.parse(new TextDecoder().decode(page.module.ask("open", page.model)));
    this.moves = hello.models[0].moves;
    setTimeout(() => { // when the page is put together
      onUp();
      onMessage({ ...hello, pictures: 0, places: {}, plates: {}, blocks: [] });
      onFrame(...unpack(page.module.ask("mesh").buffer));
      if (page.recording) onMessage({ type: "recording", names: [page.recording.name], ...page.recording });
      onMessage({ type: "ready" });
      this.tick();
    });
  }

  send({ type, inputs, at_s, playing }) {
    const end_s = this.page.recording?.duration_s ?? 0;
    if (type === "predict") { this.inputs = inputs; if (!this.moves) this.predict(); }
    if (type === "seek") this.at_s = Math.min(Math.max(at_s, 0), end_s);
    if (type === "play") Object.assign(this, { playing, at_s: playing && this.at_s >= end_s ? 0 : this.at_s });
  }

  ready() {} // a frame is made when it is wanted, so none waits

  // A model with a past moves while the sliders stand still; a recording plays.
  tick() {
    const now_ms = performance.now();
    if (this.isPredicting()) {
      if (this.moves && this.inputs) this.predict(now_ms);
    } else if (this.page.recording) this.play((now_ms - this.last_ms) / 1000);
    this.last_ms = now_ms;
    requestAnimationFrame(() => this.tick());
  }

  predict(t_ms) {
    try { this.onFrame(...this.page.module.predict(this.inputs, t_ms)); } catch (error) { this.onMessage({ type: "refused", text: error.message }); }
  }

  play(passed_s) {
    const { duration_s, tracks } = this.page.recording;
    if (this.playing) this.at_s = Math.min(this.at_s + passed_s, duration_s);
    this.playing &&= this.at_s < duration_s;
    const shown = `${this.at_s} ${this.playing}`;
    if (shown === this.shown) return;
    this.shown = shown;
    for (const track of tracks) this.show(track);
  }

  // The newest state of a track at this time; the first one before it.
  show({ actuator, t_s, inputs, measured_force_n, latency_ms }) {
    let k = t_s.findIndex((t) => t > this.at_s);
    k = Math.max(0, (k < 0 ? t_s.length : k) - 1);
    const values = Object.fromEntries(Object.entries(inputs).map(([key, column]) => [key, column[k]]).filter(([, value]) => Number.isFinite(value)));
    const recorded = { actuator, t_s: this.at_s, playing: this.playing, predicted: false, measured_force_n: measured_force_n[k], latency_ms: latency_ms[k] };
    try {
      const [header, buffer, start] = this.page.module.predict(values);
      this.onFrame({ ...header, ...recorded }, buffer, start);
    } catch { /* the recorded state has no answer: the shape stays */ }
  }
}
