"""The control law in your loop, without a bus: `softtwin.Control(model, "force_n", "finger.toml")`."""

import ctypes
import math
import os
import weakref
from dataclasses import dataclass
from typing import Optional, Tuple

from .library import ControlCycle, ControlReading, check, library
from .model import Model

_LIMITS = ("force", "range", "rate", "correction", "valve")


@dataclass(frozen=True)
class Cycle:
    """Result of one control cycle."""

    setpoint_mpa: float
    """Pressure for the valve, MPa; NaN: none, because of a fault."""
    target: float
    """The target, cut at the force limit."""
    reference_mpa: float
    """Reference as a pressure in the cavity, MPa."""
    followed: float
    """The held quantity: measured, or the model's."""
    correction_mpa: float
    """The model's error as a pressure, MPa."""
    bias_mpa: float
    """The valve's error, MPa."""
    limited: Tuple[str, ...]
    """Limits that bind: `force`, `range`, `rate`, `correction`, `valve`."""
    fault: Optional[str]
    """Why the valve was let go, such as `no-response`; it stays until `Control.release`."""


class Control:
    """The controller of one quantity: `force_n`, `tip_y_mm`, `pressure_mpa`, `angle_deg`, or an observable of the model; for one thread.

    Of a scene's file it takes control, the driven valve, sigma.force_n, markers and given inputs of the actuator (by default the first one); without
    one the defaults hold. Steps are bit-identical to those of the law in Rust and C.
    """

    def __init__(
        self,
        model: Model,
        held: str,
        scene: "os.PathLike[str] | str | None" = None,
        actuator: Optional[str] = None,
    ) -> None:
        path = None if scene is None else os.fsencode(scene)
        name = None if actuator is None else actuator.encode()
        out = ctypes.c_void_p()
        check(library().softtwin_control_open(model._handle, path, name, held.encode(), ctypes.byref(out)))
        self._model, self._handle = model, out.value or 0
        self._cycle = ControlCycle()
        self._end = weakref.finalize(self, library().softtwin_control_close, self._handle)

    def step(
        self,
        t_ns: int,
        target: float,
        pressure_mpa: float,
        gap_mm: float = 1e4,
        measured: float = math.nan,
        *,
        rate_per_s: float = 0.0,
        written_mpa: float = math.nan,
    ) -> Cycle:
        """One control cycle at a time in ns, later than the last one (after more than 0.1 s it starts again), with gauge, gap (1e4: no obstacle) and measured
        quantity (NaN: none). `rate_per_s`: known change of the target. `written_mpa`: pressure that the valve was last given.

        Raises `ValueError` for a time that is not later and for pressure, gap or target that are not finite; nothing has changed, send no setpoint.
        """
        reading = ControlReading(pressure_mpa, gap_mm, measured, written_mpa)
        found = self._cycle
        step = library().softtwin_control_step
        check(step(self._handle, t_ns, target, rate_per_s, ctypes.byref(reading), ctypes.byref(found)))
        limited = tuple(name for at, name in enumerate(_LIMITS) if found.limited >> at & 1)
        fault = library().softtwin_control_fault_name(found.fault).decode() if found.fault else None
        return Cycle(
            found.setpoint_mpa,
            found.target,
            found.reference_mpa,
            found.followed,
            found.correction_mpa,
            found.bias_mpa,
            limited,
            fault,
        )

    def start(self, pressure_mpa: float, gap_mm: float = 1e4, measured: float = math.nan) -> None:
        """Begins again where the actuator is, for each cycle in which the valve does not follow the setpoint."""
        reading = ControlReading(pressure_mpa, gap_mm, measured, math.nan)
        check(library().softtwin_control_start(self._handle, ctypes.byref(reading)))

    def release(self) -> None:
        """Releases a fault: the next cycle begins the control again."""
        library().softtwin_control_release(self._handle)

    def inputs(self, **inputs: float) -> None:
        """Sets inputs of the model by name for the cycles that follow; one that is left out has the model's value, `pressure_mpa` beside a driven
        cavity the one before, at first its lowest.

        Raises `ValueError` for the gap and the driven pressure, which are those of each step.
        """
        given = {self._model._name(name): value for name, value in inputs.items()}
        values = [given.get(name, math.nan) for name in self._model._position]
        check(library().softtwin_control_inputs(self._handle, (ctypes.c_double * len(values))(*values), len(values)))
