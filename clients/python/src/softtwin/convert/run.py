"""Result of a reader of the converter, and the files that softtwin reads."""

import pathlib
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, List, Optional, Tuple

import numpy as np

Array = Any
Values = Dict[str, Array]


class Refused(ValueError):
    """A file that is damaged or that the converter does not support."""


@dataclass
class Run:
    """Undeformed nodes, cells by meshio's name, and per state its time and the values at the nodes (NaN: not given)."""

    points: Array
    cells: Dict[str, Array]
    states: List[Tuple[Optional[float], Values]] = field(default_factory=list)
    left_out: List[str] = field(default_factory=list)


#: Nodes and VTK's number of the cells that softtwin reads, by meshio's name.
CELLS = {
    "tetra": (4, 10), "tetra10": (10, 24), "hexahedron": (8, 12), "hexahedron20": (20, 25), "wedge": (6, 13), "wedge15": (15, 26),
    "pyramid": (5, 14), "pyramid13": (13, 27), "triangle": (3, 5), "triangle6": (6, 22), "quad": (4, 9), "quad8": (8, 23),
}  # fmt: skip
SIZES = {kind: size for kind, (size, _) in CELLS.items()}


def add_cells(cells: Dict[str, List[Any]], kind: str, rows: Iterable[Any]) -> None:
    cells.setdefault(kind, []).extend(rows)


def finished(points: Array, cells: Dict[str, List[Any]], **rest: Any) -> Run:
    """A run from lists of cells, whose nodes must exist."""
    arrays = {kind: np.array(rows, np.int64).reshape(-1, SIZES[kind]) for kind, rows in cells.items() if len(rows)}
    for kind, nodes in arrays.items():
        if nodes.min() < 0 or nodes.max() >= len(points):
            raise Refused(f"{kind}: expected nodes 0 to {len(points) - 1}, found {nodes.min()} to {nodes.max()}")
    if not np.isfinite(points).all():
        raise Refused("nodes: expected finite coordinates")
    return Run(np.asarray(points, float), arrays, **rest)


def write_npz(path: pathlib.Path, run: Run) -> None:
    """Nodes, cells and stacks of values (states x nodes x components) as `softtwin import results` reads them."""
    arrays: Dict[str, Array] = {"points": run.points, **run.cells}
    for name in dict.fromkeys(name for _, values in run.states for name in values):
        first = next(values[name] for _, values in run.states if name in values)
        missing = np.full(first.shape, np.nan)
        stack = np.stack([np.asarray(values.get(name, missing), float) for _, values in run.states])
        arrays[f"{name}_" if name in arrays or name == "time" else name] = stack
    times = [time for time, _ in run.states]
    if times and None not in times:
        arrays["time"] = np.array(times, float)
    np.savez_compressed(path, **{name.replace("/", "_"): array for name, array in arrays.items()})


def write_vtu(path: pathlib.Path, run: Run) -> None:
    """The mesh. meshio's writer does not know wedges of 15 and pyramids of 13 nodes."""

    def array(kind: str, more: str, values: Array) -> str:
        words = " ".join(map(repr, np.ravel(values).tolist()))
        return f'<DataArray type="{kind}" {more}format="ascii">{words}</DataArray>'

    nodes = [rows.ravel() for rows in run.cells.values()]
    sizes = np.concatenate([np.full(len(rows), rows.shape[1]) for rows in run.cells.values()])
    types = np.concatenate([np.full(len(rows), CELLS[kind][1]) for kind, rows in run.cells.items()])
    path.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(run.points)}" NumberOfCells="{len(types)}">\n'
        + "<Points>"
        + array("Float64", 'NumberOfComponents="3" ', run.points)
        + "</Points>\n<Cells>"
        + array("Int64", 'Name="connectivity" ', np.concatenate(nodes))
        + array("Int64", 'Name="offsets" ', np.cumsum(sizes))
        + array("UInt8", 'Name="types" ', types)
        + "</Cells>\n</Piece></UnstructuredGrid></VTKFile>\n",
        "ascii",
    )
