"""A model as an FMU in FMPy: valid, in agreement with `softtwin predict`, with errors for invalid input."""

import json
import pathlib
import re
import subprocess
import sys
import xml.etree.ElementTree
import zipfile

import fmpy
import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY
from fmpy.fmi3 import FMU3Model, FMU3Slave, fmi3LogMessageCallback
from fmpy.validation import validate_fmu

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
STATES = [(0.0, 30.0), (0.05, 30.0), (0.0817, 12.5), (0.05, np.inf), (0.12, 200.0)]


def tool(*arguments):
    return subprocess.run([PROGRAMS / "softtwin", *map(str, arguments)], capture_output=True, text=True)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "finger.fmu"
    done = tool("export", MODEL, "--out", path, "--node", "tip=9696", "--node", "first=0", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["nodes"] == {"tip": 9696, "first": 0}
    return path


class Twin:
    """Instance with its variables by name and its log messages."""

    def __init__(self, archive, folder, kind=FMU3Slave, token=None):
        self.description = fmpy.read_model_description(archive)
        self.number = {v.name: v.valueReference for v in self.description.modelVariables}
        fmpy.extract(archive, folder)
        self.said = []
        self._log = fmi3LogMessageCallback(lambda _env, status, _category, text: self.said.append((status, text.decode())))
        self.fmu = kind(
            guid=token or self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="finger",
        )

    def start(self):
        self.fmu.instantiate(logMessage=self._log)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def put(self, **values):
        self.fmu.setFloat64([self.number[name] for name in values], list(values.values()))

    def get(self, *names):
        return self.fmu.getFloat64([self.number[name] for name in names])

    def status(self, name):
        return self.fmu.getInt32([self.number[name]])[0]


@pytest.fixture
def twin(archive, tmp_path):
    made = Twin(archive, tmp_path / "fmu").start()
    yield made
    made.fmu.terminate()
    made.fmu.freeInstance()


def test_the_archive_is_valid_and_self_contained(archive, tmp_path):
    assert validate_fmu(str(archive)) == []
    description = fmpy.read_model_description(archive, validate=True)
    assert description.fmiVersion == "3.0" and description.modelExchange and description.coSimulation
    again = tmp_path / "again.fmu"
    assert tool("export", MODEL, "--out", again, "--node", "tip=9696", "--node", "first=0").returncode == 0
    assert again.read_bytes() == archive.read_bytes(), "the same model gives the same bytes"
    units = xml.etree.ElementTree.fromstring(zipfile.ZipFile(archive).read("modelDescription.xml")).iter("Unit")
    assert {"MPa", "mm", "N", "N/MPa", "N/mm"} <= {unit.get("name") for unit in units}


def test_outputs_agree_with_predict(twin, tmp_path):
    model = softtwin.Model(MODEL)
    time_s = 0.0
    for pressure_mpa, gap_mm in STATES:
        twin.put(pressure_mpa=pressure_mpa, gap_mm=gap_mm)
        twin.fmu.doStep(currentCommunicationPoint=time_s, communicationStepSize=0.01)
        time_s += 0.01
        gap = [] if np.isinf(gap_mm) else ["--gap", gap_mm]
        done = tool("predict", MODEL, "--json", "--pressure", pressure_mpa, *gap, "--out", tmp_path / "state.npy")
        said, fields = json.loads(done.stdout), np.load(tmp_path / "state.npy")
        assert twin.get("contact_force_n", "force_by_pressure_mpa", "force_by_gap_mm", "domain_distance") == [
            said["contact_force_n"],
            said["force_by_pressure_n_per_mpa"],
            said["force_by_gap_n_per_mm"],
            said["domain_distance"],
        ]
        assert twin.get("onset_pressure_mpa")[0] == (np.inf if said["onset_pressure_mpa"] is None else said["onset_pressure_mpa"])
        # Outside the training range there are none: null in JSON, NaN here.
        widths = [said["half_widths"][name] for name in ("force_n", "displacement_mm", "stress_mpa")]
        widths = [np.nan if width is None else width for width in widths]
        found = twin.get("force_halfwidth_n", "displacement_halfwidth_mm", "von_mises_halfwidth_mpa")
        assert np.array_equal(found, widths, equal_nan=True)
        assert np.isnan(widths[1]) != said["in_domain"]
        for name, one in said["observables"].items():
            width = np.nan if one["half_width"] is None else one["half_width"]
            assert twin.get(name, f"{name}_halfwidth") == pytest.approx([one["value"], width], rel=1e-12, nan_ok=True)
        assert twin.get("max_von_mises_mpa")[0] == np.float32(said["max_von_mises_mpa"])
        for name, node in (("tip", 9696), ("first", 0)):
            assert twin.get(*(f"{name}.{field}" for field in model.fields)) == pytest.approx(fields[node].tolist(), abs=3e-4)
        assert ["inside", "near", "outside"][twin.status("domain_status")] == said["domain"]
        assert ["free", "contact"][twin.status("regime") - 1] == said["regime"]
    assert twin.said == []
    # Far outside there is no answer.
    twin.put(pressure_mpa=0.3, gap_mm=5.0)
    with pytest.raises(fmpy.fmi1.FMICallException):
        twin.get("contact_force_n")
    assert "pressure_mpa" in twin.said[-1][1]


def test_nan_is_refused_and_the_previous_value_kept(twin):
    twin.put(pressure_mpa=0.05, gap_mm=30.0)
    before = twin.get("contact_force_n")
    for wrong in (dict(pressure_mpa=np.nan), dict(gap_mm=np.nan), dict(pressure_mpa=np.inf), dict(contact_force_n=1.0)):
        with pytest.raises(fmpy.fmi1.FMICallException):
            twin.put(**wrong)
        assert twin.get("contact_force_n") == before
    assert [status for status, _ in twin.said] == [3] * 4
    assert "pressure_mpa: expected a number, found NaN" in twin.said[0][1] and "is no input" in twin.said[3][1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        twin.fmu.getFloat64([5000])
    with pytest.raises(fmpy.fmi1.FMICallException):
        twin.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=-1.0)
    twin.fmu.reset()
    assert twin.get("pressure_mpa") == [0.0]


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_fmpy_simulates_it(archive, kind):
    signals = np.array([(0.0, 0.0, 30.0), (1.0, 0.08, 30.0)], [("time", float), ("pressure_mpa", float), ("gap_mm", float)])
    found = fmpy.simulate_fmu(
        str(archive), fmi_type=kind, stop_time=1.0, output_interval=0.1, input=signals, solver="Euler", output=["contact_force_n", "pressure_mpa"]
    )
    expected = softtwin.Model(MODEL).predict(found["pressure_mpa"], 30.0, fields=False).contact_force_n
    assert found["contact_force_n"][-1] > 0.5 and len(found) >= 10
    if kind == "CoSimulation":
        np.testing.assert_array_equal(found["contact_force_n"], expected)
    else:
        np.testing.assert_allclose(found["contact_force_n"], expected, atol=1e-12)


def test_own_inputs_change_between_steps(tmp_path):
    path = tmp_path / "stiffness.fmu"
    model = softtwin.Model(REPOSITORY / "models/pneunet-design/pneunet-design.twin")
    name = "elastomer.law.mu_mpa"
    assert tool("export", REPOSITORY / "models/pneunet-design/pneunet-design.twin", "--out", path).returncode == 0
    made = Twin(path, tmp_path / "fmu").start()
    (described,) = [v for v in made.description.modelVariables if v.name == name]
    assert (described.causality, described.variability) == ("input", "continuous")
    assert float(described.start) == model.inputs[name].value
    low, high = model.inputs[name].min, model.inputs[name].max
    for step, stiffness in enumerate([low, 0.5 * (low + high), high]):
        made.put(pressure_mpa=0.05, gap_mm=30.0, **{name: stiffness})
        made.fmu.doStep(currentCommunicationPoint=0.01 * step, communicationStepSize=0.01)
        expected = model.predict(0.05, 30.0, fields=False, **{name: stiffness})
        assert made.get("contact_force_n", f"force_by_{name}") == [expected.contact_force_n, expected.force_gradient[name]]
    made.fmu.terminate()
    made.fmu.freeInstance()


@pytest.fixture(scope="module")
def two_cavities(tmp_path_factory):
    """Model of four nodes that bend down with `pressure_mpa` and up with `pressure_mpa.left`."""
    folder = tmp_path_factory.mktemp("two")
    steps = np.linspace(0.0, 0.04, 4)
    states = [(p, q) for p in steps for q in steps]
    at = np.array([[0, 0, 0], [10, 0, 0], [10, 2, 0], [10, 0, 2]], dtype=np.float32)
    bent = lambda p, q: at + at[:, :1] * np.array([0.0, 4.0 * (q - p) - 20.0 * (p + q) * (p - q), 0.0])
    np.save(folder / "snapshots.npy", np.array([bent(p, q) for p, q in states], dtype=np.float32))
    rows = [f"s{k},free,train,{p!r},,{q!r}" for k, (p, q) in enumerate(map(lambda s: tuple(map(float, s)), states))]
    (folder / "cases.csv").write_text("\n".join(["case,regime,split,pressure_mpa,gap_mm,pressure_mpa.left", *rows]) + "\n")
    fields = "".join(f'[[field]]\nname = "{axis}"\nunit = "mm"\nkind = "coordinate"\n' for axis in "xyz")
    (folder / "database.toml").write_text(
        'layout = 1\nactuator = "two"\nnodes = 4\ncases = "cases.csv"\nsnapshots = "snapshots.npy"\n'
        f'{fields}[[input]]\nname = "pressure_mpa"\nunit = "MPa"\n[[input]]\nname = "gap_mm"\nunit = "mm"\n'
        '[[input]]\nname = "pressure_mpa.left"\nunit = "MPa"\nnominal = 0.0\n'
    )
    done = tool("train", "--database", folder, "--out", folder / "two.twin")
    assert done.returncode == 0, done.stderr
    return folder / "two.twin"


def test_pressures_of_all_cavities_are_inputs(two_cavities, tmp_path):
    model = softtwin.Model(two_cavities)
    up, down = model.predict(0.0, pressure_mpa_left=0.03), model.predict(0.03, **{"pressure_mpa.left": 0.0})
    assert up.y[1] > 1.0 and down.y[1] < -1.0
    np.testing.assert_array_equal(model.predict(0.03).y, down.y)
    assert tool("export", two_cavities, "--out", tmp_path / "two.fmu", "--node", "tip=1").returncode == 0
    made = Twin(tmp_path / "two.fmu", tmp_path / "fmu").start()
    causality = {v.name: v.causality for v in made.description.modelVariables}
    assert causality["pressure_mpa"] == causality["pressure_mpa.left"] == "input"
    for step, (right, left) in enumerate([(0.01, 0.03), (0.03, 0.01)]):
        made.put(pressure_mpa=right, **{"pressure_mpa.left": left})
        made.fmu.doStep(currentCommunicationPoint=0.01 * step, communicationStepSize=0.01)
        assert made.get("tip.y") == [pytest.approx(float(model.predict(right, pressure_mpa_left=left).y[1]), abs=1e-6)]
    made.fmu.terminate()
    made.fmu.freeInstance()


def test_a_recording_is_an_input(archive, live, tmp_path):
    record = [PROGRAMS / "softtwin", "record", "softtwin/finger/state", "--seconds", "1", "--out", tmp_path / "run.mcap"]
    assert subprocess.run(record, env=live.environment(), capture_output=True).returncode == 0
    done = tool("export", tmp_path / "run.mcap", "--fmi", "--out", tmp_path / "tables")
    assert done.returncode == 0, done.stderr
    recorded = fmpy.read_csv(tmp_path / "tables/softtwin.finger.state.csv")
    assert recorded["time"][0] == 0.0 and (np.diff(recorded["time"]) > 0).all() and len(recorded) > 100
    signals = recorded[["time", "pressure_mpa", "gap_mm"]]
    found = fmpy.simulate_fmu(
        str(archive), fmi_type="CoSimulation", input=signals, stop_time=recorded["time"][-1], output_interval=0.01, output=["contact_force_n"]
    )
    nearest = np.interp(found["time"], recorded["time"], recorded["contact_force_n"])
    # FMPy sets the inputs at the beginning of a step and writes the outputs down at its end.
    np.testing.assert_allclose(found["contact_force_n"][1:], nearest[:-1], atol=1e-3)


@pytest.mark.parametrize("what", ["missing", "broken", "another", "nodes"])
def test_damaged_resources_are_reported(archive, tmp_path, what):
    made = Twin(archive, tmp_path / "fmu", token="another" if what == "another" else None)
    path = tmp_path / "fmu" / "resources" / "model.twin"
    if what == "missing":
        path.unlink()
    if what == "broken":
        path.write_bytes(path.read_bytes()[:5000])
    if what == "nodes":
        path.with_name("nodes.txt").write_text("tip\n")
    with pytest.raises(Exception, match="nstantiate"):
        made.start()
    expected = {
        "missing": "No such file",
        "broken": "model.twin",
        "another": "belongs to another model",
        "nodes": "nodes.txt, line 1: expected NAME NUMBER",
    }
    assert expected[what] in made.said[0][1], made.said


def test_the_valve_reaches_its_force(archive):
    program = REPOSITORY / "clients/fmi/valve.py"
    done = subprocess.run([sys.executable, program, archive, "--seconds", "2"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert abs(float(done.stdout.split()[0]) - 0.3) < 0.005 and done.stdout.strip().endswith("domain 0"), done.stdout


def test_invalid_export_options_are_refused(tmp_path):
    for arguments, expected in [
        (["--node", "tip=25022"], "the model has 25022 nodes"),
        (["--node", "tip"], "expected NAME=NUMBER"),
        (["--node", "a=1", "--node", "a=2"], "expected every name once"),
    ]:
        done = tool("export", MODEL, "--out", tmp_path / "x.fmu", *arguments)
        assert done.returncode == 2 and expected in done.stderr, done.stderr
        assert not (tmp_path / "x.fmu").exists()
    done = tool("export", MODEL, "--out", tmp_path / "x.pvd", "--node", "a=1")
    assert done.returncode == 2 and "--out FILE.fmu" in done.stderr


def test_the_declarations_are_those_of_the_standard_and_of_the_library(archive, tmp_path):
    """FMPy has the headers of FMI 3.0: a compiler that reads both refuses declarations that differ."""
    text = zipfile.ZipFile(archive).read("documentation/softtwin_fmi3.h").decode()
    (tmp_path / "softtwin_fmi3.h").write_text(text)
    standard = pathlib.Path(fmpy.__file__).parent / "c-code"
    compiler = ["cc", "-std=c11", "-Wall", "-Werror", "-fsyntax-only", f"-I{standard}", f"-I{tmp_path}", "-xc", "-"]
    for before in ("", '#include "fmi3Functions.h"\n'):
        done = subprocess.run(compiler, input=before + '#include "softtwin_fmi3.h"\n', capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    declared = re.findall(r"\b(fmi3\w+)\(", text.split("Begin, end, modes")[1])
    (binary,) = [name for name in zipfile.ZipFile(archive).namelist() if name.startswith("binaries/")]
    library = zipfile.ZipFile(archive).extract(binary, tmp_path)
    symbols = subprocess.run(["nm", "--dynamic", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    exported = [line.split()[-1] for line in symbols.splitlines() if line.split()[-1].startswith("fmi3")]
    functions = re.findall(r"TYPE\s+(fmi3\w+);", (standard / "fmi3Functions.h").read_text())
    assert sorted(declared) == sorted(exported) == sorted(functions)
