"""Draws how much the contact force changes if one measure of the finger is 10 % larger."""

import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import softtwin

PRESSURE_MPA, GAP_MM = 0.05, 30.0
MEASURES = {
    "elastomer.law.mu_mpa": "stiffness of the silicone",
    "chambers.length_mm": "length of a chamber",
    "chambers.width_mm": "width of the chambers",
    "base.lower_mm": "base below the sheet",
    "sheet.thickness_mm": "thickness of the sheet",
}

model = softtwin.Model(softtwin.shared_file("models/pneunet-design/pneunet-design.twin"))
state = model.predict(PRESSURE_MPA, GAP_MM, fields=False)
changes = {
    words: 0.1 * model.inputs[name].value * state.force_gradient[name] / state.contact_force_n
    for name, words in MEASURES.items()
}
names = sorted(changes, key=lambda name: abs(changes[name]))

plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "gallery", "font.family": "sans-serif", "font.size": 11})
figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
bars = axes.barh(names, [100.0 * changes[name] for name in names], color="#005493")
axes.bar_label(bars, fmt="%+.1f %%", padding=4)
axes.axvline(0.0, color="black", linewidth=0.8)
axes.margins(x=0.2)
axes.spines[["top", "right", "left"]].set_visible(False)
axes.set_xlabel("change of the contact force, %")
axes.set_title(f"10 % more of ... at P = {PRESSURE_MPA} MPa, gap {GAP_MM:g} mm: {state.contact_force_n:.3f} N", fontsize=12)
figure.savefig(sys.argv[1], metadata={"Date": None})
for name in reversed(names):
    print(f"{name:28} {100.0 * changes[name]:+6.2f} %")
