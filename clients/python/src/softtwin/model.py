"""A model in this process: `softtwin.Model("finger.twin").predict(0.05, 30.0)`, without a daemon.

The answers are bit-identical to those of `softtwin predict`, and are written straight into numpy's memory.
"""

import difflib
import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _native
from .files import shared_file
from .prediction import Prediction

if TYPE_CHECKING:
    from .differentiable import Differentiable

_NO_VALUES = np.empty(0, np.float32)
Number = Union[float, npt.ArrayLike]
Nodes = Union[str, Sequence[int], "np.ndarray[Any, Any]"]


@dataclass(frozen=True)
class Input:
    """One input of a model.

    >>> given = Model(shared_file("models/pneunet/pneunet.twin")).inputs["pressure_mpa"]
    >>> given.unit, given.min <= 0.05 <= given.max
    ('MPa', True)
    """

    name: str
    """Name with its unit (`pressure_mpa`, `gap_mm`), or the name of a parameter (`elastomer.law.mu_mpa`)."""
    unit: str
    min: float
    """Smallest training value."""
    max: float
    """Largest training value."""
    value: Optional[float]
    """Default value; None: must be given (pressure), or no obstacle (gap)."""


class _Origin(NamedTuple):
    """From what a model was made: its file, none if it was made in this process, and what was selected of it."""

    path: Optional[str] = None
    fields: Optional[Sequence[str]] = None
    nodes: Optional[Nodes] = None


class Model:
    """A model file, ready to predict. Any number of threads may use one; the interpreter's lock is free meanwhile.

    >>> model = Model(shared_file("models/pneunet/pneunet.twin"))
    >>> list(model.inputs), list(model.fields)
    (['pressure_mpa', 'gap_mm'], ['x', 'y', 'z', 'displacement', 'von_mises'])
    >>> model.predict(0.05, 30.0).regime
    'contact'
    """

    _origin: _Origin

    def __init__(self, path: "os.PathLike[str] | str") -> None:
        os.stat(path)  # raises FileNotFoundError and the like
        self._attach(_native.Model(os.fspath(path)), None, _Origin(os.path.abspath(os.fspath(path))))

    @classmethod
    def _made(cls, native: Any, report: Dict[str, Any]) -> "Model":
        made = cls.__new__(cls)
        made._attach(native, None, _Origin())
        made.report = report
        return made

    @property
    def errors(self) -> Dict[str, Dict[str, Dict[str, float]]]:
        """Leave-one-out and truncation errors by regime and group of fields, in the field's unit: of a model that was trained in this process, or
        of a file with its data sheet beside it."""
        found: Dict[str, Dict[str, Dict[str, float]]] = {}
        sheet = self.report or {}
        beside = os.path.splitext(self._origin.path or "")[0] + ".json"
        if "regimes" not in sheet and os.path.isfile(beside):
            with open(beside, encoding="utf-8") as file:
                sheet = json.load(file)
        for regime in sheet.get("regimes", []):
            fits = [*regime["groups"], *([regime["force"]] if regime.get("force") else [])]
            numbers = ("modes", "leave_one_out", "truncation_error")
            found[regime["kind"].lower()] = {fit["name"]: {name: fit[name] for name in numbers} for fit in fits}
        return found

    def save(self, path: "os.PathLike[str] | str") -> None:
        """Writes the model file, without a selection of fields and nodes. A file that is there is replaced at once or not at all."""
        path = os.path.abspath(os.fspath(path))
        beside = f"{path}.{os.getpid()}"
        with open(beside, "wb") as file:
            file.write(self._native.to_bytes())
        os.replace(beside, path)
        if self._origin.path is None:
            self._origin = self._origin._replace(path=path)

    def compare(self, run: Any, *, follow_s: Optional[float] = None, **channels: Any) -> Any:
        """How far the model is from a run of a bench, as `softtwin.compare`."""
        from .recording import compare  # that module learns models, so it imports this one

        return compare(self, run, follow_s=follow_s, **channels)

    def __reduce__(self) -> Any:
        """Pickles and copies the path and the selection: the copy opens the file, in whatever process. A model without a file, its bytes."""
        if self._origin.path is None:
            return _from_bytes, (self._native.to_bytes(), self.report, self._origin.fields, self._origin.nodes)
        return _opened, tuple(self._origin)

    def _attach(self, native: Any, nodes: Optional["np.ndarray[Any, Any]"], origin: _Origin) -> None:
        self._native: Any = native
        self._origin = origin
        #: What training or learning told, of a model that was made in this process.
        self.report: Optional[Dict[str, Any]] = None
        #: Name of the actuator.
        self.actuator: str = native.actuator
        all_inputs = native.inputs
        #: Inputs by name, in order: pressure and gap where the model has them, then parameters.
        self.inputs: Dict[str, Input] = {given[0]: Input(*given) for given in all_inputs if given is not None}
        #: Units of the fields by name, in the order in which they are reconstructed.
        self.fields: Dict[str, str] = dict(native.fields)
        #: Units of the observables by name, such as a bending angle.
        self.observables: Dict[str, str] = dict(native.observables)
        #: Units of the measured outputs by name, of a model that was learned from runs.
        self.outputs: Dict[str, str] = dict(native.outputs)
        #: Numbers of the nodes that are reconstructed, in order; None: all of the model.
        self.nodes = nodes
        #: Nodes of each field.
        self.node_count: int = native.node_count
        #: Units of the numbers of a prediction by name.
        self.columns: Dict[str, str] = dict(native.columns)
        self._width = len(all_inputs)
        self._position = {given[0]: at for at, given in enumerate(all_inputs) if given is not None}
        self._column = {name: at for at, name in enumerate(self.columns)}
        self._by_keyword = {name.replace(".", "_"): name for name in self.inputs}

    def select(self, fields: Optional[Sequence[str]] = None, nodes: Optional[Nodes] = None) -> "Model":
        """The same model with some of its fields on some of its nodes: the name of a node set, or numbers from 0.

        Values of a selection differ from those of the whole by rounding of the interpolation, about 1e-4 mm.
        """
        chosen: Optional["np.ndarray[Any, Any]"] = None
        if isinstance(nodes, str):
            native = self._native.select(fields, nodes, None)
            chosen = self.node_sets[nodes]
        elif nodes is None:
            native = self._native.select(fields, None, None)
        else:
            given = np.asarray(nodes)
            if given.ndim != 1 or not np.issubdtype(given.dtype, np.integer) or given.size == 0 or given.min() < 0:
                raise ValueError(f"nodes: expected a list of numbers from 0, found {nodes!r}")
            chosen = np.ascontiguousarray(given, np.uint32)
            native = self._native.select(fields, None, chosen)
        selected = Model.__new__(Model)
        selected._attach(native, chosen, _Origin(self._origin.path, fields, nodes))
        selected.report = self.report
        return selected

    @property
    def node_sets(self) -> Dict[str, "np.ndarray[Any, Any]"]:
        """Numbers of the nodes of each named set."""
        return dict(self._native.node_sets)

    @property
    def undeformed_mm(self) -> "np.ndarray[Any, Any]":
        """All nodes of the model without pressure, shape (nodes, 3), mm."""
        found: "Optional[np.ndarray[Any, Any]]" = self._native.undeformed_mm
        if found is None:
            raise ValueError("this model file has no undeformed coordinates")
        return found.T

    @property
    def triangles(self) -> "np.ndarray[Any, Any]":
        """Triangles of the surface, shape (triangles, 3), as numbers of nodes of the model."""
        found: "np.ndarray[Any, Any]" = self._native.triangles
        return found

    def triangles_in(self, node_set: str, node_count: int) -> "np.ndarray[Any, Any]":
        """Triangles of the surface as numbers of the nodes of a sample: its node set ("" or "all": all nodes) and its number of nodes.

        Raises `ValueError` if the sample does not contain the surface.
        """
        triangles = self.triangles
        if node_set not in ("", "all"):
            sets = self.node_sets
            if node_set not in sets:
                raise ValueError(f"the model has no node set {node_set!r}; it has {', '.join(sets)}")
            place = np.full(self._native.model_node_count, -1, np.int64)
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
        observables: bool = True,
        out: Optional["np.ndarray[Any, Any]"] = None,
        **inputs: Number,
    ) -> Prediction:
        """The answer at a pressure (MPa), a gap (mm; infinite or none: no obstacle) and parameters by name; arrays give arrays.

        A parameter's dots are written as underscores (`elastomer_law_mu_mpa=0.6`) or passed by `**{"elastomer.law.mu_mpa": 0.6}`;
        one that is left out has the model's value. Arrays are broadcast against each other; the answer has their shape, its
        fields that shape and (fields, nodes) behind it. `fields=False`: force, gradients, half-widths and observables only; with
        `observables=False` these are NaN, at a tenth of the cost. `out`: float32 memory for the fields, for repeated use.

        Raises `ValueError` for NaN, `TypeError` for inputs that the model does not have, and without a pressure that it has. Outside the
        training states the answer is an extrapolation without half-widths (NaN) and `domain` says so; nothing is clamped. A state farther
        outside than the training states are wide, or of a shape that the body cannot have, is refused.

        >>> found = Model(shared_file("models/pneunet/pneunet.twin")).predict(np.linspace(0.0, 0.09, 5)[:, None], [20.0, 30.0], fields=False)
        >>> found.contact_force_n.shape, bool(found.in_domain.all())
        ((5, 2), True)
        """
        wants_fields = fields or out is not None
        if out is None or out.ndim == 2:
            values = self._room((), out) if wants_fields else None
            one = self._native.predict_one(pressure_mpa, gap_mm, inputs, observables, _NO_VALUES if values is None else values)
            if one is not None:
                return Prediction(self, one[0], one[1], values)
        states = self._states(pressure_mpa, gap_mm, inputs)
        shape = states.shape[:-1]
        rows = np.empty((*shape, len(self.columns)))
        values = self._room(shape, out) if wants_fields else None
        flat = _NO_VALUES if values is None else values.reshape(-1)
        self._native.predict(states.reshape(-1, self._width), observables, rows.reshape(-1, len(self.columns)), flat)
        return Prediction(self, states, rows, values)

    def _states(
        self, pressure_mpa: Optional[Number], gap_mm: Optional[Number], further: Mapping[str, Number]
    ) -> "np.ndarray[Any, Any]":
        """The states with one more axis: all inputs in order, NaN: default."""
        given: Dict[str, Any] = {} if pressure_mpa is None else {self._name("pressure_mpa"): pressure_mpa}
        if gap_mm is not None:
            given[self._name("gap_mm")] = gap_mm
        elif "gap_mm" in self.inputs:
            given["gap_mm"] = np.inf
        if "pressure_mpa" in self.inputs and "pressure_mpa" not in given:
            raise TypeError("pressure_mpa: expected a pressure, since the model was trained over pressures; found none")
        for name, value in further.items():
            given[self._name(name)] = value
        given = {name: np.asarray(value, np.float64) for name, value in given.items()}
        shape = np.broadcast_shapes(*(value.shape for value in given.values()))
        states = np.full((*shape, self._width), np.nan)
        for name, value in given.items():
            if np.isnan(value).any():
                raise ValueError(f"{name}: expected numbers, found NaN")
            states[..., self._position[name]] = value
        return states

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

    def session(self) -> "Session":
        """The model with a past: its memory and its inertia along readings."""
        return Session(self)

    def jax(self, *, fields: bool = True, play_width: float = 0.0) -> "Differentiable":
        """The model as a pure function of jax arrays, with derivatives; needs jax. `fields=False`: numbers and observables only.

        `play_width`: loops of a session turn within this range of their input (in its unit) instead of at a corner, so that derivatives are continuous.
        """
        from .differentiable import Differentiable

        return Differentiable(self, fields, play_width)

    def to_onnx(self, path: "os.PathLike[str] | str", *, fields: bool = True) -> None:
        """Writes the model as an ONNX graph of 64 bits: a vector of states by input, answers with the names of `columns` and `fields`; needs onnx."""
        from .onnx_graph import to_onnx

        to_onnx(self, os.fspath(path), fields)

    def mesh(self, pressure_mpa: Optional[float] = None, gap_mm: Optional[float] = None, **inputs: float) -> Any:
        """The deformed surface at one state as a `pyvista.PolyData` with all fields as point data; needs pyvista."""
        try:
            import pyvista
        except ImportError as error:
            raise ImportError("Model.mesh needs pyvista, which is not installed: pip install pyvista") from error
        missing = [axis for axis in "xyz" if axis not in self.fields]
        if self.nodes is not None or missing or not len(self.triangles):
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


class Session:
    """A model along readings, without a daemon: its memory and its inertia.

    It begins at equilibrium with the first reading; inputs are straight lines between readings. A static model follows at once.

    >>> session = Model(shared_file("models/pneunet/pneunet.twin")).session()
    >>> forces = [session.step(0.01 * at, 0.001 * at, 30.0, fields=False).contact_force_n for at in range(60)]
    >>> forces[0], forces[-1] > 0.0
    (0.0, True)
    """

    def __init__(self, model: Model) -> None:
        self._model, self._native = model, model._native.session()

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

        Raises `ValueError` for a time that is not later; the session is then unchanged. It also does where the model has no answer at
        this state: the session has then reached it.
        """
        if not 0.0 <= t_s < 1e9:
            raise ValueError(f"t_s: expected a time of 0 to 1e9 s, found {t_s!r}")
        model = self._model
        state = model._states(pressure_mpa, gap_mm, inputs)
        if state.ndim != 1:
            raise TypeError("a step takes one state: expected numbers, found arrays")
        row = np.empty(len(model.columns))
        values = model._room((), out) if fields or out is not None else None
        self._native.step(round(1e9 * t_s), state, row, _NO_VALUES if values is None else values.reshape(-1))
        return Prediction(model, state, row, values)

    def restart(self) -> None:
        """Forgets the past: the next reading begins at equilibrium, at any time."""
        self._native.restart()


def _from_bytes(content: bytes, report: Any, fields: Optional[Sequence[str]], nodes: Optional[Nodes]) -> Model:
    model = Model._made(_native.Model.from_bytes(content), report)
    return model if fields is None and nodes is None else model.select(fields, nodes)


def _opened(path: str, fields: Optional[Sequence[str]], nodes: Optional[Nodes]) -> Model:
    model = Model(path)
    return model if fields is None and nodes is None else model.select(fields, nodes)
