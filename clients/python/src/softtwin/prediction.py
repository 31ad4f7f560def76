"""Answer of a model at one state or at an array of states."""

from typing import Any, Dict, List, Mapping, Optional

import numpy as np

from .layout import DOMAIN_STATUSES, REGIMES

_UNITS = {
    "contact_force_n": "N",
    "onset_pressure_mpa": "MPa",
    "force_halfwidth_n": "N",
    "displacement_halfwidth_mm": "mm",
    "von_mises_halfwidth_mpa": "MPa",
    "coverage": "1",
    "domain_distance": "1",
    "max_displacement_mm": "mm",
    "max_von_mises_mpa": "MPa",
    "max_displacement_node": "",
    "max_von_mises_node": "",
}


class Prediction:
    """Numbers of the shape of the states (plain numbers for one state), and the fields by name: `found.von_mises`."""

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
        inputs: Mapping[str, Any],
        positions: Mapping[str, int],
        fields: Mapping[str, str],
        observables: Mapping[str, str],
        names: List[str],
        states: "np.ndarray[Any, Any]",
        rows: "np.ndarray[Any, Any]",
        values: Optional["np.ndarray[Any, Any]"],
        nodes: Optional["np.ndarray[Any, Any]"],
    ) -> None:
        self._inputs, self._fields, self._rows, self._nodes = inputs, fields, rows, nodes
        self._observables = observables
        self._positions, self._given, self._states = positions, names, states
        #: All fields, shape of the states and (fields, nodes); None when they were not asked for.
        self.values = values

    @property
    def inputs(self) -> Dict[str, Any]:
        """The inputs that were given, by name."""
        return {name: self._states[..., self._positions[name]][()] for name in self._inputs if name in self._given}

    @property
    def names(self) -> List[str]:
        """The fields in their order."""
        return list(self._fields)

    @property
    def force_gradient(self) -> Dict[str, Any]:
        """Derivative of the force with respect to each input, N per unit of the input."""
        return {name: self._rows["force_gradient"][..., self._positions[name]][()] for name in self._inputs}

    @property
    def observables(self) -> Dict[str, Any]:
        """Observables by name, in the unit at its end."""
        return {name: self._rows["observables"][..., at][()] for at, name in enumerate(self._observables)}

    @property
    def observable_halfwidths(self) -> Dict[str, Any]:
        """Half-widths of the observables by name."""
        return {name: self._rows["observable_halfwidths"][..., at][()] for at, name in enumerate(self._observables)}

    @property
    def observable_offsets(self) -> Dict[str, Any]:
        """Part of each observable that is a measured difference from the finite elements, by name; 0 without one."""
        return {name: self._rows["observable_offsets"][..., at][()] for at, name in enumerate(self._observables)}

    @property
    def regime(self) -> Any:
        """`free` or `contact`."""
        return _words(REGIMES, self._rows["regime"])

    @property
    def domain(self) -> Any:
        """Place of the state: `inside`, `near-edge` or `outside-domain` of the training range."""
        return _words(DOMAIN_STATUSES, self._rows["domain_status"])

    @property
    def in_domain(self) -> Any:
        """True inside the training range."""
        return self._rows["domain_status"] == 0

    @property
    def force_clamped(self) -> Any:
        """True if the interpolated force is negative and set to 0."""
        return self._rows["force_clamped"] != 0

    def __getitem__(self, name: str) -> "np.ndarray[Any, Any]":
        if self.values is None:
            raise KeyError(f"{name}: no fields were asked for; predict with fields=True")
        if name not in self._fields:
            raise KeyError(f"this prediction has {', '.join(self._fields)}, not `{name}`")
        found: "np.ndarray[Any, Any]" = self.values[..., self.names.index(name), :]
        return found

    def __dir__(self) -> List[str]:
        return sorted({*super().__dir__(), *_UNITS, *self._fields})

    def __getattr__(self, name: str) -> Any:
        if name in _UNITS:
            return self._rows[name][()]
        if not name.startswith("_") and name in self._fields:
            try:
                return self[name]
            except KeyError as error:
                raise AttributeError(str(error)) from None
        raise AttributeError(f"a prediction has no attribute `{name}`")

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with units; needs xarray. Inputs are coordinates; one input that varies names the dimension."""
        try:
            import xarray
        except ImportError as error:
            raise ImportError("Prediction.to_xarray needs xarray, which is not installed: pip install xarray") from error
        shape = self._rows.shape
        moving = [name for name, value in self.inputs.items() if len(shape) == 1 and np.unique(value).size > 1]
        states = [moving[0]] if len(moving) == 1 else [f"state_{at}" for at in range(len(shape))]
        known = {name: (states, value, {"units": self._inputs[name].unit}) for name, value in self.inputs.items()}
        data: Dict[str, Any] = {name: (states, self._rows[name], {"units": unit}) for name, unit in _UNITS.items()}
        for name, value in self.force_gradient.items():
            data[f"force_by_{name}"] = (states, value, {"units": f"N/({self._inputs[name].unit})"})
        for name, value in self.observables.items():
            data[name] = (states, value, {"units": self._observables[name]})
            data[f"{name}_halfwidth"] = (states, self.observable_halfwidths[name], {"units": self._observables[name]})
        data["regime"], data["domain"] = (states, self.regime), (states, self.domain)
        if self.values is not None:
            known["node"] = (["node"], np.arange(self.values.shape[-1]) if self._nodes is None else self._nodes, {})
            for name, unit in self._fields.items():
                data[name] = ([*states, "node"], self[name], {"units": unit})
        return xarray.Dataset(data, known)

    def __repr__(self) -> str:
        return f"Prediction(shape={self._rows.shape}, contact_force_n={self.contact_force_n!r}, domain={self.domain!r})"


def _words(names: Mapping[int, str], numbers: "np.ndarray[Any, Any]") -> Any:
    words = np.array([names.get(number, "unknown") for number in range(max(names) + 1)])[numbers]
    return str(words) if np.ndim(words) == 0 else words
