"""softtwin's peers on the contact states of a database: numpy, EZyRB and the paper's own way. See `softtwin-studies peers`.

peers.py DATABASE MODES.csv N SOFTTWIN MODEL.twin prints what it trained and how far each is from the held-back contact states as one JSON
line; then, for each line it reads, the time of each peer (us). SOFTTWIN is the tool, which predicts the same states with the model.

The reduced model of every peer: N modes, cubic kernels over inputs scaled to [0, 1]. softtwin keeps N modes of each of four
fields and derives the displacement; the others keep N modes of all five fields stacked, as the paper and EZyRB do: one mode
matrix of 125,110 x N.
"""
import csv
import json
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
from scipy.interpolate import RBFInterpolator

MODES = int(sys.argv[3])
AT = np.array([0.6, 0.3])


def contact_states(database):
    """Inputs (pressure, gap) scaled to the training's range and snapshots, field-major, of the training cases with contact; the same of those
    held back within that range, with their inputs as they are."""
    with open(database / "cases.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    snapshots = np.load(database / "snapshots.npy", mmap_mode="r")

    def chosen(is_chosen):
        keep = [i for i, row in enumerate(rows) if row["regime"] == "contact" and is_chosen(row["split"])]
        inputs = np.array([[float(rows[i]["pressure_mpa"]), float(rows[i]["gap_mm"])] for i in keep])
        fields = np.ascontiguousarray(snapshots[keep].transpose(0, 2, 1)).reshape(len(keep), -1)
        return inputs, fields.astype(np.float64)

    inputs, fields = chosen(lambda split: split == "train")
    held, truth = chosen(lambda split: split != "train")
    low, range_ = inputs.min(axis=0), np.ptp(inputs, axis=0)
    inside = ((held >= low) & (held <= low + range_)).all(axis=1)
    return (inputs - low) / range_, fields, (held[inside] - low) / range_, truth[inside], held[inside]


def errors_percent(predicted, truth):
    """Displacement and stress: mean and 95th percentile over the states of the error's norm over all nodes, in % of the field's."""
    found = []
    for state, true in zip(predicted, truth):
        state, true = state.reshape(5, -1), true.reshape(5, -1)
        moved = np.linalg.norm(state[:3] - true[:3]) / np.linalg.norm(true[3])
        found.append([100 * moved, 100 * np.linalg.norm(state[4] - true[4]) / np.linalg.norm(true[4])])
    return [[float(np.mean(column)), float(np.quantile(column, 0.95))] for column in np.array(found).T]


def predicted_by(tool, model, states):
    """Fields of softtwin's model at pressures and gaps."""
    with tempfile.TemporaryDirectory() as folder:
        for pressure_mpa, gap_mm in states:
            at = ["--pressure", repr(float(pressure_mpa)), "--gap", repr(float(gap_mm))]
            subprocess.run([tool, "predict", model, *at, "--out", f"{folder}/state.npy", "--json"], check=True, capture_output=True)
            yield np.load(f"{folder}/state.npy").T.reshape(-1).astype(np.float64)


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

    def __init__(self, inputs, fields, table):
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
        self.table = table
        np.savetxt(table, self.modes, delimiter=",")

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
        return np.loadtxt(self.table, delimiter=",") @ (self.weights @ self.kernel_values(x))


def train_ezyrb(inputs, fields):
    try:
        import torch  # noqa: F401
    except ImportError:
        # EZyRB imports PyTorch for its neural networks, which are not used here: the name is enough.
        torch = MagicMock()
        torch.nn.Module = object
        torch.Tensor = type("Tensor", (), {})  # scipy asks whether an array is one
        sys.modules.update({"torch": torch, "torch.nn": torch.nn})
    from ezyrb import POD, RBF, Database, ReducedOrderModel

    start = time.perf_counter()
    model = ReducedOrderModel(Database(inputs, fields), POD("svd", rank=MODES), RBF(kernel="cubic"))
    model.fit()
    return model, time.perf_counter() - start


def train_process(inputs, fields):
    """POD and a Gaussian process for each mode."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    warnings.simplefilter("ignore", ConvergenceWarning)  # a length at the end of its bounds is an answer

    start = time.perf_counter()
    mean = fields.mean(axis=0)
    modes, values, rows = np.linalg.svd((fields - mean).T, full_matrices=False)
    coefficients = (values[:MODES, None] * rows[:MODES]).T
    kernel = ConstantKernel(1.0, (1e-3, 1e6)) * Matern([1.0, 1.0], (1e-2, 1e2), nu=2.5)
    process = [GaussianProcessRegressor(kernel, alpha=1e-10, normalize_y=True).fit(inputs, column) for column in coefficients.T]
    training_s = time.perf_counter() - start
    return (lambda x: mean + modes[:, :MODES] @ np.array([mode.predict(x[None])[0] for mode in process])), training_s


def main():
    inputs, fields, held, truth, states = contact_states(Path(sys.argv[1]))
    numpy = Numpy(inputs, fields, sys.argv[2])
    ezyrb, ezyrb_s = train_ezyrb(inputs, fields)
    if not np.allclose(numpy.f64(AT), numpy.from_csv(AT), rtol=1e-9, atol=1e-9):
        raise SystemExit("peers: the CSV modes do not give the field of the modes in memory")
    if not np.allclose(numpy.with_tail(AT), ezyrb.predict(AT[None])[0], rtol=1e-6, atol=1e-6):
        raise SystemExit("peers: EZyRB does not give the field of the same modes and kernels in numpy")
    process, process_s = train_process(inputs, fields)
    without_tail = errors_percent((numpy.f64(x) for x in held), truth)
    with_tail = errors_percent((numpy.with_tail(x) for x in held), truth)
    ways = [
        ("the paper's way: modes read from CSV each time", lambda: numpy.from_csv(AT), 1.0, numpy.training_s, without_tail),
        ("EZyRB 1.3.3", lambda: ezyrb.predict(AT[None]), 1.0, ezyrb_s, errors_percent((ezyrb.predict(x[None])[0] for x in held), truth)),
        ("scipy's RBFInterpolator", lambda: numpy.with_tail(AT), 0.5, numpy.training_s, with_tail),
        ("a Gaussian process for each mode", lambda: process(AT), 1.0, process_s, errors_percent(map(process, held), truth)),
        ("numpy f64", lambda: numpy.f64(AT), 0.5, numpy.training_s, without_tail),
        ("numpy f32, column-major, out=", lambda: numpy.f32(AT), 0.5, numpy.training_s, without_tail),
    ]
    peers = [{"name": name, "training_s": training_s, "errors_percent": errors} for name, _, _, training_s, errors in ways]
    own = errors_percent(predicted_by(sys.argv[4], sys.argv[5], states), truth)
    said = {"entries": fields.shape[1], "modes": MODES, "states": len(inputs), "held_back": len(held), "peers": peers, "own_errors_percent": own}
    print(json.dumps(said), flush=True)
    for _ in sys.stdin:
        print(json.dumps([median_us(work, seconds) for _, work, seconds, *_ in ways]), flush=True)


if __name__ == "__main__":
    main()
