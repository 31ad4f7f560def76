"""Answer of a model at one state or at an array of states."""

from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional

import numpy as np

from .layout import DOMAIN_STATUSES, REGIMES

if TYPE_CHECKING:
    from .model import Model

_WHOLE = ("max_displacement_node", "max_von_mises_node")


class Prediction:
    """Numbers of the shape of the states (plain numbers for one state), and the fields by name: `found.von_mises`.

    >>> from softtwin import Model, shared_file
    >>> found = Model(shared_file("models/pneunet/pneunet.twin")).predict([0.0, 0.05], 30.0)
    >>> found.von_mises.shape, found.regime.tolist()
    ((2, 25022), ['free', 'contact'])
    >>> list(found.force_gradient)
    ['pressure_mpa', 'gap_mm']
    """

    contact_force_n: Any
    """Contact force, N; NaN, as its gradient and half-width, if the model was not trained on forces."""
    onset_pressure_mpa: Any
    """Pressure at which contact begins, MPa: 0 if weight alone closes the gap, infinite out of reach, NaN: the model has no onset."""
    force_halfwidth_n: Any
    """Half-width that covers the fraction `coverage` of states, N; NaN outside the training range."""
    displacement_halfwidth_mm: Any
    """Half-width of the worst node's displacement, mm."""
    von_mises_halfwidth_mpa: Any
    """Half-width of the worst node's stress, MPa; NaN if the model has no stress."""
    coverage: Any
    """Fraction of states that the half-widths cover."""
    domain_distance: Any
    """Distance to the training range over inputs scaled to [0, 1]; 0 inside."""
    max_displacement_mm: Any
    """Largest displacement of the fields, mm; NaN without that field."""
    max_von_mises_mpa: Any
    """Largest von Mises stress of the fields, MPa; NaN without that field."""
    max_displacement_node: Any
    """Its node."""
    max_von_mises_node: Any
    """Its node."""

    def __init__(
        self,
        model: "Model",
        states: "np.ndarray[Any, Any]",
        rows: "np.ndarray[Any, Any]",
        values: Optional["np.ndarray[Any, Any]"],
    ) -> None:
        self._model, self._states, self._rows = model, states, rows
        #: All fields, shape of the states and (fields, nodes); None when they were not asked for.
        self.values = values

    def _number(self, name: str) -> Any:
        found = self._rows[..., self._model._column[name]]
        return found if found.ndim else float(found)

    @property
    def inputs(self) -> Dict[str, Any]:
        """The inputs that were given, by name."""
        position = self._model._position
        given = {name: self._states[..., position[name]][()] for name in self._model.inputs}
        return {name: value for name, value in given.items() if not np.isnan(value).any()}

    @property
    def names(self) -> List[str]:
        """The fields in their order."""
        return list(self._model.fields)

    @property
    def force_gradient(self) -> Dict[str, Any]:
        """Derivative of the force with respect to each input, N per unit of the input."""
        return {name: self._number(f"force_by_{name}") for name in self._model.inputs}

    @property
    def observables(self) -> Dict[str, Any]:
        """Observables by name, in the unit at its end."""
        return {name: self._number(name) for name in self._model.observables}

    @property
    def observable_halfwidths(self) -> Dict[str, Any]:
        """Half-widths of the observables by name."""
        return {name: self._number(f"{name}_halfwidth") for name in self._model.observables}

    @property
    def outputs(self) -> Dict[str, Any]:
        """Outputs of a model that was learned from runs, by name, in the unit at its end."""
        return {name: self._number(name) for name in self._model.outputs}

    @property
    def output_halfwidths(self) -> Dict[str, Any]:
        """Their half-widths by name; NaN where nothing is known."""
        return {name: self._number(f"{name}_halfwidth") for name in self._model.outputs}

    @property
    def observable_offsets(self) -> Dict[str, Any]:
        """Part of each observable that is a measured difference from the finite elements, by name; 0 without one."""
        return {name: self._number(f"{name}_offset") for name in self._model.observables}

    @property
    def regime(self) -> Any:
        """`free` or `contact`."""
        return _words(REGIMES, self._number("regime"))

    @property
    def domain(self) -> Any:
        """Place of the state: `inside`, `near` or `outside` of the training range."""
        return _words(DOMAIN_STATUSES, self._number("domain_status"))

    @property
    def in_domain(self) -> Any:
        """True inside the training range."""
        return self._number("domain_status") == 0

    @property
    def force_clamped(self) -> Any:
        """True if the interpolated force is negative and set to 0."""
        return self._number("force_clamped") != 0

    def __getitem__(self, name: str) -> "np.ndarray[Any, Any]":
        if self.values is None:
            raise KeyError(f"{name}: no fields were asked for; predict with fields=True")
        if name not in self._model.fields:
            raise KeyError(f"this prediction has {', '.join(self._model.fields)}, not `{name}`")
        found: "np.ndarray[Any, Any]" = self.values[..., self.names.index(name), :]
        return found

    def __dir__(self) -> List[str]:
        return sorted({*super().__dir__(), *self._model.columns, *self._model.fields})

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):
            if name in self._model.fields:  # also where a measured output has this name: its number is in `outputs`
                try:
                    return self[name]
                except KeyError as error:
                    raise AttributeError(str(error)) from None
            if name in self._model._column:
                found = self._number(name)
                return _node(found) if name in _WHOLE else found
        raise AttributeError(f"a prediction has no attribute `{name}`")

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with units; needs xarray. Inputs are coordinates; one input that varies names the dimension."""
        try:
            import xarray
        except ImportError as error:
            raise ImportError("Prediction.to_xarray needs xarray, which is not installed: pip install xarray") from error
        shape, model = self._states.shape[:-1], self._model
        moving = [name for name, value in self.inputs.items() if len(shape) == 1 and np.unique(value).size > 1]
        states = [moving[0]] if len(moving) == 1 else [f"state_{at}" for at in range(len(shape))]
        known = {name: (states, value, {"units": model.inputs[name].unit}) for name, value in self.inputs.items()}
        numbers = {name: self._number(name) if name in model.outputs else getattr(self, name) for name in model.columns}
        data: Dict[str, Any] = {name: (states, number, {"units": model.columns[name]}) for name, number in numbers.items()}
        data["regime"], data["domain"] = (states, self.regime), (states, self.domain)
        if self.values is not None:
            known["node"] = (["node"], np.arange(self.values.shape[-1]) if model.nodes is None else model.nodes, {})
            for name, unit in self._model.fields.items():
                data[name] = ([*states, "node"], self[name], {"units": unit})
        return xarray.Dataset(data, known)

    def __repr__(self) -> str:
        return f"Prediction(shape={self._states.shape[:-1]}, contact_force_n={self.contact_force_n!r}, domain={self.domain!r})"


def _node(numbers: Any) -> Any:
    """Numbers of nodes; -1 without fields."""
    whole = np.where(np.isnan(numbers), -1, numbers).astype(np.int64)
    return whole if whole.ndim else int(whole)


def _words(names: Mapping[int, str], numbers: Any) -> Any:
    words = np.array([names.get(number, "unknown") for number in range(max(names) + 1)])[np.asarray(numbers, np.int64)]
    return str(words) if np.ndim(words) == 0 else words
