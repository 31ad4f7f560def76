"""Names of regimes that are a model's own: in this process, from a running twin, after a reload, and without any twin."""

import signal
import subprocess
import time

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS
from test_live import WAIT_S

DATABASE = """
layout = 1
actuator = "strip"
nodes = 3
cases = "cases.csv"
snapshots = "snapshots.npy"
[[field]]
name = "y"
unit = "mm"
kind = "coordinate"
[[input]]
name = "pressure_mpa"
unit = "MPa"
"""


def train(folder, names):
    """A strip that is straight up to 0.05 MPa and bent beyond; the model calls the two regimes so."""
    pressures = np.linspace(0.0, 0.1, 24)
    bent = pressures > 0.05
    snapshots = np.outer(pressures + 5.0 * bent, [1.0, 2.0, 3.0]).astype(np.float32)[..., None]
    rows = [f"c{at},{names[int(of)]},train,{p:.6f}" for at, (p, of) in enumerate(zip(pressures, bent))]
    database = folder / "database"
    database.mkdir(exist_ok=True)
    (database / "database.toml").write_text(DATABASE)
    (database / "cases.csv").write_text("case,regime,split,pressure_mpa\n" + "\n".join(rows) + "\n")
    np.save(database / "snapshots.npy", snapshots)
    path = folder / "strip.twin"
    command = [PROGRAMS / "softtwin", "train", "--database", database, "--out", path]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture
def strip(stage):
    """A twin of the strip that takes readings from here."""
    model = train(stage.folder, ["straight", "bent"])
    outputs = '[[actuator.output]]\nnodes = "all"'
    child = stage.twin(
        stage.scene(f'name = "py"\n[[actuator]]\nname = "strip"\nmodel = "{model}"\nqueries = "fields"\n{outputs}\n')
    )
    return stage, child, softtwin.SensorPublisher("strip", bus=stage.bus)


def after(topic, seq):
    """The first sample that stands for this reading."""
    return next(sample for sample in topic if getattr(sample, "header", sample).sensor_seq == seq)


def test_a_model_in_this_process_says_its_own_names(tmp_path):
    model = softtwin.Model(train(tmp_path, ["straight", "bent"]))
    assert model.regimes == {3: "straight", 4: "bent"} == model.select(nodes=[1]).regimes
    assert model.predict(0.02).regime == "straight"
    assert model.predict([0.02, 0.08]).regime.tolist() == ["straight", "bent"]


def test_states_fields_and_answers_say_the_names_of_their_model(strip):
    stage, child, sensor = strip
    states, fields = (softtwin.subscribe(f"softtwin/strip/{kind}", timeout_s=WAIT_S, bus=stage.bus) for kind in ("state", "field"))
    seq = sensor.send(0.08)
    state, field = after(states, seq), after(fields, seq)
    assert (state.regime, state.regime_name, field.header.regime_name) == (4, "bent", "bent")
    assert state.name_of("regime") == "regime 4" and state.to_dict()["regime"] == 4, "the number and its name stay"
    twin = softtwin.Client("strip", timeout_s=WAIT_S, bus=stage.bus)
    assert twin.whatif(0.02).regime_name == "straight" == twin.whatif(0.02, field="all").header.regime_name
    # Another model, by SIGHUP: the same numbers, other names.
    train(stage.folder, ["rest", "raised"])
    child.send_signal(signal.SIGHUP)
    wait_said(stage, "reloaded")
    seq = sensor.send(0.08)
    state, field = after(states, seq), after(fields, seq)
    assert (state.regime, state.regime_name, field.header.regime_name) == (4, "raised", "raised")
    assert stage.bus.regimes.name(bytes(state.model_hash), 3) == "rest"
    stage.stop(child)
    assert stage.bus.regimes.name(bytes(state.model_hash), 3) == "rest", "known names stay"


def test_without_a_twin_the_number_stands_for_the_name(stage, monkeypatch):
    state = softtwin.State(regime=3)
    looked_up = []
    told = stage.bus.regimes._told
    monkeypatch.setattr(stage.bus.regimes, "_told", lambda model: looked_up.append(model) or told(model))
    monkeypatch.setattr("softtwin.regimes._RETRY_S", 1e9)
    for _ in range(3):
        stage.bus.regimes.put(state)
    assert state.regime_name == "regime 3" and len(looked_up) == 1, "a model is not looked up for every sample"
    for number, name in [(0, "unknown"), (1, "free"), (2, "contact")]:
        stage.bus.regimes.put(free := softtwin.State(regime=number, model_hash=(softtwin.layout.u8 * 16)(7)))
        assert free.regime_name == name and len(looked_up) == 1
    assert softtwin.Health().regime_name == "unknown"


def wait_said(stage, text):
    """Waits until the twin's log has a text."""
    log, end = stage.folder / "0.log", time.monotonic() + WAIT_S
    while text not in log.read_text():
        assert stage.programs[0].poll() is None and time.monotonic() < end, log.read_text()
