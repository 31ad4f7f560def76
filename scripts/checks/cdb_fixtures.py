"""Writes crates/formats/tests/data/*.cdb with mapdl-archive (0.4), and compares its reading of other archives with ours.

    pip install mapdl-archive pyvista && python3 scripts/checks/cdb_fixtures.py crates/formats/tests/data
    python3 scripts/checks/cdb_fixtures.py --compare target/debug/softtwin    # the archives that come with mapdl-archive
"""
import pathlib
import subprocess
import sys
import tempfile

import mapdl_archive
import mapdl_archive.examples
import numpy as np
import pyvista

CORNERS = {
    pyvista.CellType.HEXAHEDRON: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    pyvista.CellType.WEDGE: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
    pyvista.CellType.PYRAMID: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]],
    pyvista.CellType.TETRA: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
}
QUADRATIC = {
    pyvista.CellType.HEXAHEDRON: (pyvista.CellType.QUADRATIC_HEXAHEDRON, [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6),
                                  (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]),
    pyvista.CellType.WEDGE: (pyvista.CellType.QUADRATIC_WEDGE, [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3),
                             (1, 4), (2, 5)]),
    pyvista.CellType.PYRAMID: (pyvista.CellType.QUADRATIC_PYRAMID, [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4),
                               (2, 4), (3, 4)]),
    pyvista.CellType.TETRA: (pyvista.CellType.QUADRATIC_TETRA, [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]),
}


def bodies(is_quadratic):
    """One cell of each kind, 3 apart, each a material of its own."""
    points, cells, kinds = [], [], []
    for body, (kind, corners) in enumerate(CORNERS.items()):
        own = np.array(corners, dtype=float) + [3.0 * body, 0.0, 0.0]
        if is_quadratic:
            kind, edges = QUADRATIC[kind]
            own = np.vstack([own, [0.5 * (own[a] + own[b]) for a, b in edges]])
        cells.append([len(own), *range(len(points), len(points) + len(own))])
        points.extend(own)
        kinds.append(kind)
    grid = pyvista.UnstructuredGrid(np.concatenate(cells), np.array(kinds), np.array(points))
    grid["mtype"] = np.arange(1, 5, dtype=np.int32)
    grid["ansys_node_num"] = np.arange(101, 101 + len(points), dtype=np.int32)
    return grid


def compare(program):
    for path in sorted(pathlib.Path(mapdl_archive.examples.__file__).parent.glob("*.cdb")):
        theirs = mapdl_archive.Archive(str(path)).grid
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "mesh.vtu"
            subprocess.run([program, "import", str(path), "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
            ours = pyvista.read(out)
        kinds = {int(kind) for kind in theirs.celltypes}
        counts = [[int((grid.celltypes == kind).sum()) for kind in kinds] for grid in (theirs, ours)]
        assert counts[0] == counts[1], (path.name, counts)
        for kind in kinds:
            cells = [grid.extract_cells(grid.celltypes == kind) for grid in (theirs, ours)]
            places = [np.array([cell.points for cell in part.cell]) for part in cells]
            if kind == pyvista.CellType.WEDGE:  # which of the two triangles is the first one depends on VTK's version
                places = [np.array([cell[np.lexsort(cell.T)] for cell in part]) for part in places]
            assert np.abs(places[0] - places[1]).max() < 1e-5, path.name
        print(f"{path.name}: {sum(counts[0])} cells alike, volume {theirs.volume:.6g}")


if sys.argv[1] == "--compare":
    compare(sys.argv[2])
else:
    folder = pathlib.Path(sys.argv[1])
    mapdl_archive.save_as_archive(folder / "quadratic.cdb", bodies(True))
    mapdl_archive.save_as_archive(folder / "linear.cdb", bodies(False), use_etblock=True)
