"""Draws measured and predicted tip over time: tip.py TABLE PICTURE, with the table of `softtwin compare`."""

import csv
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

EVERY = 6  # rows that make one point

with open(sys.argv[1]) as table:
    rows = list(csv.DictReader(table))[::EVERY]
column = lambda name: [float(row[name]) for row in rows]

# Large enough to be read at a third of its size.
plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "gallery", "font.family": "sans-serif", "font.size": 17})
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
axes.plot(column("t_s"), column("tip_x_mm_measured"), color="#e8742c", linewidth=5.5, alpha=0.6, label="measured")
axes.plot(column("t_s"), column("tip_x_mm_predicted"), color="#005493", linewidth=2.5, label="predicted")
axes.set(xlabel="time, s", ylabel="tip x, mm")
axes.spines[["top", "right"]].set_visible(False)
figure.legend(frameon=False, loc="outside upper center", ncols=2)
figure.savefig(sys.argv[2], metadata={"Date": None})
