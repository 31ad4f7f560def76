// Puts the browser together: link -> actuators -> scene, numbers, charts.

import { Actuator } from "./actuator.js";
import { Camera } from "./camera.js";
import { COLOURS, Charts } from "./charts.js";
import { Computed, embedded } from "./computed.js";
import { Painter } from "./gl.js";
import { SPAN_MS } from "./history.js";
import { Link } from "./link.js";
import { Mesh, pick } from "./mesh.js";
import { showNumbers } from "./numbers.js";
import { Recorder } from "./picture.js";
import { Recording } from "./recording.js";
import { Scale } from "./scale.js";
import { Scene, css } from "./scene.js";
import { block } from "./solid.js";
import { WhatIf } from "./whatif.js";

const at = (id) => document.getElementById(id);
const PREDICTION = "what if";
const SHORTEST_MS = 2000; // that the charts show
const READINGS_EVERY_MS = 100;
const PANELS_EVERY_MS = 250; // without a graphics card, where charts and numbers cost as much as two pictures of the scene
const RESTORED_MS = 10000; // that a browser has to restore a graphics context

const page = await embedded();
const table = page ? page.colours : new Uint8Array(await (await fetch(`colours${location.search}`)).arrayBuffer());
const state = { models: new Map(), meshes: new Map(), actuators: new Map(), chosen: null, places: {}, plates: {}, blocks: [], up: false, everUp: false, noContext: false, paused: false,
  age_ms: 0, frozen_ms: 0, dirty: true, lit: true, lines: false, drawn: [], frames: 0, reason: "" };

const touch = () => { state.dirty = true; };
const camera = new Camera(at("scene"), touch);
const scale = new Scale(table, () => { reshow(); touch(); });
const charts = new Charts(at("charts"));
let painter;
try { painter = new Painter(at("scene"), table); } catch (error) { alarm(error.message); throw error; }
const scene = new Scene(painter, camera, at("marks"), () => ({ actuators: visible(), blocks: whatIf.active ? [] : state.blocks, models: state.models }));
const recorder = new Recorder(at("scene"), describe, notice);
at("scene").addEventListener("webglcontextlost", (event) => {
  event.preventDefault(); // or the browser never restores it
  state.noContext = true;
  setTimeout(() => location.reload(), RESTORED_MS); // some browsers restore nothing: a new page gets a new context or says why not
});
at("scene").addEventListener("webglcontextrestored", () => location.reload());

const callbacks = {
  isPredicting: () => whatIf.active,
  onUp: () => { Object.assign(state, { up: true, everUp: true, reason: "" }); whatIf.reset(); if (whatIf.active) whatIf.request(); touch(); },
  onDown: (reason) => { Object.assign(state, { up: false, reason }); whatIf.reset(); touch(); },
  onMessage: (message) => {
    if (message.type === "hello") hello(message);
    if (message.type === "ready" && !recording.on) Object.assign(at("whatif-toggle"), { hidden: true }).click(); // a page without server and recording has only this
    if (message.type === "notice") notice(message.text);
    if (message.type === "recording") openRecording(message);
    if (message.type === "grasp") showGrasp(message);
    if (message.type === "refused") { notice(message.text); whatIf.answered(); }
  },
  onFrame: (header, buffer, start) => ({ mesh: addMesh, frame: addFrame, readings: addReadings })[header.kind](header, buffer, start),
};
const link = page ? new Computed(page, callbacks) : new Link(callbacks);
const recording = new Recording((message) => link.send(message));
const whatIf = new WhatIf((message) => link.send(message), () => { scene.forget(); choose(null); reshow(); touch(); });

function hello({ models, pictures, places, plates, blocks }) {
  document.getElementById("pictures").hidden = pictures === 0;
  state.models = new Map(models.map((model) => [model.id, model]));
  Object.assign(state, { places, plates });
  state.blocks = blocks.map(({ min_mm, max_mm }) => ({ low: min_mm, high: max_mm, mesh: block(min_mm, max_mm) }));
  whatIf.useModel(models[0] ?? null);
}

function addMesh({ model, nodes, facets, cavities }, buffer, start) {
  const undeformed = new Float32Array(buffer, start, 3 * nodes);
  const corners = new Uint32Array(buffer, start + 12 * nodes, 3 * facets);
  const ids = new Uint32Array(buffer, start + 12 * (nodes + facets), nodes);
  const mesh = new Mesh(undeformed, corners, ids);
  let at = start + 16 * nodes + 12 * facets;
  mesh.cavities = cavities.map(({ name, input, facets }, k) => {
    const walls = new Mesh(undeformed, new Uint32Array(buffer, at, 3 * facets), ids);
    at += 12 * facets;
    return { name, input, colour: COLOURS[k % COLOURS.length], walls };
  });
  state.meshes.set(model, mesh);
  scale.offerCavities(cavities.length > 0);
}

// Another recording: its actuators, and all their states for the charts.
function openRecording(message) {
  recording.open(message);
  state.actuators.clear();
  scene.forget();
  for (const track of message.tracks) recording.fill(actuatorOf(track.actuator).history, track);
}

function addReadings({ actuator, columns, count, origin_s }, buffer, start) {
  const column = (k) => new Float32Array(buffer, start + 4 * k * count, count);
  const t_s = Array.from(column(0), (t) => origin_s + t);
  actuatorOf(actuator).history.read(t_s, Object.fromEntries(columns.map((name, k) => [name, column(k + 1)])), performance.now());
}

function addFrame(header, buffer, start) {
  const frame = { ...header, received_ms: performance.now() };
  for (const name of ["fields", "coefficients", "group_sizes"]) delete frame[name]; // `fields` are the names until here
  if (header.count) {
    frame.fields = {};
    header.fields.forEach((name, k) => { frame.fields[name] = new Float32Array(buffer, start + 4 * k * header.count, header.count); });
    frame.max_displacement_mm = frame.fields.displacement?.reduce((a, b) => Math.max(a, b), 0) ?? null;
  }
  const actuator = actuatorOf(frame.actuator);
  frame.max_displacement_mm ??= actuator.latest?.max_displacement_mm; // without a field: that of the shape, which stays
  actuator.receive(frame);
  state.frames++;
  if (frame.predicted) whatIf.answered();
  if (frame.t_s !== null) recording.follow(frame);
  if (!showsPast()) show(actuator, frame);
  touch();
}

// The actuator of this name; a new one the first time.
function actuatorOf(name) {
  if (!state.actuators.has(name)) {
    const index = name === PREDICTION ? 0 : [...state.actuators.keys()].filter((key) => key !== PREDICTION).length;
    state.actuators.set(name, new Actuator(name, index, COLOURS[index % COLOURS.length], state.places[name], state.plates[name]));
    choose(state.chosen);
  }
  return state.actuators.get(name);
}

function show(actuator, frame) {
  actuator.show(frame, state.meshes.get(frame.model), scale.quantity);
  if (!visible().includes(actuator)) return;
  scale.follow(visible());
  scene.follow();
}

const showsPast = () => !recording.on && !whatIf.active && (state.paused || state.age_ms > 0);
// By name: frames come in any order.
const visible = () => [...state.actuators.values()].filter((a) => (a.name === PREDICTION) === whatIf.active).sort((a, b) => (a.name < b.name ? -1 : 1));
const chosen = () => visible().find((a) => a.name === state.chosen) ?? visible()[0];
const clock = () => (state.paused ? state.frozen_ms : performance.now());

// Shows all actuators at the chosen moment again (after scrubbing, pausing, or another quantity).
function reshow() {
  for (const actuator of state.actuators.values()) {
    const frame = showsPast() ? actuator.history.shape(clock(), state.age_ms) : actuator.latest;
    if (frame) show(actuator, frame);
  }
}

function choose(name) {
  state.chosen = name ?? chosen()?.name ?? null;
  at("actuators").hidden = whatIf.active; // there is one prediction
  at("actuators").replaceChildren(...visible().map((actuator) => {
    const button = document.createElement("button");
    const dot = Object.assign(document.createElement("span"), { className: "dot" });
    dot.style.background = actuator.colour;
    button.append(dot, actuator.name);
    button.setAttribute("aria-pressed", actuator === chosen());
    button.onclick = () => { choose(actuator.name); touch(); };
    return button;
  }));
}

function alarm(text, mood = "bad") {
  Object.assign(at("alarm"), { hidden: !text, textContent: text, className: mood });
}

// What stands between backticks is a command.
function notice(text) {
  const parts = text.split("`").map((part, k) => (k % 2 ? Object.assign(document.createElement("code"), { textContent: part }) : part));
  at("notice").replaceChildren(...parts);
  at("notice").hidden = !text;
}

// Whether the gripper holds its object, and where to stop inflating.
function showGrasp({ scene: name, status, text }) {
  const word = Object.assign(document.createElement("b"), { textContent: status.replaceAll("-", " ") });
  at("grasp").replaceChildren(word, `${name}: ${text.replaceAll("+-", "±")}`);
  Object.assign(at("grasp"), { hidden: false, className: status === "held" ? "held" : "open" });
}

// What a picture says beside the scene.
function describe() {
  const { shown, name } = chosen() ?? {};
  const of = (label, value, digits, unit) => (Number.isFinite(value) ? [`${label} ${value.toFixed(digits)} ${unit}`] : []);
  const numbers = shown ? [...of("pressure", shown.pressure_mpa, 4, "MPa"), ...of("gap", shown.gap_mm, 2, "mm"), ...of("contact force", shown.contact_force_n, 3, "N"), ...of("measured", shown.measured_force_n, 3, "N")] : [];
  return { title: name ?? "softtwin", numbers, labels: scene.labels, scale };
}

// The states that the user must notice: no connection, nothing published, old data.
function status() {
  const now = performance.now();
  const stale = visible().filter((actuator) => actuator.isStale(now, link.requested_ms));
  const oldest = Math.max(0, ...stale.map((actuator) => now - actuator.latest.received_ms));
  let [badge, mood, text] = ["live", "live", ""];
  if (state.noContext) [badge, mood, text] = ["no picture", "bad", "The browser has withdrawn the graphics context; the viewer loads itself again when it is back"];
  else if (!state.up) [badge, mood, text] = ["disconnected", "bad", state.reason || (state.everUp ? "Connection to softtwin view lost; trying again" : "")];
  else if (whatIf.active) [badge, mood] = ["what if", "warn"];
  else if (!visible().length) [badge, mood, text] = ["waiting", "warn", `Nothing is published yet: start a twin${whatIf.model ? ", or press What if" : ""}`];
  else if (stale.length) [badge, mood, text] = ["stale", "bad", `Stale: ${stale.map((a) => a.name).join(", ")} (last data ${(oldest / 1000).toFixed(0)} s ago)`];
  else if (recording.on) [badge, mood] = [`recording ${recording.opened.name}`, "warn"];
  else if (showsPast()) [badge, mood] = [state.paused ? "paused" : "looking back", "warn"];
  at("link").textContent = badge;
  at("link").className = `badge ${mood}`;
  document.body.classList.toggle("stale", mood === "bad");
  alarm(text, mood);
  at("film").setAttribute("aria-pressed", recorder.filming);
  at("film").textContent = recorder.filming ? "Stop" : "Record";
}

// The stretch of time that the charts show: from the first reading on, at most a minute unless all is asked for.
function timeWindow(series) {
  if (recording.on && !whatIf.active) return { now: recording.span_ms, age_ms: recording.span_ms - recording.at_ms, span_ms: recording.span_ms };
  const now = whatIf.active ? performance.now() : clock();
  const first = Math.min(now, ...series.flatMap(({ bins, shift_ms }) => (bins.length ? [bins[0].t_ms + shift_ms] : [])));
  const span_ms = Math.max(SHORTEST_MS, now - first);
  return { now, age_ms: whatIf.active ? 0 : state.age_ms, span_ms: at("window").value === "minute" ? Math.min(SPAN_MS, span_ms) : span_ms };
}

function panels() {
  const actuator = chosen();
  const recent = state.drawn.filter((time) => performance.now() - time < 1000).length;
  if (actuator?.shown) {
    const frame = showsPast() ? actuator.shown : actuator.latest;
    showNumbers(at("numbers"), frame, recent);
  }
  const kept = recording.on && !whatIf.active ? "all" : at("window").value;
  const series = visible().map(({ history, colour }) => ({ bins: history[kept].bins, shift_ms: history.shift_ms, isSteady: whatIf.active, colour }));
  const window = timeWindow(series);
  const mode = whatIf.active ? "whatif" : recording.on ? "recording" : series.some(({ bins }) => bins.length) ? "live" : "waiting";
  charts.draw(series, window, { ink: css("--ink"), line: css("--line"), faint: css("--faint") }, mode);
  at("window").hidden = kept === "all" && recording.on;
  at("span-text").textContent = { recording: `the whole recording, ${(window.span_ms / 1000).toFixed(1)} s`, waiting: "charts: no reading yet",
    whatif: `charts: ${duration(window.span_ms)}, every prediction`, live: `charts: ${duration(window.span_ms)}, every reading` }[mode];
  at("time").hidden = whatIf.active;
  if (recording.on) return;
  at("scrub").min = -Math.round(Math.min(SPAN_MS, window.span_ms) / 100) / 10; // integer steps, so that 0 is one of them
  at("when").textContent = state.age_ms > 0 ? `−${(state.age_ms / 1000).toFixed(1)} s` : state.paused ? "paused" : "now";
}

function duration(ms) {
  const s = ms / 1000;
  return s < 120 ? `${s.toFixed(0)} s` : s < 7200 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(1)} h`;
}

let [lastTick, drew] = [performance.now(), false];

function drawScene() {
  scene.draw({ range: scale.range, lit: state.lit, lines: state.lines });
  recorder.drawn();
}

function tick() {
  const passed_ms = performance.now() - lastTick;
  lastTick += passed_ms;
  if (drew) painter.pace(passed_ms);
  drew = state.dirty;
  if (state.dirty) {
    state.dirty = false;
    const now = performance.now();
    drawScene();
    state.drawn = [...state.drawn.filter((time) => now - time < 1000), now];
    link.ready();
  }
  requestAnimationFrame(tick);
}

function pause(paused) {
  if (recording.on) { recording.toggle(); return; }
  Object.assign(state, { paused, frozen_ms: performance.now() });
  if (!paused) { state.age_ms = 0; at("scrub").value = 0; }
  at("pause").setAttribute("aria-pressed", paused);
  at("pause").textContent = paused ? "Resume" : "Pause";
  reshow();
  touch();
}

at("pause").onclick = () => pause(!state.paused);
at("scrub").oninput = () => { if (recording.on) { recording.seek(); return; } state.age_ms = -1000 * parseFloat(at("scrub").value); reshow(); touch(); };
at("views").onclick = (event) => { const { view } = event.target.dataset; if (!view) return; if (view !== "fit") camera.view(view); camera.moved = false; scene.fit(); };
const toggle = (id, key) => () => { state[key] = !state[key]; at(id).setAttribute("aria-pressed", state[key]); touch(); };
at("shading").onclick = toggle("shading", "lit");
at("lines").onclick = toggle("lines", "lines");
at("save").onclick = () => { drawScene(); recorder.save(); };
at("film").onclick = () => { drawScene(); recorder.toggle(); touch(); };
const darkSystem = matchMedia("(prefers-color-scheme: dark)");
const isDark = () => (document.documentElement.dataset.theme ?? (darkSystem.matches ? "dark" : "light")) === "dark";
const showTheme = () => { at("theme").setAttribute("aria-pressed", isDark()); touch(); };
at("theme").onclick = () => { document.documentElement.dataset.theme = isDark() ? "light" : "dark"; showTheme(); };
darkSystem.onchange = showTheme;
showTheme();
const KEYS = { 1: "iso", 2: "side", 3: "top", 4: "end", f: "fit" };
const BUTTONS = { l: "shading", m: "lines", t: "theme", p: "save", r: "film" };
addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT"].includes(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
  const view = KEYS[event.key.toLowerCase()];
  if (view) document.querySelector(`[data-view=${view}]`).click();
  if (event.key === " ") { event.preventDefault(); pause(!state.paused); }
  const button = BUTTONS[event.key.toLowerCase()];
  if (button) at(button).click();
});

at("scene").addEventListener("pointermove", (event) => {
  const [origin, direction] = camera.ray(event.offsetX, event.offsetY);
  let best = { distance: Infinity };
  for (const actuator of event.buttons ? [] : visible()) {
    const hit = actuator.body ? pick(actuator.body, origin, direction, actuator.place) : best;
    if (hit.distance < best.distance) best = { ...hit, actuator };
  }
  at("tip").hidden = !best.actuator;
  if (!best.actuator) return;
  at("tip").textContent = best.actuator.describe(best.node);
  const [x, y] = [Math.min(event.clientX + 14, innerWidth - at("tip").offsetWidth - 8), Math.min(event.clientY + 14, innerHeight - at("tip").offsetHeight - 8)];
  at("tip").style.transform = `translate(${x}px, ${y}px)`;
});
at("scene").addEventListener("pointerleave", () => { at("tip").hidden = true; });

setInterval(() => {
  if (!recording.on) link.send({ type: "readings" });
  if (recorder.filming) touch(); // a film of what stands still has pictures too
  status();
}, READINGS_EVERY_MS);
setInterval(panels, painter.software ? PANELS_EVERY_MS : READINGS_EVERY_MS);
requestAnimationFrame(tick);

// For scripts and tests: what is on the browser right now.
window.softtwin = { state, scale, camera, painter, scene, recorder, chosen, visible, link };
