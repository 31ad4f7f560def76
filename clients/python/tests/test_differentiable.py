"""The equations in jax and as ONNX graphs: the answers of `Model.predict` and `Model.session`, and their derivatives."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import softtwin
from conftest import PATIENCE_S, PROGRAMS, REPOSITORY

if not os.environ.get("CI"):  # there all packages are installed
    for package in ("jax", "onnx", "onnxruntime"):
        pytest.importorskip(package)
import jax
import jax.numpy as jnp
import onnxruntime
from softtwin.equations import KERNELS

jax.config.update("jax_enable_x64", True)
MODELS = ["gripper/gripper", "pneunet/pneunet", "pneunet-design/pneunet-design", "pneunet/motion/pneunet-motion"]
AGREEMENT = 1e-6  # of a number's range


def read(name):
    return softtwin.Model(REPOSITORY / f"models/{name}.twin")


def random_states(model, count, beyond=0.0):
    """States that have an answer: within the ranges of the inputs or a share of them beyond; some without an obstacle."""
    random = np.random.default_rng(5)
    states = {name: random.uniform(i.min - beyond * (i.max - i.min), i.max + beyond * (i.max - i.min), count) for name, i in model.inputs.items()}
    if "gap_mm" in states:
        states["gap_mm"][: count // 8] = np.inf

    def has_answer(at):
        try:
            model.predict(**{name: float(values[at]) for name, values in states.items()}, fields=False)
        except ValueError:
            return False
        return True

    kept = [at for at in range(count) if has_answer(at)]
    assert len(kept) > count // 2
    return {name: values[kept] for name, values in states.items()}


def worst_difference(model, states, found):
    """The largest difference of any number from `predict`, as a share of its range; what is not a number is none in both."""
    expected, worst = model.predict(**states), 0.0
    assert {"contact_force_n", "regime", "domain_distance", *model.observables, *model.fields} <= set(found)
    for name, own in found.items():
        own, other = np.asarray(own), np.asarray(getattr(expected, name) if name != "regime" else expected._number(name))
        assert own.shape == other.shape, name
        np.testing.assert_array_equal(np.isnan(own), np.isnan(other), name)
        np.testing.assert_array_equal(np.isposinf(own), np.isposinf(other), name)
        is_number = np.isfinite(other)
        if is_number.any():
            scale = max(np.ptp(other[is_number]), 1e-3 * np.abs(other[is_number]).max(), 1e-9)
            worst = max(worst, np.abs(own[is_number] - other[is_number]).max() / scale)
    return worst


@pytest.mark.parametrize("name", MODELS)
def test_answers_agree_with_predict_and_the_graph_does(name, tmp_path):
    model = read(name)
    states = random_states(model, 64, beyond=0.05)
    difference = worst_difference(model, states, model.jax()(states))
    model.to_onnx(tmp_path / "model.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "model.onnx")
    names = [output.name for output in session.get_outputs()]
    graph = worst_difference(model, states, dict(zip(names, session.run(None, states))))
    units = json.loads(session.get_modelmeta().custom_metadata_map["units"])
    assert units["contact_force_n"] == "N" and units["pressure_mpa"] == "MPa" and set(units) == {*names, *model.inputs}
    model.to_onnx(tmp_path / "numbers.onnx", fields=False)
    sizes_mb = [round((tmp_path / file).stat().st_size / 1e6, 1) for file in ("model.onnx", "numbers.onnx")]
    print(json.dumps({"model": name, "jax": difference, "onnx": graph, "onnx_mb": sizes_mb}))
    assert difference < AGREEMENT and graph < AGREEMENT


def test_a_selection_and_a_shape_agree():
    model = read("pneunet/pneunet").select(["z", "displacement"], [3, 20000, 7])
    found = model.jax()({"pressure_mpa": np.array([[0.01], [0.05]]), "gap_mm": [20.0, 30.0, 40.0]})
    expected = model.predict(np.array([[0.01], [0.05]]), [20.0, 30.0, 40.0])
    assert found["z"].shape == (2, 3, 3) and "x" not in found
    np.testing.assert_allclose(found["displacement"], expected.displacement, atol=1e-4)
    alone = model.jax(fields=False)({"pressure_mpa": 0.05})
    assert alone["contact_force_n"].shape == () and alone["contact_force_n"] == 0.0 and "z" not in alone


@pytest.mark.parametrize("kernel", ["linear", "thin_plate", "gaussian", "matern72", "cubic_quintic"])
def test_the_slopes_of_every_kernel_are_its_own(kernel):
    r2 = jnp.array([0.0, 1e-12, 0.01, 0.3, 2.0])
    value, over_r = KERNELS[kernel](jnp, r2, 0.7)
    slope = jax.vmap(jax.grad(lambda r2: KERNELS[kernel](jnp, r2, 0.7)[0]))(r2)
    assert jnp.isfinite(slope).all() and float(value[0]) == {"gaussian": 1.0, "matern72": 1.0}.get(kernel, 0.0)
    if kernel != "linear":  # which no model fits to derivatives
        np.testing.assert_allclose(2.0 * slope[2:], over_r[2:], rtol=1e-12)


def test_observables_of_every_kind_agree_on_a_model_of_arrays():
    x, y, z = (axis.ravel() for axis in np.meshgrid(np.arange(11.0), [0.0, 1.0], [0.0, 1.0], indexing="ij"))
    pressure = np.linspace(0.0, 0.08, 7)
    moved = np.zeros((7, x.size, 3))
    moved[:, :, 1] = -1.5 * pressure[:, None] * x**2
    database = softtwin.Database(np.stack([x, y, z], axis=1), inputs={"pressure_mpa": pressure}, displacement_mm=moved)
    points = [[0, 0, 0], [5, 0, 0], [10, 0, 0], [10, 1, 0]]
    model = softtwin.train(
        database,
        observables={
            "tip_mm": {"kind": "position", "points": points[2:3], "axis": [0, 1, 1]},
            "bend_deg": {"kind": "section_angle", "points": [points[0], points[1], points[1], points[2]]},
            "chord_deg": {"kind": "chord_angle", "points": points[1:3], "axis": [0.1, 0, -1]},
            "bow_per_mm": {"kind": "curvature", "points": points[:3]},
            "long_mm": {"kind": "length", "points": points},
        },
    )
    states = {"pressure_mpa": np.linspace(-0.004, 0.084, 45)}
    assert worst_difference(model, states, model.jax()(states)) < AGREEMENT


def test_derivatives_agree_with_finite_differences_of_predict():
    model = read("pneunet-design/pneunet-design").select(["y"], "bottom")
    low = model.jax()
    states = {name: 0.8 * values + 0.1 * (model.inputs[name].min + model.inputs[name].max) for name, values in random_states(model, 40).items()}
    slopes = jax.jit(jax.vmap(jax.jacfwd(lambda s: {name: low(s)[name] for name in ("contact_force_n", "onset_pressure_mpa", "y")})))(states)
    back = jax.jit(jax.vmap(jax.grad(lambda s: low(s)["contact_force_n"])))(states)
    here, worst = model.predict(**states), {}
    for name, given in model.inputs.items():
        np.testing.assert_allclose(back[name], slopes["contact_force_n"][name], rtol=1e-9, atol=1e-9)
        for of, share in (("contact_force_n", 1e-5), ("onset_pressure_mpa", 1e-5), ("y", 1e-2)):  # fields have 32 bits
            step = share * (given.max - given.min)
            ends = [model.predict(**{**states, name: states[name] + sign * step}) for sign in (1, -1)]
            stays = np.all([(end.regime == here.regime) & ((end.onset_pressure_mpa == 0.0) == (here.onset_pressure_mpa == 0.0)) for end in ends], axis=0)
            stays &= np.isfinite(states["gap_mm"]) & np.isfinite(here.onset_pressure_mpa)
            assert stays.sum() > 20
            numeric = (getattr(ends[0], of)[stays] - getattr(ends[1], of)[stays]) / (2.0 * share)
            exact = np.asarray(slopes[of][name])[stays] * (given.max - given.min)
            worst[of] = max(worst.get(of, 0.0), np.abs(numeric - exact).max() / np.ptp(np.asarray(getattr(here, of))[stays]))
    print(json.dumps(worst))
    assert worst["contact_force_n"] < 1e-6 and worst["onset_pressure_mpa"] < 1e-6 and worst["y"] < 2e-3


def test_derivatives_are_numbers_everywhere():
    """At trained states, where distances are zero, without an obstacle, at the onset and at rest."""
    model = read("pneunet/pneunet").select(nodes=[0, 5])
    finger = model.jax()
    onset = model.predict(0.05, 30.0, fields=False).onset_pressure_mpa
    pressures = np.array([0.0, 0.0, 0.09, 0.045, onset, 0.05])
    slopes = jax.jit(jax.vmap(jax.jacrev(finger)))({"pressure_mpa": pressures, "gap_mm": np.array([np.inf, 30.0, 20.0, 1.0, 30.0, np.inf])})
    for name in ("contact_force_n", "domain_distance", *model.fields, *model.observables):
        assert np.isfinite(slopes[name]["pressure_mpa"]).all() and np.isfinite(slopes[name]["gap_mm"]).all(), name
    expected = model.predict(0.05, 30.0, fields=False).force_gradient
    found = jax.grad(lambda s: finger(s)["contact_force_n"])({"pressure_mpa": 0.05, "gap_mm": 30.0})
    assert {name: float(value) for name, value in found.items()} == pytest.approx(expected, rel=1e-9)


def test_ten_thousand_states_at_once():
    model = read("pneunet/pneunet")
    pressures, gaps = np.linspace(0.0, 0.09, 10_000), np.linspace(20.0, 45.0, 10_000)
    many = jax.jit(jax.vmap(model.jax(fields=False)))({"pressure_mpa": pressures, "gap_mm": gaps})
    np.testing.assert_allclose(many["contact_force_n"], model.predict(pressures, gaps, fields=False).contact_force_n, atol=1e-9)


def test_what_cannot_be_expressed_is_refused(monkeypatch):
    moving = read("pneunet/motion/pneunet-motion").jax(fields=False)
    with pytest.raises(ValueError, match="inertia.*Model.session"):
        moving.rest({"pressure_mpa": 0.05})
    finger = read("gripper/gripper").jax(fields=False)
    with pytest.raises(TypeError, match="pressure_mpa"):
        finger({"gap_mm": 20.0})
    with pytest.raises(TypeError, match="gap_mm"):
        finger({"pressure_mpa": 0.05, "gab_mm": 20.0})
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(ValueError, match="jax_enable_x64"):
            read("gripper/gripper").jax()
    finally:
        jax.config.update("jax_enable_x64", True)
    for package, use in (("jax", lambda m: m.jax()), ("onnx", lambda m: m.to_onnx("never.onnx"))):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(ImportError, match=rf"softtwin\[{package}\]"):
            use(read("gripper/gripper"))


def along(model, times_s, readings, **options):
    """Answers of the session in Rust, and of its steps in jax."""
    finger, session = model.jax(**options), model.session()
    step = jax.jit(finger.step, static_argnums=2)
    past, rows, found = finger.rest({name: values[0] for name, values in readings.items()}), [], []
    for at, t_s in enumerate(times_s):
        now = {name: float(values[at]) for name, values in readings.items()}
        rows.append(session.step(t_s, **now))
        if at:
            past, answer = step(past, now, round(t_s - times_s[at - 1], 9))
            found.append(answer)
    return rows[1:], found


def test_a_learned_model_agrees_along_a_run(tmp_path):
    table = np.genfromtxt(REPOSITORY / "benchmarks/data/cylinder_1.csv", delimiter=",", names=True)
    columns = {name: table[name] for name in table.dtype.names}
    channels = dict(time="time_s", inputs={"stroke_mm": "stroke_mm", "pressure_mpa": ("pressure_mpa", "MPa")}, outputs={"force_n": "force_n"})
    model = softtwin.learn(columns, **channels)
    states = random_states(model, 40)
    assert worst_difference(model, states, model.jax()(states)) < AGREEMENT
    times_s = np.cumsum(np.r_[0.0, np.tile([0.04, 0.013, 0.1], 20), 7.0, 0.04])
    readings = {name: columns[name][100 : 100 + len(times_s)] for name in ("stroke_mm", "pressure_mpa")}
    rows, found = along(model, times_s, readings)
    expected = np.array([row.force_n for row in rows])
    assert np.abs(np.array([answer["force_n"] for answer in found]) - expected).max() < AGREEMENT * np.abs(expected).max()


LOG = """
[time]
column = 1
unit = "s"
[[input]]
name = "pressure_mpa"
column = 2
unit = "MPa"
[[input]]
name = "gap_mm"
column = 3
unit = "mm"
[[output]]
name = "bending_angle_deg"
column = 4
unit = "deg"
"""


def test_a_measured_difference_agrees(tmp_path):
    path = REPOSITORY / "models/pneunet/pneunet.twin"
    times_s = 0.5 * np.arange(200)
    pressures = 0.045 - 0.04 * np.cos(0.3 * times_s)
    angles = 1.04 * softtwin.Model(path).predict(pressures, 30.0, fields=False).bending_angle_deg + 1.5 * np.sin(40.0 * pressures)
    table = np.transpose([times_s, pressures, np.full(200, 30.0), angles])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,p,gap,angle", comments="")
    (tmp_path / "log.toml").write_text(LOG)
    command = [PROGRAMS / "softtwin", "learn", "run.csv", "--log", "log.toml", "--model", path, "--out", "mine.twin"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    model = softtwin.Model(tmp_path / "mine.twin")
    states = random_states(model, 40)
    states["gap_mm"][::2] = 30.0  # where it was measured
    assert np.abs(model.predict(**states, fields=False).observable_offsets["bending_angle_deg"]).max() > 0.1
    assert worst_difference(model, states, model.jax()(states)) < AGREEMENT


SCENE = """
name = "lagging"
[[actuator]]
name = "finger"
model = "{model}"
[actuator.estimate]
gap_mm = {{ prior = 30.0, sigma = 0.01 }}
[actuator.sigma]
pressure_mpa = 1e-6
force_n = 1e-4
marker_mm = 0.001
[[actuator.marker]]
name = "tip"
at_mm = [115.0, 2.0, 16.0]
[[actuator.output]]
nodes = "all"
"""
LINE_S, PLAY_MPA, CREEP = (0.2, 0.5), 0.003, (0.25, 1.0)


def acting(times_s, given):
    """Line, play and creep, by small steps."""
    line, play, creep, out = given[0], given[0], given[0], [given[0]]
    for start, t_s, a, b in zip(times_s, times_s[1:], given, given[1:]):
        for k in range(50):
            u, dt_s = a + (b - a) * (k + 0.5) / 50, (t_s - start) / 50
            line = u + (line - u) * np.exp(-dt_s / LINE_S[0 if u > line else 1])
            play = max(line - PLAY_MPA, min(line + PLAY_MPA, play))
            creep = play + (creep - play) * np.exp(-dt_s / CREEP[1])
        out.append(play + CREEP[0] * (creep - play))
    return np.array(out)


@pytest.fixture(scope="module")
def lagging(tmp_path_factory):
    """The finger with a memory that `calibrate` finds in a simulated recording."""
    folder = tmp_path_factory.mktemp("lagging")
    path = REPOSITORY / "models/pneunet/pneunet.twin"
    model = softtwin.Model(path)
    tip = model.select(["x", "y", "z"], [int(np.argmin(np.abs(model.undeformed_mm - [115.0, 2.0, 16.0]).sum(axis=1)))])
    times_s = 0.05 * np.arange(500)
    given = 0.045 - 0.025 * np.cos(times_s * (1.0 + 0.02 * times_s)) - 0.015 * np.cos(0.31 * times_s)
    found = tip.predict(acting(times_s, given), 30.0)
    columns = [times_s, given, found.contact_force_n, *found.values[:, :, 0].T]
    header = "t_s,pressure_mpa,measured_force_n,marker1_x_mm,marker1_y_mm,marker1_z_mm"
    np.savetxt(folder / "run.csv", np.transpose(columns), delimiter=",", header=header, comments="")
    (folder / "scene.toml").write_text(SCENE.format(model=path))
    command = [PROGRAMS / "softtwin", "calibrate", "--scene", "scene.toml", "--recording", "run.csv", "--memory", "lagging.twin", "--json"]
    done = subprocess.run([*command, "--out", "found.toml"], cwd=folder, capture_output=True, text=True)
    assert (folder / "lagging.twin").exists(), done.stderr
    kept = {block["block"] for block in json.loads(done.stdout)["memory"]["blocks"] if block["kept"]}
    assert {"line", "creep"} < kept and any("play" in block for block in kept), done.stdout
    return softtwin.Model(folder / "lagging.twin")


def test_line_play_and_creep_agree_along_a_run(lagging):
    tip = lagging.select(["y"], "bottom")
    times_s = np.cumsum(np.r_[0.0, np.tile([0.05, 0.01, 0.3, 0.05], 15), 30.0, 0.05, 0.05])
    readings = {"pressure_mpa": 0.045 + 0.04 * np.sin(3.0 * times_s), "gap_mm": np.full(len(times_s), 30.0)}
    rows, found = along(tip, times_s, readings)
    for name in ("contact_force_n", *tip.observables, "y"):
        expected = np.array([getattr(row, name) for row in rows])
        assert np.abs(np.array([answer[name] for answer in found]) - expected).max() < AGREEMENT * np.ptp(expected), name
    assert np.isfinite(found[0]["force_halfwidth_n"])


def scanned(finger, step_s):
    """Sum of the forces along a run of pressures, as a function of them."""

    def total(pressures):
        def step(past, pressure):
            past, answer = finger.step(past, {"pressure_mpa": pressure, "gap_mm": 30.0}, step_s)
            return past, answer["contact_force_n"]

        return jax.lax.scan(step, finger.rest({"pressure_mpa": pressures[0], "gap_mm": 30.0}), pressures[1:])[1]

    return jax.jit(total)


def test_derivatives_along_a_run_and_what_smoothing_costs(lagging):
    step_s, times_s = 0.05, 0.05 * np.arange(80)
    pressures = 0.05 + 0.03 * np.sin(2.0 * times_s)

    def forces(pressures):
        session = lagging.session()
        return np.array([session.step(t_s, p, 30.0, fields=False).contact_force_n for t_s, p in zip(times_s, pressures)])[1:]

    plain = scanned(lagging.jax(fields=False), step_s)
    np.testing.assert_allclose(plain(pressures), forces(pressures), atol=1e-9)
    slope = np.asarray(jax.jit(jax.grad(lambda p: plain(p).sum()))(pressures))
    for at in (0, 13, 40, 71):
        push = 1e-7 * (np.arange(80) == at)
        numeric = (forces(pressures + push).sum() - forces(pressures - push).sum()) / 2e-7
        assert slope[at] == pytest.approx(numeric, rel=1e-4, abs=1e-5)
    costs = {}
    for width in (1e-5, 1e-4, 1e-3):
        smooth = scanned(lagging.jax(fields=False, play_width=width), step_s)
        costs[width] = float(np.abs(smooth(pressures) - plain(pressures)).max() / np.ptp(plain(pressures)))
    print(json.dumps(costs))
    assert costs[1e-5] < 1e-3 < costs[1e-3] < 0.1, "the smallest width costs little, the largest is seen"


def test_a_finger_is_designed_in_the_example():
    program = REPOSITORY / "clients/python/examples/shape_finger.py"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "clients/python/src"), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run([sys.executable, program], env=environment, capture_output=True, text=True, timeout=3 * PATIENCE_S)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert abs(said["started_at"][0] + 56.5) > 1.0
    assert said["tip_mm"] == pytest.approx(-56.5, abs=0.01) and said["force_n"] == pytest.approx(0.39, abs=1e-4), said
