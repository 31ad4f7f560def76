"""Times softtwin's peers on the contact states of a database; run by bench_peers.sh.

The reduced model of every row: 6 modes, cubic kernels over inputs scaled to [0, 1]. softtwin keeps 6 modes of each of four
fields and derives the displacement; the others keep 6 modes of all five fields stacked, as the paper and EZyRB do: one mode
matrix of 125,110 x 6.
"""

import argparse
import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
from scipy.interpolate import RBFInterpolator

MODES = 6


def contact_states(database):
    """Inputs (pressure, gap) scaled to [0, 1] and snapshots, field-major, of the training cases with contact."""
    with open(database / "cases.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    keep = [i for i, row in enumerate(rows) if row["regime"] == "contact" and row["split"] == "train"]
    inputs = np.array([[float(rows[i]["pressure_mpa"]), float(rows[i]["gap_mm"])] for i in keep])
    snapshots = np.load(database / "snapshots.npy", mmap_mode="r")[keep]
    fields = np.ascontiguousarray(snapshots.transpose(0, 2, 1)).reshape(len(keep), -1)
    scaled = (inputs - inputs.min(axis=0)) / np.ptp(inputs, axis=0)
    return scaled, fields.astype(np.float64)


def median_us(work, seconds):
    """Median time of `work` over about `seconds`, at least three calls."""
    times, end = [], time.perf_counter() + seconds
    while len(times) < 3 or time.perf_counter() < end:
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))


class Numpy:
    """POD by thin SVD and cubic radial basis functions; three ways to evaluate the same model."""

    def __init__(self, inputs, fields, work):
        start = time.perf_counter()
        modes, values, rows = np.linalg.svd(fields.T, full_matrices=False)
        self.modes = np.ascontiguousarray(modes[:, :MODES])
        self.coefficients = RBFInterpolator(inputs, (values[:MODES, None] * rows[:MODES]).T, kernel="cubic")
        self.training_s = time.perf_counter() - start
        # The weights by themselves: an interpolant as a product with a vector of kernel values, as the authors have it.
        self.inputs = inputs
        gram = np.linalg.norm(inputs[:, None] - inputs[None], axis=2) ** 3
        self.weights = np.linalg.solve(gram, (values[:MODES, None] * rows[:MODES]).T).T
        self.modes32 = np.asfortranarray(self.modes, dtype=np.float32)
        self.weights32 = self.weights.astype(np.float32)
        self.out32 = np.empty(len(self.modes), dtype=np.float32)
        self.csv = work / "modes.csv"
        np.savetxt(self.csv, self.modes, delimiter=",")

    def kernel_values(self, x):
        return np.linalg.norm(self.inputs - x, axis=1) ** 3

    def f64(self, x):
        return self.modes @ (self.weights @ self.kernel_values(x))

    def f32(self, x):
        coefficients = self.weights32 @ self.kernel_values(x).astype(np.float32)
        return np.dot(self.modes32, coefficients, out=self.out32)

    def with_tail(self, x):
        return self.modes @ self.coefficients(x[None])[0]

    def from_csv(self, x):
        return np.loadtxt(self.csv, delimiter=",") @ (self.weights @ self.kernel_values(x))


def stand_in_for_torch():
    """EZyRB imports PyTorch for its neural networks, which take no part here: without it, a name is all it needs."""
    try:
        import torch  # noqa: F401
    except ImportError:
        torch = MagicMock()
        torch.nn.Module = object
        sys.modules.update({"torch": torch, "torch.nn": torch.nn})


def train_ezyrb(inputs, fields):
    stand_in_for_torch()
    from ezyrb import POD, RBF, Database, ReducedOrderModel

    start = time.perf_counter()
    model = ReducedOrderModel(Database(inputs, fields), POD("svd", rank=MODES), RBF(kernel="cubic"))
    model.fit()
    return model, time.perf_counter() - start


def train_softtwin(args):
    model = args.work / "peers.twin"
    start = time.perf_counter()
    command = [args.softtwin, "train", "--database", args.database, "--config", args.work / "train.toml", "--out", model]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return model, time.perf_counter() - start


def bench_softtwin(args, model):
    command = [str(args.softtwin), "bench", "--model", str(model), "--no-live", "--samples", "500", "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser()
    for name in ["--database", "--softtwin", "--work"]:
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()

    inputs, fields = contact_states(args.database)
    peer = Numpy(inputs, fields, args.work)
    ezyrb, ezyrb_s = train_ezyrb(inputs, fields)
    model, softtwin_s = train_softtwin(args)
    x = np.array([0.6, 0.3])
    if not np.allclose(peer.f64(x), peer.from_csv(x), rtol=1e-9, atol=1e-9):
        raise SystemExit("bench_peers: the CSV modes do not give the field of the modes in memory")
    if not np.allclose(peer.with_tail(x), ezyrb.predict(x[None])[0], rtol=1e-6, atol=1e-6):
        raise SystemExit("bench_peers: EZyRB does not give the field of the same modes and kernels in numpy")
    ways = {
        "the paper's way: modes read from CSV each time": (lambda: peer.from_csv(x), 1.0, peer.training_s),
        "EZyRB 1.3.3": (lambda: ezyrb.predict(x[None]), 1.0, ezyrb_s),
        "numpy f64": (lambda: peer.f64(x), 0.5, peer.training_s),
        "numpy f32, column-major, out=": (lambda: peer.f32(x), 0.5, peer.training_s),
    }
    times = {name: [] for name in ways}
    ours = {"softtwin, kernel, f32": [], "softtwin, kernel, i16": [], "softtwin, input to field": []}
    for _ in range(args.rounds):
        for name, (work, seconds, _) in ways.items():
            times[name].append(median_us(work, seconds))
        bench = bench_softtwin(args, model)
        ours["softtwin, kernel, f32"].append(bench["kernel"]["f32"]["warm_us_p50"])
        ours["softtwin, kernel, i16"].append(bench["kernel"]["i16"]["warm_us_p50"])
        ours["softtwin, input to field"].append(bench["predict_us_p50"])

    own = float(np.median(ours["softtwin, input to field"]))
    print(f"{fields.shape[1]:,} entries, {MODES} modes, {len(inputs)} contact states, one thread; median of {args.rounds} rounds\n")
    print("| one full field | us | softtwin is faster by | training, s |")
    print("| --- | ---: | ---: | ---: |")
    for name, (_, _, training_s) in ways.items():
        us = float(np.median(times[name]))
        print(f"| {name} | {us:,.0f} | {us / own:,.1f} | {training_s:.2f} |")
    for name, values in ours.items():
        us = float(np.median(values))
        print(f"| {name} | {us:,.1f} | {us / own:,.2f} | {softtwin_s:.2f} (both regimes) |")


if __name__ == "__main__":
    main()
