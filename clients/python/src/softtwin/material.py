"""Laws of silicones from their tests: `fit_material(MaterialTest(strip, strain="eps", stress=("sigma", "kPa")))`."""

import json
import os
import re
from typing import Any, Dict, List, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _native
from .recording import Column, column_of

Array = npt.NDArray[Any]


class MaterialTest:
    """A test of a specimen: a table in memory with columns by name, or the path of a file.

    One keyword names the column of the deformation: `strain`, `true_strain`, `stretch` (1 at rest), `displacement` or `length`; one that of the
    load: `stress` (nominal), `true_stress` or `force`. A column's own unit is in its heading or given beside it, as in `("sigma", "kPa")`. Of a
    file both may be left out, where its headings tell. `kind`: `uniaxial`, `planar` (pure shear), `biaxial` or `compression`; None: by the
    name, else uniaxial. `displacement` and `length` need `length_mm`, `force` needs `area_mm2`, both of the undeformed specimen.
    `branch="last"` takes the loading of the last cycle, `origin="slack"` or `"load"` removes slack or an offset of the load, `shape_only` says that
    the specimen has another modulus than the part.

    >>> strain = np.linspace(0.0, 1.0, 20)
    >>> stretch = 1.0 + strain
    >>> table = {"strain": strain, "stress_kpa": 80.0 * (stretch - stretch**-2)}
    >>> MaterialTest(table, strain="strain", stress="stress_kpa")
    MaterialTest(test, 20 rows)
    """

    __test__ = False  # pytest takes classes of such names for tests

    def __init__(
        self,
        table: Any,
        kind: Optional[str] = None,
        *,
        strain: Optional[Column] = None,
        true_strain: Optional[Column] = None,
        stretch: Optional[Column] = None,
        displacement: Optional[Column] = None,
        length: Optional[Column] = None,
        stress: Optional[Column] = None,
        true_stress: Optional[Column] = None,
        force: Optional[Column] = None,
        length_mm: Optional[float] = None,
        area_mm2: Optional[float] = None,
        branch: str = "first",
        origin: str = "table",
        weight: float = 1.0,
        shape_only: bool = False,
        name: str = "test",
    ) -> None:
        deformations = {"strain": strain, "true-strain": true_strain, "stretch": stretch, "displacement": displacement, "length": length}
        loads = {"nominal-stress": stress, "true-stress": true_stress, "force": force}
        self.name = os.fspath(table) if isinstance(table, (str, os.PathLike)) else name
        self._columns: Optional[List[Tuple[str, Array]]] = None
        description: Dict[str, Any] = {"file": self.name, "test": kind, "weight": weight, "shape_only": shape_only}
        description.update(length_mm=length_mm, area_mm2=area_mm2, branch=branch, origin=origin)
        for what, columns in (("deformation", deformations), ("load", loads)):
            given = {quantity: column for quantity, column in columns.items() if column is not None}
            if len(given) > 1 or not (given or self._is_file(table)):
                words = ", ".join(word.replace("-", "_") for word in columns).replace("nominal_stress", "stress")
                raise ValueError(f"{what}: expected one of {words}, found {len(given)}")
            for quantity, column in given.items():
                heading, unit = (column, None) if isinstance(column, str) else column
                description[what] = {"column": heading, "quantity": quantity, "unit": unit}
                if not self._is_file(table):
                    self._columns = [*(self._columns or []), (heading, column_of(table, what, heading))]
        if self._columns is not None and len({len(values) for _, values in self._columns}) > 1:
            raise ValueError(f"{self.name}: expected as many loads as deformations, found {[len(values) for _, values in self._columns]}")
        self._description = json.dumps(description)

    @staticmethod
    def _is_file(table: Any) -> bool:
        return isinstance(table, (str, os.PathLike))

    def __repr__(self) -> str:
        rows = "" if self._columns is None else f", {len(self._columns[0][1])} rows"
        return f"MaterialTest({self.name}{rows})"


class Material:
    """The law of a silicone. `report` is what `softtwin material fit --json` prints."""

    def __init__(self, native: Any) -> None:
        self._native = native
        self.report: Dict[str, Any] = json.loads(native.report())

    @property
    def law(self) -> str:
        """Name of the law: `neo-hookean`, `mooney-rivlin`, `gent`, `yeoh` or `ogden`."""
        return str(self.report["law"])

    @property
    def constants(self) -> Dict[str, float]:
        """Constants of the law by name, with their unit at the end."""
        return dict(self.report["constants"])

    @property
    def half_widths(self) -> Dict[str, Optional[float]]:
        """Half-widths of the constants' 95 % intervals; None where the tests leave a constant open."""
        return dict(self.report["half_widths_95"])

    def stress_mpa(self, stretch: Any, kind: str = "uniaxial") -> Any:
        """Nominal stress (MPa) of the law at stretches (1 at rest), in the shape of `stretch`; NaN where it has none."""
        given = np.asarray(stretch, np.float64)
        found = self._native.stress_mpa(kind, given.reshape(-1)).reshape(given.shape)
        return found if given.ndim else float(found)

    def save(self, path: "os.PathLike[str] | str", density_g_per_cm3: float = 1.07) -> None:
        """Writes a material file, which `[elastomer] file` of an actuator.toml and `Actuator.new(material=...)` take."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(self._text(density_g_per_cm3))

    def _text(self, density_g_per_cm3: float = 1.07) -> str:
        return str(self._native.text(1e-9 * density_g_per_cm3))

    def plot(self) -> Any:
        """Tests and law, nominal stress over stretch, as a figure of matplotlib; needs matplotlib."""
        from matplotlib import pyplot

        figure, axes = pyplot.subplots()
        for name, kind, stretches, stresses in self._native.tests:
            (line,) = axes.plot(stretches, stresses, ".", markersize=3, label=f"{name} ({kind})")
            along = np.linspace(min(1.0, stretches.min()), max(1.0, stretches.max()), 200)
            axes.plot(along, self.stress_mpa(along, kind), color=line.get_color())
        axes.set_xlabel("stretch")
        axes.set_ylabel("nominal stress [MPa]")
        axes.legend()
        return figure

    def __repr__(self) -> str:
        constants = ", ".join(f"{name} {value:.4g}" for name, value in self.constants.items())
        return f"Material({self.law}: {constants}; RMS {self.report['rms_percent']:.2g} % of the largest stress)"


def fit_material(
    tests: Union[MaterialTest, str, "os.PathLike[str]", List[Any]],
    *,
    law: Optional[str] = None,
    max_strain: float = 3.0,
    working_weight: float = 0.2,
) -> Material:
    """Fits a silicone's law to one test or several: `MaterialTest`, or paths of tables and of lists of them (.toml).

    `law`: `neo-hookean`, `mooney-rivlin`, `gent`, `yeoh` or `ogden`; None: the one that, fitted to smaller strains, predicts the larger ones best.
    Strains above `max_strain` are left out. `working_weight`: how much the error at strains of 2 to 30 %, relative to the stress there, counts
    beside that relative to the largest stress. Takes about 0.2 s a test. Raises `ValueError` for tests that cannot be read or that no law explains.

    >>> strain = np.linspace(0.0, 1.0, 20)
    >>> table = {"strain": strain, "stress_kpa": 80.0 * ((1 + strain) - (1 + strain) ** -2)}
    >>> law = fit_material(MaterialTest(table, strain="strain", stress="stress_kpa"), law="neo-hookean")
    >>> round(law.constants["mu_mpa"], 4)
    0.08
    """
    given = list(tests) if isinstance(tests, (list, tuple)) else [tests]
    known = [test if isinstance(test, MaterialTest) else MaterialTest(test) for test in given]
    native = [(test._description, test._columns) for test in known]
    return Material(_native.fit_material(native, law, float(max_strain), float(working_weight)))
