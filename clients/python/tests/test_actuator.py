"""Finite elements from Python: the states of the tool."""

import json
import subprocess

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS


def tool(folder, *arguments):
    done = subprocess.run([PROGRAMS / "softtwin", *map(str, arguments)], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("block")
    tool(made, "new", "block", "--chambers", "2", "--length-mm", "30", "--width-mm", "10", "--shear-modulus-mpa", "0.2")
    tool(made, "mesh", "--actuator", "block/actuator.toml")
    return made / "block"


def test_states_are_those_of_the_tool(folder):
    actuator = softtwin.Actuator.read(folder / "actuator.toml")
    found = actuator.simulate(0.01)
    said = json.loads(tool(folder, "simulate", "--actuator", "actuator.toml", "--pressure", "0.01", "--out", "state.npy"))
    state = np.load(folder / "state.npy")
    np.testing.assert_allclose(found.coordinates_mm, state[:, :3], atol=1e-5)
    np.testing.assert_allclose(found.von_mises_mpa, state[:, 4], rtol=1e-5, atol=1e-7)
    assert found.cavity_volume_mm3 == pytest.approx(said["cavity_volume_mm3"], rel=1e-9)
    assert found.contact_force_n == 0.0 and found.residual_n < 1e-4
    moved = np.linalg.norm(found.coordinates_mm - actuator.points_mm, axis=1)
    np.testing.assert_allclose(moved, found.displacement_mm, atol=1e-12)
    assert found.mesh.n_points == len(actuator.points_mm) and found.mesh.n_cells == len(actuator.cells)


def test_softer_silicone_bends_more(folder):
    actuator = softtwin.Actuator.read(folder / "actuator.toml")
    nominal = actuator.simulate(0.005).displacement_mm.max()
    softer = actuator.simulate(0.005, **{"elastomer.law.mu_mpa": 0.15}).displacement_mm.max()
    assert softer > 1.15 * nominal


def test_wrong_actuators_quantities_and_loads_are_refused(folder, tmp_path):
    with pytest.raises(FileNotFoundError):
        softtwin.Actuator.read(tmp_path / "actuator.toml")
    actuator = softtwin.Actuator.read(folder / "actuator.toml")
    with pytest.raises(ValueError, match="warmth"):
        actuator.simulate(0.005, warmth=1.0)
    with pytest.raises(ValueError, match="pressure"):
        actuator.simulate(float("nan"))


SHAPE = dict(chambers=2, length_mm=30.0, width_mm=10.0, shear_modulus_mpa=0.2)


def test_a_new_actuator_is_that_of_the_tool(folder, tmp_path):
    made = softtwin.Actuator.new(tmp_path / "block", **SHAPE)
    mine, tools = ((place / "actuator.toml").read_text().splitlines() for place in (tmp_path / "block", folder))
    assert mine[3:] == tools[3:]  # above them is how to build it, with its folder
    assert (made.report["chambers"], made.report["length_mm"]) == (2, 30.0) and made.report["sag_mm"] > 0.0
    assert made.simulate(0.005).displacement_mm.max() > 0.0
    with pytest.raises(ValueError, match="expected a new or an empty folder"):
        softtwin.Actuator.new(tmp_path / "block", **SHAPE)
    with pytest.raises(ValueError, match="chambers: expected 1 to 100, found 0"):
        softtwin.Actuator.new(tmp_path / "none", chambers=0)
    with pytest.raises(ValueError, match="wall_mm 8: leaves cavities"):
        softtwin.Actuator.new(tmp_path / "none", wall_mm=8.0)
    with pytest.raises(ValueError, match="expected one of silicone"):
        softtwin.Actuator.new(tmp_path / "none", shore_a=10, shear_modulus_mpa=0.1)
    with pytest.raises(ValueError, match="dragon-skin-30"):
        softtwin.Actuator.new(tmp_path / "none", silicone="butter")
    assert not (tmp_path / "none").exists()
    sheet = softtwin.Actuator.new(tmp_path / "sheet", chambers=2, length_mm=30.0, width_mm=10.0, shore_a=30.0, elongation_percent=300.0)
    assert len(sheet.report["shear_interval_mpa"]) == 2
