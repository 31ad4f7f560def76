"""Laws of silicones from Python: the same as the tool's, and usable for a new actuator."""

import json
import subprocess

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS


def curve(mu_mpa, strain):
    """Nominal stress of a neo-Hookean bar, MPa."""
    stretch = 1.0 + strain
    return mu_mpa * (stretch - stretch**-2)


@pytest.fixture
def strip():
    """A tension test with some noise, as a table with the load in kPa."""
    strain = np.linspace(0.0, 1.5, 60)
    noise = np.random.default_rng(3).normal(0.0, 0.001, strain.size)
    return {"strain": strain, "stress [kPa]": 1e3 * (curve(0.1, strain) * (1.0 + 0.05 * strain) + noise)}


def test_a_fit_is_that_of_the_tool(strip, tmp_path):
    rows = "\n".join(f"{e},{s}" for e, s in zip(strip["strain"], strip["stress [kPa]"]))
    path = tmp_path / "strip.csv"
    path.write_text("strain,stress [kPa]\n" + rows + "\n")
    command = [PROGRAMS / "softtwin", "material", "fit", path, "--load", "nominal-stress", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    tool = json.loads(done.stdout)
    in_memory = softtwin.fit_material(softtwin.MaterialTest(strip, strain="strain", stress="stress [kPa]"))
    of_file = softtwin.fit_material(softtwin.MaterialTest(path, stress="stress [kPa]"))
    assert of_file.report == tool
    for key in ("law", "constants", "half_widths_95", "candidates", "stretch_range"):
        assert in_memory.report[key] == tool[key], key
    assert in_memory.report["shear_modulus_mpa"] == pytest.approx(0.1, rel=0.05)
    assert in_memory.half_widths.keys() == in_memory.constants.keys()


def test_units_and_quantities_agree(strip):
    strain = strip["strain"]
    stress = strip["stress [kPa]"]
    by_strain = softtwin.fit_material(softtwin.MaterialTest(strip, strain="strain", stress="stress [kPa]"), law="yeoh")
    table = {"length": 20.0 * (1.0 + strain), "load": 1e-3 * stress * 12.0}
    test = softtwin.MaterialTest(table, "uniaxial", length=("length", "mm"), force=("load", "N"), length_mm=20.0, area_mm2=12.0)
    by_force = softtwin.fit_material(test, law="yeoh")
    assert by_force.law == by_strain.law == "yeoh"
    for name, value in by_strain.constants.items():
        assert by_force.constants[name] == pytest.approx(value, rel=1e-6)
    stretch = np.array([1.0, 1.5, 2.0])
    np.testing.assert_allclose(by_strain.stress_mpa(stretch), curve(0.1, stretch - 1.0) * (0.95 + 0.05 * stretch), atol=0.004)
    assert by_strain.stress_mpa(1.0) == pytest.approx(0.0, abs=1e-9)
    figure = by_strain.plot()
    assert len(figure.axes[0].lines) == 2


def test_wrong_tests_are_refused(strip, tmp_path):
    with pytest.raises(ValueError, match="deformation: expected one of"):
        softtwin.MaterialTest(strip, stress="stress [kPa]")
    with pytest.raises(ValueError, match="load: expected one of stress"):
        softtwin.MaterialTest(strip, strain="strain", stress="stress [kPa]", force="strain")
    with pytest.raises(KeyError, match="no column `eps`"):
        softtwin.MaterialTest(strip, strain="eps", stress="stress [kPa]")
    with pytest.raises(ValueError, match="as many loads"):
        softtwin.MaterialTest({"e": [0.0, 1.0], "s": [0.0]}, strain="e", stress=("s", "MPa"))
    with pytest.raises(ValueError, match="needs the specimen's length_mm"):
        softtwin.fit_material(softtwin.MaterialTest(strip, displacement=("strain", "mm"), stress="stress [kPa]"))
    with pytest.raises(ValueError, match="law: expected one of"):
        softtwin.fit_material(softtwin.MaterialTest(strip, strain="strain", stress="stress [kPa]"), law="hooke")
    with pytest.raises(ValueError, match="no law explains the tests|no constants are stable"):
        nonsense = {"e": np.linspace(0, 1, 40), "s": np.random.default_rng(1).uniform(0.1, 1.0, 40)}
        softtwin.fit_material(softtwin.MaterialTest(nonsense, strain="e", stress=("s", "MPa")))
    with pytest.raises(ValueError, match="nothing.csv"):
        softtwin.fit_material(tmp_path / "nothing.csv")
    with pytest.raises(ValueError, match="expected a test"):
        softtwin.fit_material([])


def test_a_new_actuator_of_a_fitted_silicone(strip, tmp_path):
    law = softtwin.fit_material(softtwin.MaterialTest(strip, strain="strain", stress="stress [kPa]"))
    made = softtwin.Actuator.new(tmp_path / "finger", chambers=2, length_mm=30.0, width_mm=10.0, material=law)
    assert made.report["shear_modulus_mpa"] == pytest.approx(law.report["shear_modulus_mpa"], rel=1e-4)
    assert made.simulate(0.002).displacement_mm.max() > 0.0
    law.save(tmp_path / "silicone.toml")
    command = ["new", "tool/finger", "--chambers", "2", "--length-mm", "30", "--width-mm", "10", "--material", "silicone.toml"]
    done = subprocess.run([PROGRAMS / "softtwin", *command], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for name in ("actuator.toml", "material.toml"):
        mine = (tmp_path / "finger" / name).read_text()
        tools = (tmp_path / "tool/finger" / name).read_text()
        assert tools.split("\n#\n")[-1] == mine.split("\n#\n")[-1]
