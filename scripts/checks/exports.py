"""Exports read by an independent reader (meshio), imports of files it wrote. See scripts/check.sh."""
import argparse
import json
import os
import pathlib
import re
import subprocess
import tempfile
import xml.etree.ElementTree

import meshio
import numpy

MODEL = "models/pneunet/pneunet.twin"
DATABASE = "models/pneunet/database"
MESH = "models/pneunet/database/mesh.vtu"
PRESSURES = [0.02, 0.05]
GAP = 40.0
CHECKS = []


def check(function):
    CHECKS.append(function)
    return function


class Work:
    def __init__(self, programs, folder):
        self.programs, self.folder = pathlib.Path(programs).resolve(), pathlib.Path(folder)

    def run(self, *arguments, code=0):
        ended = subprocess.run([self.programs / "softtwin", *map(str, arguments)], capture_output=True, text=True)
        assert ended.returncode == code, f"{arguments}: {ended.returncode}\n{ended.stderr}"
        return ended

    def state(self, pressure):
        """The exported state as `predict` writes it: nodes x (x, y, z, displacement, stress)."""
        out = self.folder / f"state{pressure}.npy"
        if not out.exists():
            self.run("predict", MODEL, "--json", "--pressure", pressure, "--gap", GAP, "--out", out)
        return numpy.load(out)

    def sweep(self, name, *more):
        out = self.folder / name
        pressures = ",".join(map(str, PRESSURES))
        self.run("export", MODEL, "--pressure", pressures, "--gap", GAP, "--out", out, *more)
        return out


def same(mesh, state, cells):
    """Points, both quantities and the kind of cells are those of the state, to the last bit of single precision."""
    assert [block.type for block in mesh.cells] == [cells], mesh.cells
    assert (mesh.points.astype(numpy.float32) == state[:, :3]).all(), numpy.abs(mesh.points - state[:, :3]).max()
    data = {re.split(r"[ _]\[", name)[0]: values for name, values in mesh.point_data.items()}
    for name, column in (("displacement", 3), ("von_mises", 4)):
        assert (data[name].ravel().astype(numpy.float32) == state[:, column]).all(), name


@check
def paraview_series(work):
    out = work.sweep("sweep.pvd", "--mesh", MESH)
    sets = xml.etree.ElementTree.parse(out).getroot().findall("./Collection/DataSet")
    assert [float(one.get("timestep")) for one in sets] == [0.0, 1.0]
    reference = meshio.read(MESH)
    for one, pressure in zip(sets, PRESSURES):
        mesh = meshio.read(work.folder / one.get("file"))
        same(mesh, work.state(pressure), "tetra10")
        assert (mesh.cells[0].data == reference.cells[0].data).all()
        vector = mesh.point_data["displacement vector [mm]"]
        assert numpy.abs(vector - (mesh.points - reference.points)).max() < 2e-5
    alone = work.folder / "alone.vtu"
    work.run("predict", MODEL, "--json", "--pressure", PRESSURES[0], "--gap", GAP, "--out", alone)
    same(meshio.read(alone), work.state(PRESSURES[0]), "triangle")


@check
def tecplot_zones(work):
    """meshio reads one zone and knows nothing of time, so each zone is given to it alone and without."""
    text = work.sweep("sweep.dat", "--mesh", MESH).read_text()
    head, *zones = text.split("ZONE ")
    assert len(zones) == 2 and 'SOLUTIONTIME=1' in zones[1], [zone[:120] for zone in zones]
    quadratic = meshio.read(MESH).cells[0].data
    for zone, pressure in zip(zones, PRESSURES):
        path = work.folder / "zone.dat"
        path.write_text(head + "ZONE " + re.sub(r"STRANDID=\d+, SOLUTIONTIME=\S+, ", "", zone))
        mesh = meshio.read(path, file_format="tecplot")
        same(mesh, work.state(pressure), "tetra")
        assert len(mesh.cells[0].data) == 8 * len(quadratic)
        corners = mesh.points[mesh.cells[0].data]
        edges = corners[:, 1:] - corners[:, :1]
        assert (numpy.linalg.det(edges) > 0).mean() > 0.999, "linear parts keep their orientation"


@check
def xdmf_series(work):
    """meshio's series reader expects points that stay; ours move, so each grid is read alone."""
    path = work.sweep("sweep.xdmf", "--mesh", MESH)
    root = xml.etree.ElementTree.parse(path).getroot()
    grids = root.findall("./Domain/Grid/Grid")
    assert [float(grid.find("Time").get("Value")) for grid in grids] == [0.0, 1.0]
    for grid, pressure in zip(grids, PRESSURES):
        grid.remove(grid.find("Time"))
        alone = xml.etree.ElementTree.Element("Xdmf", Version="3.0")
        xml.etree.ElementTree.SubElement(alone, "Domain").append(grid)
        one = work.folder / "one.xdmf"
        xml.etree.ElementTree.ElementTree(alone).write(one)
        same(meshio.read(one), work.state(pressure), "tetra10")


@check
def numpy_and_csv(work):
    states = numpy.stack([work.state(pressure) for pressure in PRESSURES])
    stacked = numpy.load(work.sweep("sweep.npy"))
    assert stacked.dtype == numpy.float32 and (stacked == states).all()
    table = numpy.genfromtxt(work.sweep("sweep.csv"), delimiter=",", names=True)
    fields = ("x_mm", "y_mm", "z_mm", "displacement_mm", "von_mises_mpa")
    observables = ("bending_angle_deg", "chord_angle_deg", "tip_x_mm", "tip_y_mm")
    assert table.dtype.names == ("time", "node", *fields, "pressure_mpa", "gap_mm", "contact_force_n", *observables)
    assert sorted(set(table["pressure_mpa"])) == sorted(PRESSURES)
    columns = numpy.stack([table[name] for name in fields], axis=1).astype(numpy.float32)
    assert (columns.reshape(states.shape) == states).all()


@check
def database_cases(work):
    out = work.folder / "cases.npy"
    work.run("export", DATABASE, "--case", "A", "--case", "C", "--out", out)
    two = numpy.load(out)
    assert two.shape == (2, 25022, 5)
    displacement = numpy.linalg.norm(two[0, :, :3] - meshio.read(MESH).points, axis=1)
    assert numpy.abs(displacement - two[0, :, 3]).max() < 5e-3, "packed to a micrometre"
    work.run("export", DATABASE, "--case", "C", "--out", work.folder / "named.pvd")
    named = meshio.read(work.folder / "named_0000.vtu").field_data
    assert bytes(numpy.asarray(named["case"], numpy.uint8)) == b"C" and 0 < float(numpy.ravel(named["pressure_mpa"])[0]) < 0.1
    assert "the database has" in work.run("export", DATABASE, "--case", "Z9", "--out", out, code=2).stderr
    assert ".pvd" in work.run("export", DATABASE, "--out", work.folder / "x.xls", code=2).stderr


def small_tets():
    """A block of a few 10-node tetrahedra, made by meshio's neighbours: corners first, then mid-sides in VTK's order."""
    mesh = meshio.read(MESH)
    cells = mesh.cells[0].data[:40]
    nodes, cells = numpy.unique(cells, return_inverse=True)
    return mesh.points[nodes], cells.reshape(-1, 10)


@check
def abaqus_meshes_that_meshio_wrote(work):
    points, tets = small_tets()
    inp, vtu = work.folder / "tets.inp", work.folder / "tets.vtu"
    meshio.write(inp, meshio.Mesh(points, [("tetra10", tets)]))
    found = json.loads(work.run("import", inp, "--out", vtu, "--json").stdout)
    assert found["nodes"] == len(points) and found["cells"] == {"10-node tetrahedra": len(tets)}, found
    back = meshio.read(vtu)
    assert numpy.abs(back.points - points).max() < 1e-6 and (back.cells[0].data == tets).all()
    corners = numpy.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    brick = numpy.concatenate([corners, [(corners[a] + corners[b]) / 2 for a, b in edges]])
    cells = {"hexahedron20": [list(range(20))], "quad8": [[0, 1, 2, 3, 8, 9, 10, 11]], "triangle": [[0, 1, 2]]}
    inp = work.folder / "brick.inp"
    meshio.write(inp, meshio.Mesh(brick, list(cells.items())))
    left_out = json.loads(work.run("import", inp, "--out", vtu, "--json").stdout)["left_out"]
    assert len(left_out) == 1 and "R3D3" in left_out[0], f"meshio writes triangles as rigid elements: {left_out}"
    inp.write_text(inp.read_text().replace("R3D3", "S3"))
    work.run("import", inp, "--out", vtu)
    back = {block.type: block.data.tolist() for block in meshio.read(vtu).cells}
    assert back == cells, back
    meshio.write(inp, meshio.Mesh(brick[:8], [("hexahedron", [list(range(8))])]))
    work.run("import", inp, "--out", vtu)
    assert meshio.read(vtu).cells[0].type == "hexahedron"


@check
def results_that_meshio_wrote(work):
    """A bar under tension: one state per file, in every coding, of every kind of solid, units and names as given."""
    points = numpy.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
    for name, cells in {"hexahedron": [list(range(8))], "wedge": [[0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7]], "tetra": [[0, 1, 3, 4], [1, 2, 3, 6], [1, 4, 5, 6], [3, 4, 6, 7], [1, 3, 4, 6]]}.items():
        count = max(map(max, cells)) + 1
        folder = work.folder / f"results_{name}"
        folder.mkdir()
        for k, options in enumerate(({}, {"binary": False}, {"compression": None}), 1):
            u = k * 1e-3 * points[:count] * [1, -0.3, -0.3]
            stress = numpy.tile([k * 1e6, 0, 0, 0, 0, 0], (count, 1))
            data = {"displacement": u, "stress": stress, "temperature": numpy.full(count, 20.0 + k)}
            mesh = meshio.Mesh(points[:count] * 0.1, [(name, cells)], point_data=data)
            meshio.write(folder / f"bar_{k}.vtu", mesh, file_format="vtu", **options)
        files = sorted(folder.glob("bar_*.vtu"))
        work.run("import", "results", *files, "--pattern", "bar_{load_n}.vtu", "--length-unit", "m", "--stress-unit", "pa",
                 "--field", "temperature=C", "--out", folder / "db")
        snapshots = numpy.load(folder / "db" / "snapshots.npy")
        for k in (1, 2, 3):
            u = k * points[:count] * [1, -0.3, -0.3]
            expected = numpy.column_stack([points[:count] * 100 + u, numpy.linalg.norm(u, axis=1), numpy.full(count, k), numpy.full(count, 20.0 + k)])
            assert numpy.abs(snapshots[k - 1] - expected).max() < 1e-4, (name, k)
        assert meshio.read(folder / "db" / "mesh.vtu").cells[0].type == name


@check
def vtu_that_meshio_wrote(work):
    points, tets = small_tets()
    theirs, ours = work.folder / "theirs.vtu", work.folder / "ours.vtu"
    for options in ({}, {"binary": False}, {"compression": "zlib"}):
        meshio.write(theirs, meshio.Mesh(points, [("tetra10", tets)]), file_format="vtu", **options)
        work.run("import", theirs, "--out", ours)
        back = meshio.read(ours)
        assert numpy.abs(back.points - points).max() < 1e-6 and (back.cells[0].data == tets).all(), options


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", required=True, help="folder of softtwin")
    parser.add_argument("--only", default="", help="checks whose name contains this")
    options = parser.parse_args()
    programs = pathlib.Path(options.programs).resolve()
    os.chdir(pathlib.Path(__file__).resolve().parents[2])
    for function in CHECKS:
        if options.only in function.__name__:
            with tempfile.TemporaryDirectory(prefix="softtwin-exports-") as folder:
                function(Work(programs, folder))
            print(f"ok  {function.__name__.replace('_', ' ')}", flush=True)


if __name__ == "__main__":
    main()
