"""Models from finite elements: `train(Database.read("finger/database"))`, or of other people's results as arrays."""

import json
import os
from typing import Any, Callable, Mapping, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from .model import Model

Array = npt.NDArray[Any]


class Database:
    """States of an actuator: displacements, stresses and contact forces at their inputs.

    `points_mm`: undeformed nodes, shape (nodes, 3), y upwards and the base's underside at y = 0. `cells`: node numbers by kind as in
    `meshio.Mesh.cells_dict` ("tetra10", "hexahedron", ...), for the surface; `meshio.Mesh` itself will do for both. `inputs`: columns with one value
    for each state: `pressure_mpa`, `gap_mm` (infinite or left out: no obstacle), further inputs by name with their unit at the end.
    `displacement_mm`: shape (states, nodes, 3). `von_mises_mpa`: shape (states, nodes). `force_n`: contact force of each state; above 0 the state
    counts as contact. `nominal`: value of each further input that a question leaves out; default: the mean of its states.

    Raises `ValueError` with all that does not fit.

    >>> points = np.array([[x, y, z] for x in range(11) for y in (0, 1) for z in (0, 1)], float)
    >>> pressure = np.linspace(0.0, 0.08, 6)
    >>> moved = np.zeros((6, 44, 3))
    >>> moved[:, :, 1] = -np.outer(pressure, points[:, 0] ** 2)
    >>> database = Database(points, inputs={"pressure_mpa": pressure}, displacement_mm=moved)
    >>> database
    Database(6 states, 6 for training, 44 nodes)
    >>> model = train(database)
    >>> float(model.predict(0.05).y[-1] - points[-1, 1]).__round__(2)
    -5.0
    """

    def __init__(
        self,
        points_mm: Any,
        cells: Optional[Mapping[str, Any]] = None,
        *,
        inputs: Any,
        displacement_mm: Any,
        von_mises_mpa: Any = None,
        force_n: Any = None,
        node_sets: Optional[Mapping[str, Any]] = None,
        nominal: Optional[Mapping[str, float]] = None,
        actuator: str = "actuator",
    ) -> None:
        if hasattr(points_mm, "cells_dict"):
            points_mm, cells = points_mm.points, points_mm.cells_dict
        points = np.ascontiguousarray(points_mm, np.float64)
        moved = np.ascontiguousarray(displacement_mm, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points_mm: expected shape (nodes, 3), found {points.shape}")
        if moved.ndim != 3 or moved.shape[1:] != points.shape:
            raise ValueError(f"displacement_mm: expected shape (states, {len(points)}, 3), found {moved.shape}")
        states = len(moved)
        columns = {str(name): np.asarray(inputs[name], np.float64) for name in inputs}
        for name, column in columns.items():
            if np.isnan(column).any():
                raise ValueError(f"inputs: {name}: expected a number for each state, found NaN")
        if "pressure_mpa" not in columns:
            raise ValueError(f"inputs: expected pressure_mpa, found {', '.join(columns)}")
        further = {name: values for name, values in columns.items() if name not in ("pressure_mpa", "gap_mm")}
        gaps = columns.get("gap_mm", np.full(states, np.inf))
        given = np.stack([columns["pressure_mpa"], gaps, *further.values()], axis=1) if states else np.empty((0, 2 + len(further)))
        if given.shape[0] != states:
            raise ValueError(f"inputs: expected {states} values, one for each state, found {given.shape[0]}")
        stress = None if von_mises_mpa is None else np.ascontiguousarray(von_mises_mpa, np.float64)
        if stress is not None and stress.shape != moved.shape[:2]:
            raise ValueError(f"von_mises_mpa: expected shape {moved.shape[:2]}, found {stress.shape}")
        forces = np.zeros(states) if force_n is None else np.ascontiguousarray(force_n, np.float64)
        if forces.shape != (states,):
            raise ValueError(f"force_n: expected {states} values, found shape {forces.shape}")
        values = {name: float((nominal or {}).get(name, np.mean(column))) for name, column in further.items()}
        self._native = _native.Database.of_arrays(
            actuator,
            points,
            [(kind, np.ascontiguousarray(nodes, np.uint32)) for kind, nodes in (cells or {}).items()],
            [(name, np.ascontiguousarray(nodes, np.uint32)) for name, nodes in (node_sets or {}).items()],
            np.ascontiguousarray(given),
            list(values.items()),
            forces,
            moved,
            stress,
            [str(at) for at in range(states)],
        )

    @classmethod
    def read(cls, folder: "os.PathLike[str] | str", obstacle: str = "plate") -> "Database":
        """A database folder, as `softtwin build`, `pack` and `import` make it: the cases with the plate, or those with the `block`."""
        made = cls.__new__(cls)
        made._native = _native.Database.read(os.fspath(folder), obstacle)
        return made

    def __len__(self) -> int:
        return int(self._native.states[1])

    def __repr__(self) -> str:
        training, states = self._native.states
        return f"Database({states} states, {training} for training, {self._native.node_count} nodes)"


def train(
    database: Database,
    *,
    observables: Optional[Mapping[str, Mapping[str, Any]]] = None,
    paper: bool = False,
    progress: Optional[Callable[[str], None]] = None,
) -> Model:
    """A model of a database's training states. `model.report` is its data sheet, `model.errors` has the leave-one-out errors.

    `observables`: as in `[observables]` of train.toml, for example `{"tip_y_mm": {"kind": "position", "points": [[115, 0, 0]], "axis": [0, 1, 0]}}`; default:
    those of the folder. `paper`: the paper's method, for comparison. `progress` is called with the name of each step. Takes seconds for
    some 60 states of 25,000 nodes; Ctrl-C ends it. Raises `ValueError` with everything that is wrong.

    >>> points = np.array([[x, y, z] for x in range(11) for y in (0, 1) for z in (0, 1)], float)
    >>> pressure = np.linspace(0.0, 0.08, 6)
    >>> moved = -np.einsum("i,j,k", pressure, points[:, 0] ** 2, [0.0, 1.0, 0.0])
    >>> steps = []
    >>> model = train(Database(points, inputs={"pressure_mpa": pressure}, displacement_mm=moved), progress=steps.append)
    >>> steps[0], model.errors["free"]["y"]["leave_one_out"] < 0.05
    ('checking the database', True)
    """
    text = None if observables is None else json.dumps(observables)
    native, sheet = database._native.train(text, paper, progress)
    return Model._made(native, json.loads(sheet))
