"""Draws how the estimated gap finds the true one: gap.py TABLES PICTURE, with the tables of `softtwin export run.mcap --out TABLES`."""

import csv
import pathlib
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

TRUE_MM = 37.33  # hidden in the trace that config/scenes/estimate.toml replays
SHOWN_MM = (25.0, 60.0)  # before the touch the interval is wider
STEP_S = 0.05  # of the curve; the twin estimates 200 times a second


def rows(path):
    with open(path) as table:
        yield from csv.DictReader(table)


tables = pathlib.Path(sys.argv[1])
# The trace's own time: when a recording begins, and how late it is written, differs from run to run.
trace_s = {row["seq"]: float(row["t_trace_s"]) for row in rows(tables / "softtwin.finger.sensor.csv")}
times_s, gaps_mm, sigmas_mm = [], [], []
for row in rows(tables / "softtwin.finger.estimate.csv"):
    t_s = trace_s.get(row["sensor_seq"])
    if t_s is None or (times_s and t_s < times_s[-1] + STEP_S):
        continue
    at = row["names"].split().index("gap_mm")
    times_s.append(t_s)
    gaps_mm.append(float(row["values"].split()[at]))
    sigmas_mm.append(float(row["sigmas"].split()[at]))

# Large enough to be read at a third of its size.
plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "gallery", "font.family": "sans-serif", "font.size": 17})
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
shown = lambda value_mm: min(max(value_mm, SHOWN_MM[0]), SHOWN_MM[1])
low, high = ([shown(gap + sign * 2.0 * sigma) for gap, sigma in zip(gaps_mm, sigmas_mm)] for sign in (-1.0, 1.0))
axes.fill_between(times_s, low, high, color="#005493", alpha=0.2, linewidth=0.0, label="± 2 sigma")
axes.plot(times_s, list(map(shown, gaps_mm)), color="#005493", linewidth=3.5, label="estimated")
axes.axhline(TRUE_MM, color="#d6451b", linewidth=2.5, linestyle="--", label="true")
axes.set(xlim=(0.5, 6.0), ylim=SHOWN_MM, xlabel="time, s", ylabel="gap, mm")
axes.spines[["top", "right"]].set_visible(False)
axes.legend(frameon=False)
figure.savefig(sys.argv[2], metadata={"Date": None})
