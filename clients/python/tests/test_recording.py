"""Learning from frames and comparing with them: the same as the commands do with files."""

import json
import pickle
import subprocess

import numpy as np
import pandas as pd
import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY

DATA = REPOSITORY / "benchmarks/data"
CHANNELS = {
    "time": "time_s",
    "inputs": {"stroke_mm": "stroke_mm", "pressure_mpa": "pressure_mpa"},
    "outputs": {"force_n": "force_n"},
}
MAPPING = """
[time]
column = "time_s"
unit = "s"
[[input]]
name = "stroke_mm"
column = "stroke_mm"
unit = "mm"
[[input]]
name = "pressure_mpa"
column = "pressure_mpa"
unit = "MPa"
[[output]]
name = "force_n"
column = "force_n"
unit = "N"
"""


@pytest.fixture(scope="module")
def runs():
    return [pd.read_csv(DATA / f"cylinder_{at}.csv") for at in (1, 2)]


@pytest.fixture(scope="module")
def learned(runs):
    return softtwin.learn(runs[0], **CHANNELS)


def tool(folder, *arguments):
    done = subprocess.run([PROGRAMS / "softtwin", *map(str, arguments), "--json"], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_learning_and_comparison_are_those_of_the_tool(runs, learned, tmp_path):
    mapping, model = tmp_path / "log.toml", tmp_path / "tool.twin"
    mapping.write_text(MAPPING)
    said = tool(tmp_path, "learn", DATA / "cylinder_1.csv", "--log", mapping, "--out", model)
    assert learned.report["outputs"]["force_n"] == said["outputs"]["force_n"]
    found = learned.compare(runs[1], **CHANNELS)
    compared = tool(tmp_path, "compare", model, "--recording", DATA / "cylinder_2.csv", "--log", mapping, "--out", tmp_path / "out")
    assert found.rms["force_n"] == compared["outputs"]["force_n"]["rms"] > 0
    assert found.coverage["force_n"] == compared["outputs"]["force_n"]["coverage"]
    assert found.to_frame().loc["force_n", "rms"] == found.rms["force_n"]
    error = found.measured["force_n"] - found.predicted["force_n"]
    assert np.sqrt(np.nanmean(error**2)) == pytest.approx(found.rms["force_n"])


def test_a_learned_model_is_saved_copied_and_stepped(learned, tmp_path):
    copied = pickle.loads(pickle.dumps(learned))
    learned.save(tmp_path / "mine.twin")
    opened = softtwin.Model(tmp_path / "mine.twin")
    sessions = [model.session() for model in (learned, copied, opened)]
    for at in range(50):
        given = {"stroke_mm": 10 * np.sin(0.1 * at) ** 2, "pressure_mpa": 0.3}
        values = [session.step(0.1 * at, **given).values.tobytes() for session in sessions]
        assert values[0] == values[1] == values[2]
    assert learned.report and opened.report is None


@pytest.mark.parametrize("reader", ["pandas", "polars", "dict"])
def test_any_frame_in_any_unit_is_the_same_run(runs, learned, reader):
    table = {"t": runs[0].time_s, "s": runs[0].stroke_mm, "p [kPa]": 1e3 * runs[0].pressure_mpa, "F": 1e3 * runs[0].force_n}
    if reader == "pandas":
        table = pd.DataFrame(table)
    elif reader == "polars":
        table = pytest.importorskip("polars").DataFrame({name: np.array(values) for name, values in table.items()})
    again = softtwin.learn(table, time="t", inputs={"stroke_mm": "s", "pressure_mpa": "p [kPa]"}, outputs={"force_n": ("F", "mN")})
    assert again.report["rows"] == learned.report["rows"]
    assert again.report["outputs"]["force_n"]["rms"] == pytest.approx(learned.report["outputs"]["force_n"]["rms"], rel=1e-6)


def test_what_cannot_be_a_run_is_refused(runs):
    frame = runs[0]
    with pytest.raises(KeyError, match="no column `p`; there are time_s"):
        softtwin.Recording(frame, time="time_s", inputs={"pressure_mpa": "p"}, outputs=CHANNELS["outputs"])
    with pytest.raises(ValueError, match="cannot be converted to mpa"):
        softtwin.Recording(frame, time="time_s", inputs={"pressure_mpa": ("pressure_mpa", "mm")}, outputs=CHANNELS["outputs"])
    with pytest.raises(ValueError, match="unit at its end"):
        softtwin.Recording(frame, time="time_s", inputs={"pressure": "pressure_mpa"}, outputs=CHANNELS["outputs"])
    with pytest.raises(ValueError, match="rise from row to row"):
        softtwin.Recording(frame[::-1], **CHANNELS)
    with pytest.raises(ValueError, match="pandas.to_numeric"):
        softtwin.Recording(frame.assign(force_n="1,5"), **CHANNELS)
    with pytest.raises(ValueError, match="no input moves"):
        softtwin.learn(frame.assign(stroke_mm=1.0, pressure_mpa=0.05), **CHANNELS)
    with pytest.raises(ValueError, match="the same inputs and outputs"):
        other = softtwin.Recording(frame, time="time_s", inputs={"stroke_mm": "stroke_mm"}, outputs=CHANNELS["outputs"])
        softtwin.learn([softtwin.Recording(frame, **CHANNELS), other])


def test_a_learned_model_runs_as_a_twin(stage, learned):
    with softtwin.Twin(learned, name="cylinder", bus=stage.bus) as twin:
        states, fields = twin.subscribe("state", timeout_s=60), twin.subscribe("field", timeout_s=60)
        sent = twin.send(0.3, stroke_mm=10.0)
        state = next(state for state in states if state.sensor_seq == sent)
        assert state.input_values["stroke_mm"] == (10.0, "measured")
        field = next(field for field in fields if field.header.sensor_seq == sent)
        session = learned.session()
        np.testing.assert_allclose(field.values, session.step(0.0, 0.3, stroke_mm=10.0).values)
    with pytest.raises(softtwin.TwinSilent):
        twin.subscribe("state", timeout_s=0.1, wait_for_twin=True).next()


def test_a_twin_that_cannot_start_says_why(stage, learned):
    with softtwin.Twin(learned, name="cylinder", bus=stage.bus):
        with pytest.raises(softtwin.SofttwinError, match="did not start"):
            softtwin.Twin(learned, name="cylinder", bus=stage.bus)
