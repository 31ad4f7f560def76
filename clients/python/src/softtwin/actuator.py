"""Finite elements: `Actuator.read("finger/actuator.toml").simulate(0.03, 40.0)`."""

import json
import os
from typing import Any, Callable, Dict, Optional, Tuple

import numpy as np
import numpy.typing as npt

from . import _native
from .material import Material
from .model import Model

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
    """An actuator file with its mesh: what `new` makes, or your own (docs/your-actuator.md).

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     finger = Actuator.new(os.path.join(folder, "finger"), chambers=2, length_mm=30.0, width_mm=10.0, shear_modulus_mpa=0.2)
    >>> finger.report["sag_mm"] < 0.2
    True
    >>> found = finger.simulate(pressure_mpa=0.005)
    >>> bool(found.displacement_mm.max() > 0.1), found.residual_n < 1e-4
    (True, True)
    """

    def __init__(self, native: Any, path: str) -> None:
        self._native, self._folder = native, os.path.dirname(path)
        #: What `softtwin new` prints, of an actuator that was made in this process.
        self.report: Optional[Dict[str, Any]] = None
        #: Undeformed nodes, shape (nodes, 3), mm.
        self.points_mm: Array = native.points_mm
        #: Nodes of the tetrahedra of ten nodes, shape (cells, 10).
        self.cells: Array = native.cells
        self._simulation: Optional[Tuple[Tuple[Tuple[str, float], ...], Any]] = None

    @classmethod
    def read(cls, path: "os.PathLike[str] | str") -> "Actuator":
        """The actuator of a file, whose mesh has been made."""
        os.stat(path)  # raises FileNotFoundError and the like
        return cls(_native.Actuator.read(os.fspath(path)), os.path.abspath(os.fspath(path)))

    @classmethod
    def new(
        cls,
        folder: "os.PathLike[str] | str",
        *,
        name: Optional[str] = None,
        mesh: "Optional[os.PathLike[str] | str]" = None,
        fixed: str = "clamp",
        chambers: int = 11,
        length_mm: Optional[float] = None,
        width_mm: float = 20.0,
        wall_mm: float = 2.5,
        hanging: bool = False,
        silicone: str = "reference",
        material: Optional[Material] = None,
        shear_modulus_mpa: Optional[float] = None,
        shore_a: Optional[float] = None,
        shore_00: Optional[float] = None,
        modulus_100_mpa: Optional[float] = None,
        elongation_percent: Optional[float] = None,
    ) -> "Actuator":
        """A new actuator, as `softtwin new` makes it: a folder with an actuator.toml, whose comments explain every key, and its mesh. Change the
        file, and `Actuator.read` it again.

        `mesh`: a mesh file with named surfaces, such as gmsh's .msh with physical groups (docs/own-mesh.md); it is copied, and held at the
        surface `fixed`. Without it, a finger in the proportions of the reference actuator. `length_mm`: the whole length (None: 9 mm a
        chamber). `width_mm`: of the block of chambers; the base is 1.6 times as wide. `wall_mm`: between cavity and slot. `hanging`
        mounts it vertically.

        The silicone is one of `silicone` (a name of `softtwin new --help`), `material` (of `fit_material`), `shear_modulus_mpa`, or a data sheet's
        `shore_a`, `shore_00` or `modulus_100_mpa`, with the elongation at break in `elongation_percent`.
        Raises `ValueError` for a folder with files and for a shape that cannot be built.
        """
        sheet = {"shore_a": shore_a, "shore_00": shore_00, "modulus_100_mpa": modulus_100_mpa}
        hardness = [(figure, float(value)) for figure, value in sheet.items() if value is not None]
        given = len(hardness) + (material is not None) + (shear_modulus_mpa is not None) + (silicone != "reference")
        if given > 1:
            raise ValueError(f"expected one of silicone, material, shear_modulus_mpa, {', '.join(sheet)}, found {given}")
        folder = os.path.abspath(os.fspath(folder))
        text = None if material is None else material._text()
        named = os.path.basename(folder) if name is None else name
        report = _native.new_actuator(
            folder,
            named,
            None if mesh is None else (os.fspath(mesh), fixed),
            chambers,
            length_mm,
            float(width_mm),
            float(wall_mm),
            hanging,
            silicone,
            text,
            shear_modulus_mpa,
            hardness[0] if hardness else None,
            elongation_percent,
        )
        made = cls.read(os.path.join(folder, "actuator.toml"))
        made.report = json.loads(report)
        return made

    def build(
        self,
        *,
        quick: bool = False,
        size_mm: Optional[float] = None,
        threads: int = 2,
        progress: Optional[Callable[[str], None]] = None,
    ) -> Model:
        """The model of the actuator, as `softtwin build` makes it in the actuator's folder: pressures that suit it, free and touching states,
        training, errors on states that it was not trained on, and a scene for `softtwind`. `model.report` is what `softtwin build --json` prints.

        Takes minutes with `quick` and up to hours without; `progress=print` shows what is being done. Solved states are kept: interrupted and
        called again it continues. `size_mm`: longest edge of an element. `threads`: states solved at the same time, about 1 GB each on
        a fine mesh. Raises `ValueError` for an actuator that cannot be built or solved, with what to change.
        """
        report = json.loads(_native.build(self._folder, quick, size_mm, threads, progress))
        model = Model(report["model"])
        model.report = report
        return model

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
