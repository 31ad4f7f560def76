"""The control law in your loop, without a bus: `softtwin.Control(model, "force_n", "finger.toml")`."""

import math
import os
import pathlib
from dataclasses import dataclass
from typing import Iterable, Optional, Sequence, Tuple, Union

from .model import Model


@dataclass(frozen=True)
class Cycle:
    """Result of one control cycle."""

    setpoint_mpa: float
    """Pressure for the valve, MPa; NaN: none, because of a fault."""
    target: float
    """The target, cut at the force limit and at what a low supply gives."""
    reference_mpa: float
    """Reference as a pressure in the cavity, MPa."""
    followed: float
    """The held quantity: measured, or the model's."""
    correction_mpa: float
    """The model's error as a pressure, MPa."""
    bias_mpa: float
    """The valve's error, MPa."""
    limited: Tuple[str, ...]
    """Limits that bind: `force`, `range`, `rate`, `correction`, `valve`, `supply`."""
    is_limited: bool
    """The target cannot be reached: any of these but `rate`."""
    is_fallback: bool
    """The predictive law had no plan, or its commands oscillate: the setpoint is that of the first law."""
    is_oscillating: bool
    """The setpoints have swung to and fro although the target did not: line, delay or play of the settings are wrong."""
    fault: Optional[str]
    """Why the valve was let go, such as `no-response`; it stays until `Control.release`."""


class Control:
    """The controller of one quantity: `force_n`, `tip_y_mm`, `pressure_mpa`, `angle_deg`, or an observable of the model; for one thread.

    Of a scene's file it takes control, the driven valve, sigma.force_n, markers and given inputs of the actuator (by default the first one); without
    one the defaults hold. Steps are bit-identical to those of the law in Rust and C.

    >>> from softtwin import shared_file
    >>> control = Control(Model(shared_file("models/pneunet/pneunet.twin")), "force_n")
    >>> cycles = [control.step(10_000_000 * at, 0.3, 0.01, 30.0) for at in range(1, 20)]
    >>> cycles[-1].setpoint_mpa > 0.01, cycles[-1].fault
    (True, None)
    """

    def __init__(
        self,
        model: Model,
        held: str,
        scene: "os.PathLike[str] | str | None" = None,
        actuator: Optional[str] = None,
    ) -> None:
        text = None if scene is None else pathlib.Path(scene).read_text()
        self._model, self._native = model, model._native.control(held, text, actuator)

    def step(
        self,
        t_ns: int,
        target: "Union[float, Sequence[float]]",
        pressure_mpa: float,
        gap_mm: float = 1e4,
        measured: float = math.nan,
        *,
        rate_per_s: float = 0.0,
        interval_s: float = math.nan,
        written_mpa: float = math.nan,
    ) -> Cycle:
        """One control cycle at a time in ns, later than the last one (after more than 0.1 s it starts again), with gauge, gap (1e4: no obstacle) and measured
        quantity (NaN: none). `rate_per_s`: known change of the target; or `target` is a series of values that are known ahead, the first for now, each `interval_s`
        after the one before, the last of which stays. `written_mpa`: pressure that the valve was last given.

        Raises `ValueError` for a time that is not later and for pressure, gap or target that are not finite; nothing has changed, send no setpoint.
        """
        reading = [pressure_mpa, gap_mm, measured, written_mpa]
        if not isinstance(target, Iterable):
            numbers, limited, marks, fault = self._native.step(t_ns, [target, rate_per_s], reading)
        else:
            numbers, limited, marks, fault = self._native.step_ahead(t_ns, [float(value) for value in target], interval_s, reading)
        in_order = [*numbers, tuple(limited), *marks, fault]
        return Cycle(*in_order)

    def start(self, pressure_mpa: float, gap_mm: float = 1e4, measured: float = math.nan) -> None:
        """Begins again where the actuator is, for each cycle in which the valve does not follow the setpoint."""
        self._native.start(pressure_mpa, gap_mm, measured)

    def release(self) -> None:
        """Releases a fault: the next cycle begins the control again."""
        self._native.release()

    def inputs(self, **inputs: float) -> None:
        """Sets inputs of the model by name for the cycles that follow; one that is left out has the model's value, `pressure_mpa` beside a driven
        cavity the one before, at first its lowest.

        Raises `ValueError` for the gap and the driven pressure, which are those of each step.
        """
        given = {self._model._name(name): value for name, value in inputs.items()}
        values = [given.get(name, math.nan) for name in self._model._position]
        self._native.set_inputs(values)
