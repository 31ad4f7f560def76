// The numbers of the chosen actuator.

const ROWS = [
  { name: "contact force", unit: "N", main: true, value: (f) => f.contact_force_n, digits: 3, wanted: (f) => known(f.contact_force_n), more: (f) => [halfwidthText(f.force_halfwidth_n, 3, "N")] },
  { name: "measured force", unit: "N", main: true, value: (f) => f.measured_force_n, digits: 3, wanted: (f) => known(f.measured_force_n),
    more: (f) => [comparedText(f.measured_force_n - f.contact_force_n)] },
  { name: "pressure", unit: "MPa", value: (f) => f.pressure_mpa, digits: 4, wanted: (f) => known(f.pressure_mpa), more: (f) => [sourceText(f, "pressure_mpa")] },
  { name: "gap", unit: "mm", value: (f) => f.gap_mm, digits: 2, none: "no plate", wanted: (f) => f.gap_mm !== null, more: (f) => [sourceText(f, "gap_mm")] },
  { name: "largest stress", unit: "MPa", value: (f) => f.max_von_mises_mpa, digits: 3, wanted: (f) => known(f.max_von_mises_mpa),
    more: (f) => [halfwidthText(f.von_mises_halfwidth_mpa, 3, ""), known(f.max_von_mises_node) ? `${partText(f)}node ${f.max_von_mises_node}` : ""] },
  { name: "largest displacement", unit: "mm", value: (f) => f.max_displacement_mm, digits: 2, more: (f) => [halfwidthText(f.displacement_halfwidth_mm, 2, "mm")] },
  { name: "latency", unit: "ms", value: (f) => f.latency_ms, digits: 3, none: "–",
    more: (f, fps) => [known(f.rate_hz) ? `${f.rate_hz.toFixed(0)} read/s` : "", fps > 0 ? `${fps.toFixed(0)} drawn/s` : ""] },
];

const known = (value) => Number.isFinite(value);
const comparedText = (more_n) => (known(more_n) ? `${Math.abs(more_n).toFixed(3)} N ${more_n < 0 ? "below" : "above"} predicted` : "");
const halfwidthText = (half, digits, unit) => (known(half) ? `± ${Number(half.toFixed(digits + 1)) || !half ? half.toFixed(digits + 1) : half.toPrecision(1)} ${unit}`.trim() : "");

// A prediction and a recording are computed at the nodes of the outer skin; live it is the largest of all nodes sent.
const partText = (f) => (f.predicted || known(f.t_s) ? "skin " : "");

// Source of an input's value: measured, given, nominal, estimated; empty if unknown.
function sourceText({ input_names = [], input_sources = [] }, name) {
  const source = input_sources[input_names.indexOf(name)] ?? "unknown";
  return source === "unknown" ? "" : source;
}

function onsetText(onset_mpa) {
  if (onset_mpa === "Infinity") return "plate out of reach";
  if (!known(onset_mpa)) return "";
  return onset_mpa > 0 ? `contact from ${onset_mpa.toFixed(4)} MPa` : "contact by weight";
}

// What a flag says about a prediction: the inputs may each be in their trained range, and their combination outside of it.
const MEANINGS = {
  "near-edge": "these inputs together are just outside of what was trained, where half-widths are wider or absent",
  "outside-domain": "these inputs together are outside of what was trained, where half-widths are wider or absent",
};

// Flags that are no warnings: a load cell is there; a model has more coefficients than fit a state.
const HARMLESS = ["coefficients-cut", "force-measured"];

export function showNumbers(parent, frame, fps) {
  const cells = ROWS.filter((row) => row.wanted?.(frame) ?? true).map((row) => {
    const value = row.value(frame);
    const main = known(value) ? [value.toFixed(row.digits), row.unit] : [row.none ?? "–", ""];
    return cell(row, main, row.more(frame, fps));
  });
  const { input_names = [], inputs = [], force_by_input = [] } = frame;
  input_names.forEach((name, k) => {
    if (name === "pressure_mpa" || name === "gap_mm") return; // the others are parameters
    const [value, by] = [inputs[k], force_by_input[k]];
    const more = [sourceText(frame, name), known(by) ? `dF ${by.toPrecision(3)} N a unit` : ""];
    if (known(value)) cells.push(cell({ name }, [value.toPrecision(4), ""], more));
  });
  cells.push(words("regime", frame.regime, frame.regime === "unknown" ? "warn" : "good", [onsetText(frame.onset_pressure_mpa)]));
  const warnings = frame.flags.filter((flag) => !HARMLESS.includes(flag));
  const rest = frame.flags.filter((flag) => HARMLESS.includes(flag)).join(", ");
  const outcome = frame.outcome && frame.outcome !== "published" ? `newest reading: ${frame.outcome}` : rest;
  const meanings = warnings.map((flag) => MEANINGS[flag]);
  cells.push(words("flags", warnings.join(", ") || "none", warnings.length ? "warn" : "good", [...meanings, outcome]));
  parent.replaceChildren(...cells);
}

function cell({ name, main }, [value, unit], more) {
  const box = element("div", main ? "number main" : "number");
  const line = element("div", "value", value);
  line.append(" ", element("span", "unit", unit));
  box.append(element("div", "name", name), line, notes(more));
  return box;
}

function words(name, text, mood, more) {
  const box = element("div", "number");
  box.append(element("div", "name", name), element("div", `value words ${mood}`, text), notes(more));
  return box;
}

// Notes below a value; a line breaks between notes, not within one.
function notes(lines) {
  const line = element("div", "more");
  lines.filter(Boolean).forEach((text, k) => line.append(k ? " " : "", element("span", "note", k ? `· ${text}` : text)));
  return line;
}

function element(tag, className, text) {
  const node = document.createElement(tag);
  node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}
