// The numbers of the chosen actuator.

const ROWS = [
  { name: "contact force", unit: "N", value: (f) => f.contact_force_n, digits: 3,
    more: (f) => [halfwidthText(f.force_halfwidth_n, 3, "N"), known(f.measured_force_n) ? `measured ${f.measured_force_n.toFixed(3)} N` : ""] },
  { name: "pressure", unit: "MPa", value: (f) => f.pressure_mpa, digits: 4,
    more: (f) => [f.onset_pressure_mpa === "Infinity" ? "plate out of reach" : known(f.onset_pressure_mpa) ? f.onset_pressure_mpa > 0 ? `contact from ${f.onset_pressure_mpa.toFixed(4)}` : "contact by weight" : ""] },
  { name: "gap", unit: "mm", value: (f) => f.gap_mm, digits: 2, none: "no plate", more: () => [] },
  { name: "largest stress", unit: "MPa", value: (f) => f.max_von_mises_mpa, digits: 3,
    more: (f) => [halfwidthText(f.von_mises_halfwidth_mpa, 3, ""), known(f.max_von_mises_node) ? `node ${f.max_von_mises_node}` : ""] },
  { name: "largest displacement", unit: "mm", value: (f) => f.max_displacement_mm, digits: 2,
    more: (f) => [halfwidthText(f.displacement_halfwidth_mm, 2, "mm")] },
  { name: "latency", unit: "ms", value: (f) => f.latency_ms, digits: 3, none: "–", more: (f) => [known(f.rate_hz) ? `${f.rate_hz.toFixed(0)} readings/s` : ""] },
];

const known = (value) => Number.isFinite(value);
const halfwidthText = (half, digits, unit) => (known(half) ? `± ${half.toFixed(digits)} ${unit}`.trim() : "");

export function showNumbers(parent, frame, fps) {
  const cells = ROWS.map((row) => {
    const value = row.value(frame);
    const main = known(value) ? [value.toFixed(row.digits), row.unit] : [row.none ?? "–", ""];
    return cell(row.name, main, row.more(frame).filter(Boolean).join(" · "));
  });
  cells.push(words("regime", frame.regime, frame.regime === "unknown" ? "warn" : "good", `${fps.toFixed(0)} frames/s drawn`));
  const flags = frame.flags.length ? frame.flags.join(", ") : "none";
  cells.push(words("flags", flags, frame.flags.length ? "warn" : "good", frame.outcome && frame.outcome !== "published" ? `newest reading: ${frame.outcome}` : ""));
  parent.replaceChildren(...cells);
}

function cell(name, [value, unit], more) {
  const box = element("div", "number");
  const line = element("div", "value", value);
  line.append(" ", element("span", "unit", unit));
  box.append(element("div", "name", name), line, element("div", "more", more));
  return box;
}

function words(name, text, mood, more) {
  const box = element("div", "number");
  box.append(element("div", "name", name), element("div", `value words ${mood}`, text), element("div", "more", more));
  return box;
}

function element(tag, className, text) {
  const node = document.createElement(tag);
  node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}
