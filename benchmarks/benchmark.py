"""What a model of this benchmark is given and gives, how peers choose their constants, and how a prediction is judged."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
LEVEL = 0.9  # share of readings that a half-width promises to hold
PARTS = 4  # parts of a single recording that are left out in turn
MOST_ROWS = 1500  # readings that a peer learns from; longer recordings are thinned evenly


class Refused(Exception):
    """A model says that a recording teaches it nothing. Its cell in the table says so; it counts in no mean."""


@dataclass
class Run:
    """One recording: instants (n) in s or None for settled rows, inputs (n, m), outputs (n, k); names end with their units."""

    time_s: np.ndarray | None
    inputs: np.ndarray
    outputs: np.ndarray
    input_names: list[str]
    output_names: list[str]

    def rows(self, chosen) -> "Run":
        time_s = None if self.time_s is None else self.time_s[chosen]
        return replace(self, time_s=time_s, inputs=self.inputs[chosen], outputs=self.outputs[chosen])


@dataclass
class Task:
    name: str
    kind: str
    learned: list[Run]
    predicted: Run


def tasks() -> list[Task]:
    """All tasks of tasks.toml with their recordings."""
    listed = tomllib.loads((HERE / "tasks.toml").read_text())["task"]
    return [read_task(task) for task in listed]


def read_task(task: dict) -> Task:
    def run(name: str) -> Run:
        path = HERE / "data" / f"{name}.csv"
        headings = path.open().readline().strip().split(",")
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        columns = lambda names: table[:, [headings.index(name) for name in names]]
        if task.get("settled"):
            time_s = None
        elif "time_s" in headings:
            time_s = columns(["time_s"])[:, 0]
        else:
            time_s = np.arange(len(table), dtype=float)  # the reading's number, where no instants were published
        return Run(time_s, columns(task["inputs"]), columns(task["outputs"]), task["inputs"], task["outputs"])

    learned = [run(name) for name in task["learn"]]
    predicted = run(task["predict"])
    if every := task.get("learn_every"):
        is_learned = np.arange(len(predicted.inputs)) % every == 0
        learned, predicted = [predicted.rows(is_learned)], predicted.rows(~is_learned)
    if task.get("settled"):  # their order is no information
        learned, predicted = [shuffled(run) for run in learned], shuffled(predicted)
    return Task(task["name"], task["kind"], learned, predicted)


def shuffled(run: Run) -> Run:
    return run.rows(np.random.default_rng(0).permutation(len(run.inputs)))


class Scale:
    """Mean and deviation of each column over the learned runs."""

    def __init__(self, columns: list[np.ndarray]):
        stacked = np.concatenate(columns)
        self.mean, self.deviation = stacked.mean(0), stacked.std(0) + 1e-12

    def forth(self, values):
        return (values - self.mean) / self.deviation

    def back(self, values):
        return values * self.deviation + self.mean


class Peer:
    """A model whose constants are chosen among `candidates` by errors on left-out parts of the learned runs alone.

    A subclass has `candidates(step_s, length_s)`, `fit(runs, constants)` and `simulate(fitted, inputs, constants)`; both work on scaled
    values on an even grid of instants. Its half-widths are the 90 % quantile of its left-out errors.
    """

    def candidates(self, step_s: float, length_s: float) -> list:
        raise NotImplementedError

    def fit(self, runs: list[tuple[np.ndarray, np.ndarray]], constants):
        raise NotImplementedError

    def simulate(self, fitted, inputs: np.ndarray, constants) -> np.ndarray:
        raise NotImplementedError

    def learn(self, runs: list[Run]):
        self.inputs, self.outputs = Scale([run.inputs for run in runs]), Scale([run.outputs for run in runs])
        self.is_settled = runs[0].time_s is None
        if self.is_settled:
            self.step_s, length_s = 1.0, float("inf")
        else:
            lengths_s = [run.time_s[-1] - run.time_s[0] for run in runs]
            median_s = np.median(np.concatenate([np.diff(run.time_s) for run in runs]))
            self.step_s, length_s = max(median_s, sum(lengths_s) / MOST_ROWS), float(np.median(lengths_s))
        scaled = [self.scaled(run) for run in runs]
        range_ = np.ptp(np.concatenate([outputs for _, outputs in scaled]), axis=0) * self.outputs.deviation
        best = None
        for constants in self.candidates(self.step_s, length_s):
            with np.errstate(all="ignore"):
                errors = self.left_out(scaled, constants) * self.outputs.deviation
            score = np.sqrt(np.mean((errors**2).sum(1))) / np.sqrt((range_**2).sum())
            if np.isfinite(score) and (best is None or score < best[0]):
                best = (score, constants, errors)
        self.score, self.constants, errors = best
        self.half_width = np.quantile(np.abs(errors), LEVEL, axis=0)
        self.fitted = self.fit(scaled, self.constants)

    def left_out(self, scaled, constants) -> np.ndarray:
        errors = []
        for rest, (inputs, outputs) in parts(scaled, self.is_settled):
            errors.append(self.simulate(self.fit(rest, constants), inputs, constants) - outputs)
        return np.concatenate(errors)

    def grid(self, time_s) -> np.ndarray:
        return np.arange(time_s[0], time_s[-1] + 1e-9, self.step_s)

    def scaled(self, run: Run):
        inputs, outputs = self.inputs.forth(run.inputs), self.outputs.forth(run.outputs)
        if self.is_settled:
            return inputs, outputs
        grid = self.grid(run.time_s)
        return on(grid, run.time_s, inputs), on(grid, run.time_s, outputs)

    def predict(self, time_s, inputs) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (n, k) and their half-widths, from instants and inputs alone."""
        scaled = self.inputs.forth(inputs)
        if not self.is_settled:
            scaled = on(self.grid(time_s), time_s, scaled)
        predicted = self.outputs.back(self.simulate(self.fitted, scaled, self.constants))
        if not self.is_settled:
            predicted = on(time_s, self.grid(time_s), predicted)
        return predicted, np.broadcast_to(self.half_width, predicted.shape)


def on(instants, known, columns):
    return np.stack([np.interp(instants, known, column) for column in columns.T], 1)


def parts(scaled, is_settled: bool):
    """(all else, the part): whole runs where there are several, else four stretches; of settled rows every fourth."""
    if len(scaled) > 1:
        for left in range(len(scaled)):
            yield [run for number, run in enumerate(scaled) if number != left], scaled[left]
        return
    inputs, outputs = scaled[0]
    number = np.arange(len(inputs))
    part_of = number % PARTS if is_settled else number * PARTS // len(number)
    for left in range(PARTS):
        inside = part_of == left
        # The stretches before and after the left-out one are two runs: a filter must not run across the hole.
        before, after = ~inside & (part_of < left), ~inside & (part_of > left)
        halves = [~inside] if is_settled else [half for half in (before, after) if half.sum() > 50]
        yield [(inputs[half], outputs[half]) for half in halves], (inputs[inside], outputs[inside])


def ridge(features, outputs, smoothing: float):
    """Weights of least squares with a penalty on features scaled to a root mean square of one."""
    scale = np.sqrt((features**2).mean(0)) + 1e-9
    scaled = features / scale
    normal = scaled.T @ scaled + smoothing * len(scaled) * np.eye(scaled.shape[1])
    return np.linalg.solve(normal, scaled.T @ outputs) / scale[:, None]


def polynomial(values, degree: int):
    """1, every column, products of two columns (degree 2), powers of columns up to `degree`."""
    columns = [np.ones(len(values)), *values.T]
    if degree >= 2:
        columns += [values[:, i] * values[:, j] for i in range(values.shape[1]) for j in range(i, values.shape[1])]
    columns += [values[:, i] ** power for power in range(3, degree + 1) for i in range(values.shape[1])]
    return np.stack(columns, 1)


def rest_map(runs):
    """A cubic map of the inputs of now, from which a free run begins."""
    features = np.concatenate([polynomial(inputs, 3) for inputs, _ in runs])
    return ridge(features, np.concatenate([outputs for _, outputs in runs]), 1e-4)


def at_rest(weights, inputs):
    """Outputs (1, k) at rest under the first inputs."""
    return np.clip(polynomial(inputs[:1], 3) @ weights, -4, 4)


def judged(run: Run, predicted, half_width) -> dict:
    """Errors in % of the length of the range of the outputs, share of readings inside the half-widths, and their size."""
    error = np.asarray(predicted) - run.outputs
    range_ = np.ptp(run.outputs, axis=0)
    has_width = np.isfinite(half_width)
    inside = np.where(has_width, np.abs(error) <= half_width, np.nan)
    wide = np.quantile(np.abs(error), LEVEL, axis=0)
    return {
        "rms_percent": 100 * float(np.sqrt(np.mean((error**2).sum(1)) / (range_**2).sum())),
        "coverage_percent": [rounded(100 * np.nanmean(column)) if np.isfinite(column).any() else None for column in inside.T],
        "width_over_error": [
            rounded(np.nanmedian(width) / q) if np.isfinite(width).any() else None
            for width, q in zip(np.asarray(half_width, float).T, wide)
        ],
        "without_width_percent": rounded(100 * (1 - has_width.mean())),
    }


def rounded(value) -> float:
    return float(round(value, 3))
