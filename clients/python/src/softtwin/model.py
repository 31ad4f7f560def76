"""A model in this process: `softtwin.Model("finger.twin").predict(0.05, 30.0)`, without a daemon.

The answers are bit-identical to those of `softtwin predict`. The library writes them straight into numpy's memory.
"""

import ctypes
import difflib
import os
import weakref
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from .library import ModelInfo, PredictionRow, check, library, open_model
from .prediction import Prediction

_ROW = np.dtype(PredictionRow)
Number = Union[float, npt.ArrayLike]
Nodes = Union[str, Sequence[int], "np.ndarray[Any, Any]"]


@dataclass(frozen=True)
class Input:
    """One input of a model."""

    name: str
    """Name with its unit (`pressure_mpa`, `gap_mm`), or the name of a parameter (`elastomer.law.mu_mpa`)."""
    unit: str
    min: float
    """Smallest training value."""
    max: float
    """Largest training value."""
    value: Optional[float]
    """Default value; None: must be given (pressure), or no obstacle (gap)."""


class Model:
    """A model file, ready to predict. Any number of threads may use one; the interpreter's lock is free meanwhile."""

    def __init__(self, path: "os.PathLike[str] | str") -> None:
        os.stat(path)  # raises FileNotFoundError and the like
        self._attach(open_model(path), None, (os.path.abspath(os.fspath(path)), None, None))

    def __reduce__(self) -> Any:
        """Pickles and copies the path and the selection: the copy opens the file, in whatever process."""
        return _opened, self._origin

    def _attach(self, handle: int, nodes: Optional["np.ndarray[Any, Any]"], origin: Tuple[Any, Any, Any]) -> None:
        self._handle, self._origin = handle, origin
        self._end = weakref.finalize(self, library().softtwin_model_close, handle)
        info = ModelInfo()
        check(library().softtwin_model_describe(handle, ctypes.byref(info)))
        self._info = info
        all_inputs = [info.inputs[at] for at in range(info.input_count)]
        #: Name of the actuator.
        self.actuator: str = info.actuator.decode()
        #: Inputs by name, in order: pressure and gap where the model has them, then parameters.
        self.inputs: Dict[str, Input] = {
            i.name.decode(): Input(i.name.decode(), i.unit.decode(), i.min, i.max, None if np.isnan(i.value) else i.value)
            for at, i in enumerate(all_inputs)
            if at >= 2 or np.isnan(i.value)
        }
        fields = [info.fields[at] for at in range(info.field_count)]
        #: Units of the fields by name, in the order in which they are reconstructed.
        self.fields: Dict[str, str] = {field.name.decode(): field.unit.decode() for field in fields}
        named = [info.observables[at] for at in range(info.observable_count)]
        #: Units of the observables by name, such as a bending angle.
        self.observables: Dict[str, str] = {one.name.decode(): one.unit.decode() for one in named}
        #: Numbers of the nodes that are reconstructed, in order; None: all of the model.
        self.nodes = nodes
        #: Nodes of each field.
        self.node_count: int = info.node_count
        self._position = {i.name.decode(): at for at, i in enumerate(all_inputs)}
        self._by_keyword = {name.replace(".", "_"): name for name in self.inputs}

    def select(self, fields: Optional[Sequence[str]] = None, nodes: Optional[Nodes] = None) -> "Model":
        """The same model with some of its fields on some of its nodes: the name of a node set, or numbers from 0.

        Values of a selection differ from those of the whole by rounding of the interpolation, about 1e-4 mm.
        """
        names = None if fields is None else ",".join(fields).encode()
        out = ctypes.c_void_p()
        chosen: Optional["np.ndarray[Any, Any]"] = None
        if isinstance(nodes, str):
            check(library().softtwin_model_select(self._handle, names, nodes.encode(), None, 0, ctypes.byref(out)))
            chosen = self.node_sets[nodes]
        elif nodes is None:
            check(library().softtwin_model_select(self._handle, names, None, None, 0, ctypes.byref(out)))
        else:
            given = np.asarray(nodes)
            if given.ndim != 1 or not np.issubdtype(given.dtype, np.integer) or given.size == 0 or given.min() < 0:
                raise ValueError(f"nodes: expected a list of numbers from 0, found {nodes!r}")
            chosen = np.ascontiguousarray(given, np.uint32)
            where = chosen.ctypes.data
            check(library().softtwin_model_select(self._handle, names, None, where, chosen.size, ctypes.byref(out)))
        selected = Model.__new__(Model)
        selected._attach(out.value or 0, chosen, (self._origin[0], fields, nodes))
        return selected

    @property
    def node_sets(self) -> Dict[str, "np.ndarray[Any, Any]"]:
        """Numbers of the nodes of each named set."""
        sets = (self._info.node_sets[at] for at in range(self._info.node_set_count))
        return {s.name.decode(): np.ctypeslib.as_array(s.nodes, (s.count,)).copy() for s in sets}

    @property
    def undeformed_mm(self) -> "np.ndarray[Any, Any]":
        """All nodes of the model without pressure, shape (nodes, 3), mm."""
        if not self._info.undeformed_mm[0]:
            raise ValueError("this model file has no undeformed coordinates")
        shape = (self._info.model_node_count,)
        return np.stack([np.ctypeslib.as_array(axis, shape) for axis in self._info.undeformed_mm], axis=1)

    @property
    def triangles(self) -> "np.ndarray[Any, Any]":
        """Triangles of the surface, shape (triangles, 3), as numbers of nodes of the model."""
        if self._info.triangle_count == 0:
            return np.empty((0, 3), np.uint32)
        return np.ctypeslib.as_array(self._info.triangles, (self._info.triangle_count, 3)).copy()

    def triangles_in(self, node_set: str, node_count: int) -> "np.ndarray[Any, Any]":
        """Triangles of the surface as numbers of the nodes of a sample: its node set ("" or "all": all nodes) and its number of nodes.

        Raises `ValueError` if the sample does not contain the surface.
        """
        triangles = self.triangles
        if node_set not in ("", "all"):
            sets = self.node_sets
            if node_set not in sets:
                raise ValueError(f"the model has no node set {node_set!r}; it has {', '.join(sets)}")
            place = np.full(self._info.model_node_count, -1, np.int64)
            place[sets[node_set]] = np.arange(len(sets[node_set]))
            triangles = place[triangles]
            triangles = triangles[(triangles >= 0).all(axis=1)]
        if triangles.size == 0 or triangles.max() >= node_count:
            raise ValueError(f"the {node_count} nodes do not hold the model's surface; is this the model that the twin runs?")
        return triangles

    def predict(
        self,
        pressure_mpa: Optional[Number] = None,
        gap_mm: Optional[Number] = None,
        *,
        fields: bool = True,
        out: Optional["np.ndarray[Any, Any]"] = None,
        **inputs: Number,
    ) -> Prediction:
        """The answer at a pressure (MPa), a gap (mm; infinite or none: no obstacle) and parameters by name; arrays give arrays.

        A parameter's dots are written as underscores (`elastomer_law_mu_mpa=0.6`) or passed by `**{"elastomer.law.mu_mpa": 0.6}`;
        one that is left out has the model's value. Arrays are broadcast against each other; the answer has their shape, its
        fields that shape and (fields, nodes) behind it. `fields=False`: force, gradients and half-widths only. `out`: float32
        memory for the fields, for repeated use.

        Raises `ValueError` for NaN, `TypeError` for inputs that the model does not have, and without a pressure that it has. Outside the
        training states the answer is an extrapolation without half-widths (NaN) and `domain` says so; nothing is clamped. A state farther
        outside than the training states are wide, or of a shape that the body cannot have, is refused.
        """
        names, states = self._states(pressure_mpa, gap_mm, inputs)
        shape = states.shape[:-1]
        rows = np.empty(shape, _ROW)
        values = self._room(shape, out) if fields or out is not None else None
        check(
            library().softtwin_model_predict(
                self._handle, states.ctypes.data, rows.size, rows.ctypes.data, None if values is None else values.ctypes.data
            )
        )
        return self._prediction(names, states, rows, values)

    def _prediction(
        self,
        names: List[str],
        states: "np.ndarray[Any, Any]",
        rows: "np.ndarray[Any, Any]",
        values: Optional["np.ndarray[Any, Any]"],
    ) -> Prediction:
        return Prediction(
            self.inputs, self._position, self.fields, self.observables, names, states, rows, values, self.nodes
        )

    def _states(
        self, pressure_mpa: Optional[Number], gap_mm: Optional[Number], further: Mapping[str, Number]
    ) -> Tuple[List[str], "np.ndarray[Any, Any]"]:
        """Names given, and the states with one more axis: all inputs in order, NaN: default."""
        given: Dict[str, Any] = {} if pressure_mpa is None else {self._name("pressure_mpa"): pressure_mpa}
        if gap_mm is not None:
            given[self._name("gap_mm")] = gap_mm
        elif "gap_mm" in self.inputs:
            given["gap_mm"] = np.inf
        if "pressure_mpa" in self.inputs and "pressure_mpa" not in given:
            raise TypeError("pressure_mpa: expected a pressure, since the model was trained over pressures; found none")
        for name, value in further.items():
            given[self._name(name)] = value
        if all(isinstance(value, (int, float)) for value in given.values()):  # one state: a third of the time of the general case
            states = np.array([given.get(name, np.nan) for name in self._position], np.float64)
        else:
            given = {name: np.asarray(value, np.float64) for name, value in given.items()}
            shape = np.broadcast_shapes(*(value.shape for value in given.values()))
            states = np.full((*shape, len(self._position)), np.nan)
            for name, value in given.items():
                states[..., self._position[name]] = value
        if np.isnan(states).any():
            for name in given:
                if np.isnan(states[..., self._position[name]]).any():
                    raise ValueError(f"{name}: expected numbers, found NaN")
        return list(given), states

    def _name(self, name: str) -> str:
        found = name if name in self.inputs else self._by_keyword.get(name)
        if found is None:
            near = difflib.get_close_matches(name, [*self.inputs, *self._by_keyword], 1)
            hint = f" (did you mean {near[0]!r}?)" if near else ""
            raise TypeError(f"the model has no input {name!r}{hint}; it has {', '.join(self.inputs)}")
        return found

    def _room(self, shape: Tuple[int, ...], out: Optional["np.ndarray[Any, Any]"]) -> "np.ndarray[Any, Any]":
        wanted = (*shape, len(self.fields), self.node_count)
        if out is None:
            return np.empty(wanted, np.float32)
        if out.shape != wanted or out.dtype != np.float32 or not out.flags.c_contiguous or not out.flags.writeable:
            raise ValueError(
                f"out: expected a writable, contiguous float32 array of shape {wanted}, found {out.dtype} of shape {out.shape}"
            )
        return out

    def motion(self) -> "Motion":
        """The model along readings: its memory and its inertia."""
        return Motion(self)

    def mesh(self, pressure_mpa: Optional[float] = None, gap_mm: Optional[float] = None, **inputs: float) -> Any:
        """The deformed surface at one state as a `pyvista.PolyData` with all fields as point data; needs pyvista."""
        try:
            import pyvista
        except ImportError as error:
            raise ImportError("Model.mesh needs pyvista, which is not installed: pip install pyvista") from error
        missing = [axis for axis in "xyz" if axis not in self.fields]
        if self.nodes is not None or missing or self._info.triangle_count == 0:
            raise ValueError(
                "a mesh needs the fields x, y and z on all nodes and the model's surface; this one is a selection, or its file "
                "has no surface"
            )
        given: Dict[str, Any] = dict(inputs)
        found = self.predict(pressure_mpa, gap_mm, **given)
        mesh = pyvista.PolyData.from_regular_faces(np.stack([found[axis] for axis in "xyz"], axis=1), self.triangles)
        for name in self.fields:
            mesh.point_data[name] = found[name]
        return mesh

    def __repr__(self) -> str:
        inputs = ", ".join(f"{i.name} {i.min:g} .. {i.max:g}" for i in self.inputs.values())
        return f"Model({self.actuator}: {inputs}; {', '.join(self.fields)} on {self.node_count} nodes)"


class Motion:
    """A model with inertia or memory along readings, without a daemon; for one thread.

    It begins at equilibrium with the first reading; inputs are straight lines between readings. A static model follows at once.
    """

    def __init__(self, model: Model) -> None:
        out = ctypes.c_void_p()
        check(library().softtwin_motion_open(model._handle, ctypes.byref(out)))
        self._model, self._handle = model, out.value or 0
        self._end = weakref.finalize(self, _close_motion, self._handle, model)

    def step(
        self,
        t_s: float,
        pressure_mpa: Optional[float] = None,
        gap_mm: Optional[float] = None,
        *,
        fields: bool = True,
        out: Optional["np.ndarray[Any, Any]"] = None,
        **inputs: float,
    ) -> Prediction:
        """The answer at a time, s, 0 or more and later than the last one; inputs and fields as in `Model.predict`.

        Raises `ValueError` for a time that is not later; the motion is then unchanged.
        """
        if not 0.0 <= t_s < 1e9:
            raise ValueError(f"t_s: expected a time of 0 to 1e9 s, found {t_s!r}")
        names, state = self._model._states(pressure_mpa, gap_mm, inputs)
        if state.ndim != 1:
            raise TypeError("a step takes one state: expected numbers, found arrays")
        row = np.empty((), _ROW)
        values = self._model._room((), out) if fields or out is not None else None
        where = None if values is None else values.ctypes.data
        t_ns = round(1e9 * t_s)
        check(library().softtwin_motion_step(self._handle, t_ns, state.ctypes.data, row.ctypes.data, where))
        return self._model._prediction(names, state, row, values)

    def reset(self) -> None:
        """Forgets the past: the next reading begins at equilibrium, at any time."""
        library().softtwin_motion_reset(self._handle)


def _close_motion(handle: int, _model: Model) -> None:
    """Closes a motion; its finalizer keeps the model open."""
    library().softtwin_motion_close(handle)


def _opened(path: str, fields: Optional[Sequence[str]], nodes: Optional[Nodes]) -> Model:
    model = Model(path)
    return model if fields is None and nodes is None else model.select(fields, nodes)
