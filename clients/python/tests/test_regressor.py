"""A learned model by the conventions of scikit-learn."""

import pickle

import numpy as np
import pytest

pytest.importorskip("sklearn", reason="scikit-learn is not installed; pip install softtwin[learning]")
from sklearn.base import clone  # noqa: E402
from sklearn.model_selection import cross_val_score  # noqa: E402
from sklearn.pipeline import make_pipeline  # noqa: E402
from sklearn.preprocessing import StandardScaler  # noqa: E402
from sklearn.utils.estimator_checks import check_estimator  # noqa: E402
from softtwin.regressor import LearnedRegressor  # noqa: E402

#: Checks that a model of measurements does not pass, with the reason.
EXPECTED = {
    **dict.fromkeys(
        (
            "check_dtype_object",
            "check_regressor_data_not_an_array",
            "check_regressor_multioutput",
            "check_regressors_int",
            "check_regressors_train",
        ),
        "ten inputs, and a model has six besides pressure and gap",
    ),
    **dict.fromkeys(
        (
            "check_estimators_dtypes",
            "check_estimators_nan_inf",
            "check_fit_check_is_fitted",
            "check_fit_idempotent",
            "check_fit_score_takes_y",
            "check_n_features_in",
            "check_n_features_in_after_fitting",
            "check_supervised_y_2d",
        ),
        "outputs that no input explains are refused, not fitted",
    ),
}


def test_scikit_learns_own_checks_pass_or_fail_as_listed():
    found = check_estimator(LearnedRegressor(), expected_failed_checks=EXPECTED, on_fail=None)
    by_status = {status: {check["check_name"] for check in found if check["status"] == status} for status in ("passed", "failed", "xfail")}
    assert not by_status["failed"], by_status["failed"]
    assert by_status["xfail"] == set(EXPECTED)
    assert len(by_status["passed"]) >= 30


@pytest.fixture(scope="module")
def rows():
    random = np.random.default_rng(5)
    inputs = random.uniform([0.0, -1.0], [0.08, 1.0], (150, 2))
    angle = 900.0 * inputs[:, 0] ** 1.3 - 4.0 * inputs[:, 1] + random.normal(0.0, 0.05, 150)
    return inputs, angle


def test_it_fits_predicts_and_scores(rows):
    inputs, angle = rows
    scores = cross_val_score(make_pipeline(StandardScaler(), LearnedRegressor()), inputs, angle, cv=3)
    assert scores.min() > 0.99
    fitted = LearnedRegressor().fit(inputs[:100], angle[:100])
    values, half_widths = fitted.predict(inputs[100:], return_half_width=True)
    assert np.mean(np.abs(values - angle[100:]) <= half_widths) > 0.85
    assert 0.0 < np.median(half_widths) < 1.0
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fitted)).predict(inputs), fitted.predict(inputs))
    assert not hasattr(clone(fitted), "model_")


def test_several_outputs_keep_their_shape(rows):
    inputs, angle = rows
    both = np.stack([angle, 3.0 * inputs[:, 1]], axis=1)
    fitted = LearnedRegressor().fit(inputs, both)
    assert fitted.predict(inputs).shape == both.shape and fitted.score(inputs, both) > 0.99
    assert LearnedRegressor().fit(inputs, both[:, :1]).predict(inputs).shape == (150, 1)


def test_what_teaches_nothing_is_refused(rows):
    inputs, angle = rows
    with pytest.raises(ValueError, match="no input moves"):
        LearnedRegressor().fit(np.ones((50, 2)), angle[:50])
    with pytest.raises(ValueError, match="NaN"):
        LearnedRegressor().fit(np.where(inputs > 0.5, np.nan, inputs), angle)
    with pytest.raises(ValueError, match="farther|outside"):
        LearnedRegressor().fit(inputs, angle).predict([[50.0, 0.0]])
