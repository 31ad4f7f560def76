"""Models without a daemon: bit-identical to `softtwin predict`, by name, over arrays, as meshes and tables."""

import copy
import json
import multiprocessing
import pickle
import subprocess
import threading

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
STATES = [(0.0, 30.0), (0.05, 30.0), (0.0817, 12.5), (0.05, np.inf), (0.12, 200.0)]


@pytest.fixture(scope="module")
def model():
    return softtwin.Model(MODEL)


def predicted(folder, pressure_mpa, gap_mm):
    """Answer of `softtwin predict` at a state, and its fields, shape (fields, nodes)."""
    gap = [] if np.isinf(gap_mm) else ["--gap", repr(gap_mm)]
    command = [PROGRAMS / "softtwin", "predict", MODEL, "--json", "--pressure", repr(pressure_mpa), *gap]
    done = subprocess.run([*command, "--out", folder / "state.npy"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), np.load(folder / "state.npy").T


def test_a_state_far_outside_is_refused_with_its_input(model):
    for pressure_mpa, gap_mm in ((0.3, 5.0), (5.0, np.inf)):
        with pytest.raises(ValueError, match="pressure_mpa"):
            model.predict(pressure_mpa, gap_mm)


def test_answers_are_bit_identical_to_predict(model, tmp_path):
    pressures, gaps = np.array(STATES).T
    many = model.predict(pressures, gaps)
    for at, (pressure_mpa, gap_mm) in enumerate(STATES):
        said, fields = predicted(tmp_path, pressure_mpa, gap_mm)
        found = model.predict(pressure_mpa, gap_mm)
        assert found.values.tobytes() == np.ascontiguousarray(fields, np.float32).tobytes() == many.values[at].tobytes()
        assert found.contact_force_n == said["contact_force_n"] == many.contact_force_n[at]
        for name, slope in said["dforce"].items():
            assert found.force_gradient[name] == slope == many.force_gradient[name][at]
        assert found.regime == said["regime"] == many.regime[at]
        assert found.onset_pressure_mpa == (np.inf if said["onset_pressure_mpa"] is None else said["onset_pressure_mpa"])
        assert found.domain == said["domain"] and found.in_domain == said["in_domain"]
        assert found.domain_distance == said["domain_distance"]
        # Outside the training range there are none: null in JSON, NaN here.
        widths = {name: np.nan if width is None else width for name, width in said["half_widths"].items()}
        assert np.isnan(widths["displacement_mm"]) != found.in_domain
        for name, width in (
            ("coverage", found.coverage),
            ("force_n", found.force_halfwidth_n),
            ("displacement_mm", found.displacement_halfwidth_mm),
            ("stress_mpa", found.von_mises_halfwidth_mpa),
        ):
            assert np.array_equal(width, widths[name], equal_nan=True), name
        for name, one in said["observables"].items():
            assert found.observables[name] == one["value"] == many.observables[name][at]
            width = found.observable_halfwidths[name]
            assert np.isnan(width) if one["half_width"] is None else width == one["half_width"]
        assert len(said["observables"]) == len(model.observables) == 4
        assert found.max_von_mises_mpa == np.float32(said["max_von_mises_mpa"])
        assert found.max_von_mises_node == said["max_von_mises_node"] == found.von_mises.argmax()
        assert found.max_displacement_node == said["max_displacement_node"] == found.displacement.argmax()
        assert found.force_clamped == said["force_clamped"]


def test_gradients_are_slopes(model):
    for pressure_mpa, gap_mm in [(0.05, 30.0), (0.08, 20.0)]:
        slopes = model.predict(pressure_mpa, gap_mm, fields=False).force_gradient
        for name, step in [("pressure_mpa", np.array([1e-6, 0.0])), ("gap_mm", np.array([0.0, 1e-2]))]:
            high, low = model.predict(
                pressure_mpa + step[0] * np.array([1, -1]), gap_mm + step[1] * np.array([1, -1]), fields=False
            ).contact_force_n
            assert slopes[name] == pytest.approx((high - low) / (2 * step.sum()), rel=1e-4)


def test_arrays_are_broadcast_and_memory_is_used_again(model):
    found = model.predict(np.linspace(0.01, 0.08, 4)[:, None], [20.0, 30.0])
    assert found.values.shape == (4, 2, 5, 25022) and found.contact_force_n.shape == found.regime.shape == (4, 2)
    assert found.von_mises.shape == (4, 2, 25022) and found["x"].base is not None
    out = np.empty((5, 25022), np.float32)
    again = model.predict(0.08, 30.0, out=out)
    assert again.values is out and out.tobytes() == found.values[3, 1].tobytes()
    none = model.predict([], 30.0)
    assert none.values.shape == (0, 5, 25022) and none.contact_force_n.shape == (0,)
    few = model.predict(0.05, 30.0, fields=False)
    assert few.values is None and np.isnan(few.max_von_mises_mpa)
    with pytest.raises(AttributeError):
        few.x
    for wrong in (np.empty((5, 25022)), np.empty((5, 3), np.float32), np.empty((25022, 5), np.float32).T):
        with pytest.raises(ValueError, match="out"):
            model.predict(0.05, 30.0, out=wrong)


def test_some_fields_on_some_nodes(model):
    whole = model.predict(0.05, 30.0)
    bottom = model.select(["z", "x"], "bottom")
    assert list(bottom.fields) == ["z", "x"] and bottom.node_count == len(model.node_sets["bottom"])
    found = bottom.predict(0.05, 30.0)
    np.testing.assert_allclose(found.x, whole.x[bottom.nodes], rtol=0, atol=3e-4)
    chosen = model.select(nodes=[7, 3])
    np.testing.assert_allclose(chosen.predict(0.05, 30.0).values, whole.values[:, [7, 3]], rtol=0, atol=3e-4)
    for wrong in (dict(fields=["u"]), dict(nodes="tip"), dict(nodes=[25022]), dict(nodes=[-1]), dict(nodes=[0.5]), dict(nodes=[])):
        with pytest.raises(ValueError):
            model.select(**wrong)


def test_invalid_arguments_raise(model, tmp_path):
    with pytest.raises(TypeError, match="gap_mm"):
        model.predict(0.05, gab_mm=30.0)
    for wrong in ((np.nan, 30.0), (0.05, [30.0, np.nan])):
        with pytest.raises(ValueError, match="NaN"):
            model.predict(*wrong)
    with pytest.raises(ValueError, match="state 1.*pressure_mpa.*inf"):
        model.predict([0.05, np.inf])
    with pytest.raises(ValueError):
        model.predict([0.05, 0.06], [1.0, 2.0, 3.0])
    with pytest.raises(FileNotFoundError):
        softtwin.Model(tmp_path / "nowhere.twin")
    broken = bytearray(MODEL.read_bytes())
    broken[len(broken) // 2] ^= 1
    (tmp_path / "broken.twin").write_bytes(broken)
    with pytest.raises(ValueError, match="broken.twin"):
        softtwin.Model(tmp_path / "broken.twin")


def test_threads_share_a_model(model):
    states = np.linspace(0.0, 0.09, 40)
    expected = model.predict(states, 30.0).values.tobytes()
    found = []
    work = [threading.Thread(target=lambda: found.append(model.predict(states, 30.0).values.tobytes())) for _ in range(4)]
    [thread.start() for thread in work]
    [thread.join() for thread in work]
    assert found == [expected] * 4


def test_meshes_and_tables(model):
    mesh = model.mesh(0.06, 30.0)
    found = model.predict(0.06, 30.0)
    assert mesh.n_points == 25022 and mesh.n_cells == len(model.triangles) and mesh.is_all_triangles
    np.testing.assert_array_equal(mesh.points, np.stack([found.x, found.y, found.z], axis=1))
    np.testing.assert_array_equal(mesh["von_mises"], found.von_mises)
    assert mesh.points[:, 1].min() == pytest.approx(-30.0, abs=0.3), "it touches the plate"
    np.testing.assert_allclose(np.linalg.norm(mesh.points - model.undeformed_mm, axis=1), found.displacement, atol=2e-5)
    with pytest.raises(ValueError):
        model.select(nodes="bottom").mesh(0.06)

    table = model.select(["von_mises"], [5, 9]).predict([0.01, 0.05], 30.0).to_xarray()
    assert table.von_mises.dims == ("pressure_mpa", "node") and list(table.node) == [5, 9]
    assert table.contact_force_n.attrs["units"] == "N" and float(table.gap_mm[0]) == 30.0
    assert float(table.force_by_gap_mm[1]) == found_slope(model)
    grid = model.predict(np.array([[0.01], [0.05]]), [20.0, 30.0], fields=False).to_xarray()
    assert grid.contact_force_n.dims == ("state_0", "state_1") and str(grid.domain.values[1, 1]) == "inside"
    assert model.predict(0.05, 30.0).to_xarray().x.dims == ("node",)


def found_slope(model):
    return model.predict(0.05, 30.0, fields=False).force_gradient["gap_mm"]


def test_models_and_selections_are_pickled_and_copied(model, tmp_path):
    tip = model.select(["x", "y"], "bottom")
    for original in (model, tip):
        for copied in (pickle.loads(pickle.dumps(original)), copy.deepcopy(original)):
            assert copied.predict(0.05, 30.0).values.tobytes() == original.predict(0.05, 30.0).values.tobytes()


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_models_go_to_other_processes(model, method):
    with multiprocessing.get_context(method).Pool(2) as pool:
        forces = pool.starmap(_force, [(model, pressure) for pressure in (0.03, 0.05)])
    assert forces == [model.predict(pressure, 30.0).contact_force_n for pressure in (0.03, 0.05)]


def _force(model, pressure_mpa):
    return model.predict(pressure_mpa, 30.0).contact_force_n


def test_pressure_is_asked_of_a_model_that_has_it(model):
    with pytest.raises(TypeError, match="pressure_mpa"):
        model.predict(gap_mm=30.0)


def test_half_widths_are_listed(model):
    found = model.predict(0.05, 30.0)
    assert {"force_halfwidth_n", "displacement_halfwidth_mm", "von_mises_halfwidth_mpa", "von_mises"} <= set(dir(found))


def test_session_of_a_static_model_follows_at_once_and_refuses_times_that_do_not_rise(model):
    session = model.session()
    for at, (pressure_mpa, gap_mm) in enumerate(STATES):
        found, expected = session.step(0.1 * at, pressure_mpa, gap_mm), model.predict(pressure_mpa, gap_mm)
        assert found.values.tobytes() == expected.values.tobytes()
        assert found.contact_force_n == expected.contact_force_n
    for bad in (-1.0, float("nan")):
        with pytest.raises(ValueError):
            session.step(bad, 0.05, 30.0)
    with pytest.raises(TypeError):
        session.step(9.0, [0.05, 0.06], 30.0)
    session.restart()
    assert session.step(0.0, 0.05, 30.0, fields=False).contact_force_n == model.predict(0.05, 30.0).contact_force_n
