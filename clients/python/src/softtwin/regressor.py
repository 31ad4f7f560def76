"""A learned model by the conventions of scikit-learn, for its pipelines, searches and cross-validation; needs scikit-learn (`pip install softtwin[learning]`).

    from sklearn.model_selection import cross_val_score
    from softtwin.regressor import LearnedRegressor

    cross_val_score(LearnedRegressor(), frame[["pressure_mpa", "load_n"]], frame["angle_deg"])
"""

import json
from typing import Any, List

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from . import _native
from .model import Model


def _has_unit(name: str) -> bool:
    try:
        _native.to_unit(name, name, None)
    except ValueError:
        return False
    return True


class LearnedRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """What `softtwin.learn` learns of settled states: rows of inputs `X` and outputs `y`, which are numbers in whatever units.

    After `fit`, `model_` is the `softtwin.Model`, with its half-widths, file and twin; its inputs have the names of a frame's columns where these
    end with units (`pressure_mpa`), else `x0`, `x1`, ..., and its outputs are `y0`, `y1`, ... A run over time has a past: give it
    to `softtwin.learn`, since the conventions of scikit-learn have no time.

    >>> pressure, load = np.random.default_rng(1).uniform(0.0, 1.0, (2, 80))
    >>> X, y = np.stack([pressure, load], axis=1), 30.0 * pressure - 5.0 * load**2
    >>> regressor = LearnedRegressor().fit(X, y)
    >>> bool(regressor.score(X, y) > 0.99)
    True
    >>> values, half_widths = regressor.predict(X[:3], return_half_width=True)
    >>> values.shape, half_widths.shape
    ((3,), (3,))
    """

    model_: Model
    n_features_in_: int

    def fit(self, X: Any, y: Any) -> "LearnedRegressor":
        """Learns the outputs `y`, shape (rows,) or (rows, outputs), from the inputs `X`, shape (rows, inputs).

        Raises `ValueError` where the rows teach nothing, as `softtwin.learn` does.
        """
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True, ensure_min_samples=2)
        columns = np.asarray(y, np.float64).reshape(len(y), -1)
        names = list(getattr(self, "feature_names_in_", []))
        self._inputs = names if names and all(map(_has_unit, names)) else [f"x{at}" for at in range(X.shape[1])]
        outputs = [f"y{at}" for at in range(columns.shape[1])]
        run = (np.arange(float(len(X))), [*np.ascontiguousarray(X.T)], [*np.ascontiguousarray(columns.T)])
        native, report = _native.learn("regressor", self._inputs, outputs, [run])
        self.model_ = Model._made(native, json.loads(report))
        self._is_single = np.ndim(y) == 1
        self._outputs = outputs
        return self

    def predict(self, X: Any, return_half_width: bool = False) -> Any:
        """The outputs at the inputs `X`; with `return_half_width` also the half-widths that nine of ten errors stay below, NaN where none is known.

        Raises `ValueError` for inputs that are farther outside than those learned are wide.
        """
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        given = {name: X[:, at] for at, name in enumerate(self._inputs) if name in self.model_.inputs}
        found = self.model_.predict(**given, fields=False)
        values = self._shaped([found.outputs[name] for name in self._outputs])
        if not return_half_width:
            return values
        return values, self._shaped([found.output_halfwidths[name] for name in self._outputs])

    def _shaped(self, columns: List[Any]) -> Any:
        values = np.stack(columns, axis=1)
        return values[:, 0] if self._is_single else values

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True  # of rows that no input explains there is no model at all
        return tags
