"""Writes linear.cdb and quadratic.cdb with mapdl-archive (0.4); needs pyvista. model.cdb follows Ansys' manual."""

import pathlib

import mapdl_archive
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
    """One cell of each kind, 3 apart, each of another material."""
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


folder = pathlib.Path(__file__).parent
mapdl_archive.save_as_archive(folder / "quadratic.cdb", bodies(True))
mapdl_archive.save_as_archive(folder / "linear.cdb", bodies(False), use_etblock=True)
