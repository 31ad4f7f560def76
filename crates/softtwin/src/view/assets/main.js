// Puts the page together: link -> actuators -> scene, numbers, charts.

import { Actuator } from "./actuator.js";
import { Camera } from "./camera.js";
import { COLOURS, Charts } from "./charts.js";
import { Painter } from "./gl.js";
import { SPAN_MS } from "./history.js";
import { Link } from "./link.js";
import { Mesh, block, pick } from "./mesh.js";
import { showNumbers } from "./numbers.js";
import { Recording } from "./recording.js";
import { Scale } from "./scale.js";
import { WhatIf } from "./whatif.js";

const at = (id) => document.getElementById(id);
const PREDICTION = "what if";
const HERE = { offset: [0, 0, 0], flip: 1 };
const PANEL_FREE = 0.72; // share of the width that the panel leaves to the scene

const table = new Uint8Array(await (await fetch(`colours${location.search}`)).arrayBuffer());
const state = { models: new Map(), meshes: new Map(), actuators: new Map(), chosen: null, places: {}, blocks: [], up: false, everUp: false, paused: false,
  age_ms: 0, frozen_ms: 0, dirty: true, lit: true, lines: false, drawn: [], frames: 0, fitted: false, reason: "" };

const touch = () => { state.dirty = true; };
const camera = new Camera(at("scene"), touch);
const scale = new Scale(table, () => { reshow(); touch(); });
const charts = new Charts(at("charts"));
let painter;
try { painter = new Painter(at("scene"), table); } catch (error) { alarm(error.message); throw error; }

const link = new Link({
  onUp: () => { Object.assign(state, { up: true, everUp: true, reason: "" }); whatIf.reset(); if (whatIf.active) whatIf.request(); touch(); },
  onDown: (reason) => { Object.assign(state, { up: false, reason }); whatIf.reset(); touch(); },
  onMessage: (message) => {
    if (message.type === "hello") hello(message);
    if (message.type === "notice") notice(message.text);
    if (message.type === "recording") openRecording(message);
    if (message.type === "grasp") showGrasp(message);
    if (message.type === "refused") { notice(message.text); whatIf.answered(); }
  },
  onFrame: (header, buffer, start) => (header.kind === "mesh" ? addMesh : addFrame)(header, buffer, start),
});
const recording = new Recording((message) => link.send(message));
const whatIf = new WhatIf((message) => link.send(message), () => { choose(null); reshow(); touch(); });

function hello({ models, places, blocks }) {
  state.models = new Map(models.map((model) => [model.id, model]));
  state.places = places;
  state.blocks = blocks.map(({ min_mm, max_mm }) => ({ low: min_mm, high: max_mm, mesh: block(min_mm, max_mm) }));
  whatIf.useModel(models[0] ?? null);
}

function addMesh({ model, nodes, facets }, buffer, start) {
  const undeformed = new Float32Array(buffer, start, 3 * nodes);
  const corners = new Uint32Array(buffer, start + 12 * nodes, 3 * facets);
  const ids = new Uint32Array(buffer, start + 12 * (nodes + facets), nodes);
  state.meshes.set(model, new Mesh(undeformed, corners, ids));
}

// Another recording: its actuators, and all their states for the charts.
function openRecording(message) {
  recording.open(message);
  state.actuators.clear();
  for (const track of message.tracks) {
    addActuator(track.actuator);
    state.actuators.get(track.actuator).history.states = recording.states(track);
  }
}

function addFrame(header, buffer, start) {
  const frame = { ...header, received_ms: performance.now() };
  for (const name of ["fields", "coefficients", "group_sizes"]) delete frame[name]; // `fields` are the names until here
  if (header.count) {
    frame.fields = {};
    header.fields.forEach((name, k) => { frame.fields[name] = new Float32Array(buffer, start + 4 * k * header.count, header.count); });
    frame.max_displacement_mm = frame.fields.displacement?.reduce((a, b) => Math.max(a, b), 0) ?? null;
  }
  if (!state.actuators.has(frame.actuator)) addActuator(frame.actuator);
  const actuator = state.actuators.get(frame.actuator);
  actuator.receive(frame);
  state.frames++;
  if (frame.predicted) whatIf.answered();
  if (frame.t_s !== null) recording.follow(frame);
  if (!showsPast()) show(actuator, frame);
  touch();
}

function addActuator(name) {
  const index = name === PREDICTION ? 0 : [...state.actuators.keys()].filter((key) => key !== PREDICTION).length;
  state.actuators.set(name, new Actuator(name, index, COLOURS[state.actuators.size % COLOURS.length], state.places[name]));
  choose(state.chosen);
}

function show(actuator, frame) {
  actuator.show(frame, state.meshes.get(frame.model), scale.quantity);
  if (visible().includes(actuator)) scale.follow(visible());
  if (!state.fitted && actuator.box()) { state.fitted = true; fit(); }
}

const showsPast = () => !recording.on && (state.paused || state.age_ms > 0);
const visible = () => [...state.actuators.values()].filter((a) => (a.name === PREDICTION) === whatIf.active);
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
  at("actuators").replaceChildren(...visible().map((actuator) => {
    const button = document.createElement("button");
    const dot = document.createElement("span");
    dot.className = "dot";
    dot.style.background = actuator.colour;
    button.append(dot, actuator.name);
    button.setAttribute("aria-pressed", actuator === chosen());
    button.onclick = () => { choose(actuator.name); touch(); };
    return button;
  }));
  state.fitted = false;
}

// What can be touched: the blocks of the scene, or else a plate below each actuator.
function plates() {
  if (state.blocks.length && !whatIf.active) return [];
  return visible().flatMap((actuator) => {
    const model = state.models.get(actuator.shown?.model);
    const gap = actuator.shown?.gap_mm;
    if (!model?.obstacle || !Number.isFinite(gap)) return [];
    const { x_mm, z_mm } = model.obstacle;
    const { offset, flip } = actuator.place;
    const y = -gap * flip + offset[1];
    return [{ actuator, low: [x_mm[0] + offset[0], y, z_mm[0] + offset[2]], high: [x_mm[1] + offset[0], y, z_mm[1] + offset[2]] }];
  });
}

function fit() {
  const boxes = [...visible().map((actuator) => actuator.box()).filter(Boolean), ...plates(), ...(whatIf.active ? [] : state.blocks)];
  if (!boxes.length) return;
  const corner = (name, pick) => [0, 1, 2].map((k) => pick(...boxes.map((box) => box[name][k])));
  camera.fit(corner("low", Math.min), corner("high", Math.max), PANEL_FREE);
}

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);

function drawScene() {
  painter.begin(camera);
  for (const actuator of visible())
    if (actuator.body) painter.drawBody(actuator.body, actuator.place, { range: scale.range, lit: state.lit, lines: state.lines });
  for (const { mesh } of whatIf.active ? [] : state.blocks) painter.drawBody(mesh, HERE, { range: scale.range, lit: true, lines: false });
  for (const { low, high } of plates()) painter.drawPlate(low, high, rgb(css("--plate")), rgb(css("--grid")));
  for (const { actuator, low } of plates()) if (actuator.body) painter.drawShadow(actuator.body, actuator.place, low[1]);
}

function alarm(text) {
  at("alarm").hidden = !text;
  at("alarm").textContent = text;
}

// Whether the gripper holds its object, and where to stop inflating.
function showGrasp({ text }) {
  at("grasp").hidden = false;
  at("grasp").textContent = text;
}

function notice(text) {
  at("notice").hidden = !text;
  at("notice").textContent = text;
}

// The states that the user must notice: no connection, nothing published, old data.
function status() {
  const now = performance.now();
  const stale = visible().filter((actuator) => actuator.isStale(now, link.requested_ms));
  const oldest = Math.max(0, ...stale.map((actuator) => now - actuator.latest.received_ms));
  let [badge, mood, text] = ["live", "live", ""];
  if (!state.up) [badge, mood, text] = ["disconnected", "bad", state.reason || (state.everUp ? "Connection to softtwin view lost; trying again" : "")];
  else if (whatIf.active) [badge, mood] = ["what if", "warn"];
  else if (!visible().length) [badge, mood, text] = ["waiting", "warn", "Nothing is published yet: start a twin, or press What if"];
  else if (stale.length) [badge, mood, text] = ["stale", "bad", `Stale: ${stale.map((a) => a.name).join(", ")} (last data ${(oldest / 1000).toFixed(0)} s ago)`];
  else if (recording.on) [badge, mood] = [`recording ${recording.opened.name}`, "warn"];
  else if (showsPast()) [badge, mood] = [state.paused ? "paused" : "looking back", "warn"];
  at("link").textContent = badge;
  at("link").className = `badge ${mood}`;
  document.body.classList.toggle("stale", mood === "bad");
  alarm(text);
}

function panels() {
  const actuator = chosen();
  const now = clock();
  const recent = state.drawn.filter((time) => performance.now() - time < 1000).length;
  if (actuator?.shown) showNumbers(at("numbers"), showsPast() ? actuator.shown : actuator.latest, recent);
  const series = visible().map(({ history, colour }) => ({ states: history.states, colour }));
  const window = recording.on && !whatIf.active
    ? { now: recording.span_ms, age_ms: recording.span_ms - recording.at_ms, span_ms: recording.span_ms }
    : { now, age_ms: state.age_ms, span_ms: SPAN_MS };
  charts.draw(series, window, { ink: css("--ink"), line: css("--line"), faint: css("--faint") });
  if (!recording.on) at("when").textContent = state.age_ms > 0 ? `−${(state.age_ms / 1000).toFixed(1)} s` : state.paused ? "paused" : "now";
}

let [lastTick, drew] = [performance.now(), false];

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
at("views").onclick = (event) => { const { view } = event.target.dataset; if (view === "fit") fit(); else if (view) { camera.view(view); fit(); } };
const toggle = (id, key) => () => { state[key] = !state[key]; at(id).setAttribute("aria-pressed", state[key]); touch(); };
at("shading").onclick = toggle("shading", "lit");
at("lines").onclick = toggle("lines", "lines");
at("theme").onclick = () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  touch();
};
const KEYS = { 1: "iso", 2: "side", 3: "top", 4: "end", f: "fit" };
addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
  const view = KEYS[event.key.toLowerCase()];
  if (view) document.querySelector(`[data-view=${view}]`).click();
  if (event.key === " ") { event.preventDefault(); pause(!state.paused); }
  const button = { l: "shading", m: "lines", t: "theme" }[event.key.toLowerCase()];
  if (button) at(button).click();
});
addEventListener("resize", touch);

at("scene").addEventListener("pointermove", (event) => {
  const [origin, direction] = camera.ray(event.clientX, event.clientY);
  let best = { distance: Infinity };
  for (const actuator of event.buttons ? [] : visible()) {
    const hit = actuator.body ? pick(actuator.body, origin, direction, actuator.place) : best;
    if (hit.distance < best.distance) best = { ...hit, actuator };
  }
  at("tip").hidden = !best.actuator;
  if (best.actuator) {
    at("tip").textContent = best.actuator.describe(best.node);
    at("tip").style.transform = `translate(${event.clientX + 14}px, ${event.clientY + 14}px)`;
  }
});

setInterval(() => { status(); panels(); }, 100);
requestAnimationFrame(tick);

// For scripts and tests: what is on the page right now.
window.softtwin = { state, scale, camera, painter, chosen, visible };
