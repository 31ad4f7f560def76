"""Finite elements: `Actuator.read("finger/actuator.toml").simulate(0.03, 40.0)`."""

import os
from typing import Any, Dict, Optional, Tuple

import numpy as np
import numpy.typing as npt

from . import _native

Array = npt.NDArray[Any]


class SimulatedState:
    """An equilibrium of an actuator, as the finite elements have it.

    Arrays over the nodes: `coordinates_mm` (nodes, 3), `displacement_mm` (its length), `von_mises_mpa`; `contact_nodes` are those that touch. Numbers:
    `contact_force_n`, `cavity_volume_mm3`, `injected_mm3`, `residual_n` (largest nodal force out of balance), `largest_stretch`, and
    `beyond_law_percent` (volume that is stretched beyond the tests of the silicone).
    """

    coordinates_mm: Array
    displacement_mm: Array
    von_mises_mpa: Array
    contact_nodes: Array
    contact_force_n: float
    cavity_volume_mm3: float
    injected_mm3: float
    residual_n: float
    largest_stretch: float
    beyond_law_percent: float

    def __init__(self, actuator: "Actuator", pressure_mpa: float, gap_mm: Optional[float], found: Dict[str, Any]) -> None:
        self.actuator, self.pressure_mpa, self.gap_mm = actuator, pressure_mpa, gap_mm
        self.__dict__.update(found)

    @property
    def mesh(self) -> Any:
        """The deformed body with its fields as a `pyvista.UnstructuredGrid`; needs pyvista."""
        try:
            import pyvista
        except ImportError as error:
            raise ImportError("SimulatedState.mesh needs pyvista, which is not installed: pip install pyvista") from error
        grid = pyvista.UnstructuredGrid({pyvista.CellType.QUADRATIC_TETRA: self.actuator.cells}, self.coordinates_mm)
        grid.point_data["displacement"] = self.displacement_mm
        grid.point_data["von_mises"] = self.von_mises_mpa
        return grid

    def __repr__(self) -> str:
        return f"SimulatedState({self.pressure_mpa} MPa, gap {self.gap_mm}, force {self.contact_force_n:.4g} N, residual {self.residual_n:.2g} N)"


class Actuator:
    """An actuator file with its mesh: what `softtwin new` and `softtwin mesh` make, or your own (docs/your-actuator.md)."""

    def __init__(self, native: Any) -> None:
        self._native = native
        #: Undeformed nodes, shape (nodes, 3), mm.
        self.points_mm: Array = native.points_mm
        #: Nodes of the tetrahedra of ten nodes, shape (cells, 10).
        self.cells: Array = native.cells
        self._simulation: Optional[Tuple[Tuple[Tuple[str, float], ...], Any]] = None

    @classmethod
    def read(cls, path: "os.PathLike[str] | str") -> "Actuator":
        """The actuator of a file, whose mesh has been made."""
        os.stat(path)  # raises FileNotFoundError and the like
        return cls(_native.Actuator.read(os.fspath(path)))

    def simulate(self, pressure_mpa: float, gap_mm: Optional[float] = None, **quantities: float) -> SimulatedState:
        """The state at a pressure (MPa) and a gap to the plate (mm; None: no obstacle).

        `quantities` are other values than the file's by their dotted keys: `**{"elastomer.law.mu_mpa": 0.7}`. Each state is sought from the one before,
        so that a series of near ones is fast. Takes seconds to a minute. Raises `ValueError` for a load that the actuator does not reach.
        """
        given = tuple(sorted((name, float(value)) for name, value in quantities.items()))
        if self._simulation is None or self._simulation[0] != given:
            self._simulation = (given, self._native.simulation(list(given)))
        gap = None if gap_mm is None or np.isinf(gap_mm) else float(gap_mm)
        return SimulatedState(self, pressure_mpa, gap, self._simulation[1].solve(float(pressure_mpa), gap))

    def __repr__(self) -> str:
        return f"Actuator({len(self.points_mm)} nodes, {len(self.cells)} cells)"
