"""Training on a folder and on arrays."""

import subprocess

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY

FOLDER = REPOSITORY / "models/pneunet/database"


def test_training_is_that_of_the_tool(tmp_path):
    database = softtwin.Database.read(FOLDER)
    steps = []
    model = softtwin.train(database, progress=steps.append)
    model.save(tmp_path / "python.twin")
    done = subprocess.run([PROGRAMS / "softtwin", "train", "--database", FOLDER, "--out", tmp_path / "tool.twin"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "python.twin").read_bytes() == (tmp_path / "tool.twin").read_bytes()
    assert len(steps) >= 4 and len(database) > 60
    assert set(model.errors) == {"free", "contact"}
    assert all(fit["leave_one_out"] > 0 for fits in model.errors.values() for fit in fits.values())


@pytest.fixture
def beam():
    """A bar of cubes that bends as a parabola: displacement and stress grow with the pressure and with the bar's softness."""
    x, y, z = (axis.ravel() for axis in np.meshgrid(np.arange(11.0), [0.0, 1.0], [0.0, 1.0], indexing="ij"))
    corner = np.arange(10)[:, None] * 4
    cells = {"hexahedron": corner + np.array([0, 4, 6, 2, 1, 5, 7, 3])}
    pressure, softness = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 0.08, 5), [0.8, 1.0, 1.2], indexing="ij"))
    displacement = np.zeros((15, 44, 3))
    displacement[:, :, 1] = -(pressure * softness)[:, None] * x**2
    stress = (pressure * softness)[:, None] * (11.0 - x)
    return dict(
        points_mm=np.stack([x, y, z], axis=1),
        cells=cells,
        inputs={"pressure_mpa": pressure, "softness_1": softness},
        displacement_mm=displacement,
        von_mises_mpa=stress,
        node_sets={"tip": np.flatnonzero(x == 10.0)},
        nominal={"softness_1": 1.0},
    )


def test_a_model_of_arrays_answers_as_they_do(beam):
    database = softtwin.Database(**beam)
    model = softtwin.train(database, observables={"tip_y_mm": {"kind": "position", "points": [[10, 0, 0]], "axis": [0, 1, 0]}})
    assert list(model.inputs) == ["pressure_mpa", "softness_1"] and model.inputs["softness_1"].value == 1.0
    assert model.triangles.shape == (2 * 42, 3) and list(model.node_sets) == ["tip"]
    x = beam["points_mm"][:, 0]
    for pressure, softness in ((0.03, 1.0), (0.05, 0.9), (0.07, 1.13)):
        found = model.predict(pressure, softness_1=softness)
        np.testing.assert_allclose(found.y - beam["points_mm"][:, 1], -pressure * softness * x**2, atol=2e-3)
        np.testing.assert_allclose(found.von_mises, pressure * softness * (11.0 - x), atol=5e-3)
        assert found.observables["tip_y_mm"] == pytest.approx(-100 * pressure * softness, abs=2e-3)
    assert model.predict(0.05).observables["tip_y_mm"] == pytest.approx(-5.0, abs=2e-3)


def test_meshes_of_meshio_will_do(beam):
    meshio = pytest.importorskip("meshio", reason="meshio is not installed; pip install softtwin[convert]")
    mesh = meshio.Mesh(beam.pop("points_mm"), beam.pop("cells"))
    assert len(softtwin.Database(mesh, **beam)) == 15


def test_arrays_that_do_not_fit_are_refused(beam):
    for change, text in (
        ({"displacement_mm": np.zeros((15, 43, 3))}, "displacement_mm"),
        ({"von_mises_mpa": np.zeros((14, 44))}, "von_mises_mpa"),
        ({"inputs": {"softness_1": np.ones(15)}}, "pressure_mpa"),
        ({"inputs": {"pressure_mpa": np.ones(15), "softness_1": np.full(15, np.nan)}}, "softness_1"),
        ({"cells": {"hexahedron": np.full((1, 8), 44)}}, "node 44"),
        ({"cells": {"tetrahedron": np.zeros((1, 4), int)}}, "tetra"),
    ):
        with pytest.raises(ValueError, match=text):
            softtwin.Database(**{**beam, **change})
    with pytest.raises(ValueError, match="observables"):
        softtwin.train(softtwin.Database(**beam), observables={"tip_y_mm": {"kind": "warmth"}})
    with pytest.raises(FileNotFoundError):
        softtwin.Database.read("nowhere")
