"""Runs of a bench as arrays, and what is learned from them: `learn(frame, time="t", inputs={"pressure_mpa": "p [kPa]"}, outputs={"angle_deg": "angle"})`.

A run is anything with columns by name: a `pandas.DataFrame`, a polars frame, a dict of arrays. What is odd about a file is mended by whoever reads it.
"""

import json
from typing import Any, Dict, List, Mapping, Optional, Tuple, Union

import numpy as np

from . import _native
from .model import Model

#: A column's name, or its name and unit. Without a unit it is the one in the name (`p [kPa]`, `pressure_kpa`), else that of the quantity.
Column = Union[str, Tuple[str, str]]
Columns = Mapping[str, Column]


class Recording:
    """One run: times (s), inputs and outputs by name with their unit at the end (`pressure_mpa`, `tip_x_mm`, `angle_deg`).

    `time` names the column of times, s or with its unit; None: rows at rest, in any order. `numpy.nan` stands for a missing value.

    >>> table = {"t [ms]": [0.0, 100.0, 200.0], "p": [0.0, 50.0, 80.0], "angle_deg": [0.0, 21.0, 30.0]}
    >>> run = Recording(table, time="t [ms]", inputs={"pressure_mpa": ("p", "kPa")}, outputs={"angle_deg": "angle_deg"})
    >>> len(run), run.inputs["pressure_mpa"].round(3).tolist(), run.time_s.tolist()
    (3, [0.0, 0.05, 0.08], [0.0, 0.1, 0.2])
    """

    def __init__(self, frame: Any, *, inputs: Columns, outputs: Columns, time: Optional[Column] = None) -> None:
        if not inputs or not outputs:
            raise ValueError("expected at least one input and one output")
        self.inputs = {name: _column(frame, name, column) for name, column in inputs.items()}
        self.outputs = {name: _column(frame, name, column) for name, column in outputs.items()}
        rows = len(next(iter(self.inputs.values())))
        self.time_s = np.arange(rows, dtype=np.float64) if time is None else _column(frame, "time_s", time)
        for name, values in {**self.inputs, **self.outputs, "time": self.time_s}.items():
            if len(values) != rows:
                raise ValueError(f"{name}: expected {rows} values as the first input has, found {len(values)}")
        if np.any(np.diff(self.time_s) <= 0) or not np.all(np.isfinite(self.time_s)):
            raise ValueError("time: expected finite times that rise from row to row; sort the rows, or give each run as a frame of its own")

    def __len__(self) -> int:
        return len(self.time_s)

    def _columns(self, like: "Optional[Recording]" = None) -> Any:
        like = like or self
        missing = [name for name in (*like.inputs, *like.outputs) if name not in self.inputs and name not in self.outputs]
        if missing:
            raise ValueError(f"expected the same inputs and outputs in all runs; one lacks {', '.join(missing)}")
        inputs = [self.inputs[name] for name in like.inputs]
        return self.time_s - self.time_s[0], inputs, [self.outputs[name] for name in like.outputs]


def column_of(frame: Any, name: str, heading: str) -> "np.ndarray[Any, Any]":
    """The numbers of a column, in its own unit."""
    try:
        found = frame[heading]
    except KeyError:
        known = getattr(frame, "columns", None)
        known = list(frame) if known is None else list(known)
        raise KeyError(f"{name}: no column `{heading}`; there are {', '.join(map(str, known))}") from None
    try:
        values = np.array(found, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: the column `{heading}` does not hold numbers ({error}); convert it, for example with pandas.to_numeric") from None
    if values.ndim != 1:
        raise ValueError(f"{name}: expected one value per row in `{heading}`, found shape {values.shape}")
    return values


def _column(frame: Any, name: str, column: Column) -> "np.ndarray[Any, Any]":
    heading, unit = (column, None) if isinstance(column, str) else column
    return column_of(frame, name, heading) * _native.to_unit(name, heading, unit)


def _recordings(runs: Any, channels: Mapping[str, Any]) -> List[Recording]:
    several = isinstance(runs, (list, tuple))
    found = [run if isinstance(run, Recording) else Recording(run, **channels) for run in (runs if several else [runs])]
    if not found:
        raise ValueError("expected at least one run")
    return found


def learn(runs: Any, *, name: str = "measured", **channels: Any) -> Model:
    """A model of measurements: its answers have half-widths, and grow uncertain beyond the learned inputs.

    `runs`: one frame or `Recording`, or a list of them; `channels` are those of `Recording`. Several runs tell how the next one differs.
    `model.report` says how well the outputs are explained on parts that were left out. Takes some seconds for 1,500 rows.
    Raises `ValueError` where the runs teach nothing: nothing moves, too few rows, outputs that do not follow the inputs.

    >>> channels = dict(time="t", inputs={"pressure_mpa": "p"}, outputs={"angle_deg": "a"})
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> pressure = 0.04 + 0.03 * np.sin(0.7 * t) + 0.01 * np.sin(1.9 * t)
    >>> model = learn({"t": t, "p": pressure, "a": 800.0 * pressure**1.5}, **channels)
    >>> model.report["outputs"]["angle_deg"]["explained"] > 0.99
    True
    >>> abs(model.predict(0.05).outputs["angle_deg"] - 800.0 * 0.05**1.5) < 0.2
    True
    """
    recordings = _recordings(runs, channels)
    first = recordings[0]
    columns = [run._columns(first) for run in recordings]
    native, report = _native.learn(name, list(first.inputs), list(first.outputs), columns)
    return Model._made(native, json.loads(report))


class Comparison:
    """How far a model is from a run, as `compare` finds it. `report` is what `softtwin compare --json` prints."""

    def __init__(self, report: Dict[str, Any], time_s: "np.ndarray[Any, Any]", arrays: List[Any]) -> None:
        self.report = report
        self.time_s = time_s
        #: By output: measured and predicted values and half-widths.
        self.measured = {name: values for name, values, _, _ in arrays}
        self.predicted = {name: values for name, _, values, _ in arrays}
        self.half_width = {name: values for name, _, _, values in arrays}

    @property
    def rms(self) -> Dict[str, float]:
        """Root mean square of the errors by output, in its unit."""
        return {name: output["rms"] for name, output in self.report["outputs"].items()}

    @property
    def coverage(self) -> Dict[str, Optional[float]]:
        """Fraction of the errors within the half-widths by output."""
        return {name: output["coverage"] for name, output in self.report["outputs"].items()}

    def to_frame(self) -> Any:
        """The statistics by output as a `pandas.DataFrame`; needs pandas."""
        import pandas

        return pandas.DataFrame.from_dict(self.report["outputs"], orient="index")

    def plot(self) -> Any:
        """Measured and predicted values over time with the half-widths, as a figure of matplotlib; needs matplotlib."""
        from matplotlib import pyplot

        figure, all_axes = pyplot.subplots(len(self.measured), 1, sharex=True, squeeze=False, figsize=(8, 2.5 * len(self.measured)))
        for axes, (name, measured) in zip(all_axes[:, 0], self.measured.items()):
            predicted, width = self.predicted[name], self.half_width[name]
            axes.fill_between(self.time_s, predicted - width, predicted + width, alpha=0.3, linewidth=0)
            axes.plot(self.time_s, predicted, label="predicted")
            axes.plot(self.time_s, measured, color="black", linewidth=0.8, label="measured")
            axes.set_ylabel(name)
        all_axes[0, 0].legend()
        all_axes[-1, 0].set_xlabel("time [s]")
        return figure

    def __repr__(self) -> str:
        errors = ", ".join(f"{name}: RMS {value:.4g}" for name, value in self.rms.items())
        return f"Comparison({self.report['rows']} rows, {self.report['rows_outside']} outside; {errors})"


def compare(model: Model, run: Any, *, follow_s: Optional[float] = None, **channels: Any) -> Comparison:
    """Compares a model with a run, along which it has its past as a twin would. `follow_s`: a learned model gets the offset that measured
    values of at least this time ago suggest.

    >>> channels = dict(time="t", inputs={"pressure_mpa": "p"}, outputs={"angle_deg": "a"})
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> first, second = ({"t": t, "p": p, "a": 600.0 * p} for p in (0.04 + 0.03 * np.sin(0.7 * t), 0.05 + 0.02 * np.sin(0.4 * t)))
    >>> found = compare(learn(first, **channels), second, **channels)
    >>> found.rms["angle_deg"] < 0.3, found.report["rows"]
    (True, 600)
    """
    (recording,) = _recordings(run, channels)
    columns = recording._columns()
    report, arrays = _native.compare(model._native, list(recording.inputs), list(recording.outputs), columns, follow_s)
    return Comparison(json.loads(report), columns[0], arrays)
