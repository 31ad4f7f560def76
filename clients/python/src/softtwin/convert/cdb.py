"""Ansys' archive of a model (CDWRITE,DB): nodes, solids and shells, with the results in a table or listings of the same name."""

import pathlib
import re
from typing import Any, Dict, Iterator, List, Optional, Tuple

import numpy as np

from .run import Array, Refused, Run, add_cells, finished
from .tables import read_prnsol, read_table

#: Family and nodes of each type of element: the number in the name, 186 of SOLID186.
ELEMENTS = {
    name: (family, count)
    for family, count, names in (
        ("brick", 8, (5, 45, 46, 64, 65, 185, 190, 215, 278)), ("brick", 20, (95, 186, 216, 226, 279)), ("tetra", 4, (285,)),
        ("tetra", 10, (92, 98, 187, 217, 227, 291)), ("shell", 4, (41, 43, 63, 143, 181)), ("shell", 8, (91, 93, 99, 281)),
    )
    for name in names
}  # fmt: skip
#: Linear and quadratic cell, places of corners and mid-sides in the element, places with the same node. The most collapsed first.
SHAPES: Dict[str, List[Tuple[str, str, List[int], List[int], List[List[int]]]]] = {
    "brick": [
        ("tetra", "tetra10", [0, 1, 2, 4], [8, 9, 11, 16, 17, 18], [[2, 3], [4, 5, 6, 7]]),
        ("wedge", "wedge15", [0, 1, 2, 4, 5, 6], [8, 9, 11, 12, 13, 15, 16, 17, 18], [[2, 3], [6, 7]]),
        ("pyramid", "pyramid13", [0, 1, 2, 3, 4], [8, 9, 10, 11, 16, 17, 18, 19], [[4, 5, 6, 7]]),
        ("hexahedron", "hexahedron20", list(range(8)), list(range(8, 20)), []),
    ],
    "tetra": [("tetra", "tetra10", [0, 1, 2, 3], [4, 5, 6, 7, 8, 9], [])],
    "shell": [("triangle", "triangle6", [0, 1, 2], [4, 5, 7], [[2, 3]]), ("quad", "quad8", [0, 1, 2, 3], [4, 5, 6, 7], [])],
}
#: Corners of the edge of each mid-side node of a quadratic cell.
EDGES = {
    "tetra10": "01 12 02 03 13 23", "hexahedron20": "01 12 23 30 45 56 67 74 04 15 26 37", "wedge15": "01 12 20 34 45 53 03 14 25",
    "pyramid13": "01 12 23 30 04 14 24 34", "triangle6": "01 12 20", "quad8": "01 12 23 30",
}  # fmt: skip
#: Commands that make, move or remove nodes or elements outside of blocks.
MAKERS = set(
    "N E EN EMORE NGEN EGEN ENGEN FILL NSYM ESYM ENSYM NSCALE NREAD EREAD VMESH CDREAD /INPUT *DO "
    "NMODIF NDELE EDELE EMODIF NUMMRG MOVE UPCOORD UPGEOM TRANSFER".split()
)


def ends_block(line: str) -> bool:
    words = [word.strip().upper() for word in line.split(",") if word.strip()]
    return words == ["-1"] or bool(words) and words[0] in ("N", "EN") and words[-1] == "-1"


def block(lines: Iterator[Tuple[int, str]], is_free: bool = False) -> Iterator[Tuple[int, List[int], List[float]]]:
    """Integers and three numbers of each line of a block, by the widths of its first line: (3i9,6e21.13e3). Free: between blanks."""
    number, line = next(lines, (0, ""))
    form = re.fullmatch(r"\((\d+)i(\d+)(?:,\d+[a-z](\d+).*)?\)", line.strip().lower())
    if not form:
        raise Refused(f"line {number}: expected the columns of the block, such as (3i9,6e21.13e3), found {line.strip()[:80]}")
    count, width, wide = int(form[1]), int(form[2]), int(form[3] or 0)
    for number, line in lines:
        if ends_block(line):
            return
        try:
            words = line.split() if is_free else [line[k : k + width].strip() for k in range(0, count * width, width)]
            integers = [int(word) for word in words[: words.index("") if "" in words else None]]
            reals = [line[count * width + k * wide :][:wide].strip() or "0" for k in range(3 if wide and not is_free else 0)]
            yield number, integers, [float(word) for word in reals]
        except ValueError:
            raise Refused(f"line {number}: expected numbers in columns, found {line.strip()[:80]}") from None
    raise Refused("expected the end of the block (-1), found the end of the file: it is cut short")


def cell_of(name: int, nodes: List[int], place: str) -> Optional[Tuple[str, List[int]]]:
    """Kind and nodes of an element; None if the element is neither solid nor shell. Node 0: no mid-side."""
    if name not in ELEMENTS:
        return None
    family = "brick" if name == 285 and len(nodes) == 8 else ELEMENTS[name][0]
    nodes = nodes + [0] * (20 - len(nodes))
    fits = lambda shape: all(len({nodes[k] for k in same}) == 1 for same in shape[4])
    linear, quadratic, corners, middles, _ = next(shape for shape in SHAPES[family] if fits(shape))
    ends, mids = [nodes[k] for k in corners], [nodes[k] for k in middles]
    if 0 in ends or len(set(ends)) < len(ends):
        raise Refused(f"{place}: expected corners that differ or collapse to a wedge, pyramid or tetrahedron, found {nodes}")
    if 0 in mids and any(mids):
        raise Refused(f"{place}: expected all mid-side nodes or none (EMID,ADD adds them before the solution)")
    return (linear, ends) if 0 in mids else (quadratic, ends + mids)


def read_cdb_mesh(path: pathlib.Path) -> Tuple[Run, List[int]]:
    """Nodes, solids and shells of NBLOCK and EBLOCK, and the numbers of the nodes."""
    points, place, types, chosen = [], {}, {}, None  # type: ignore[var-annotated]
    elements: List[Tuple[int, int, int, List[int]]] = []  # line, number, type, nodes
    lines = iter(enumerate(path.read_text("utf-8", "replace").splitlines(), 1))
    for number, line in lines:
        words = [word.strip().upper() for word in line.split("!")[0].split(",")] + ["", ""]
        if words[0] == "NBLOCK":
            for number, integers, point in block(lines):
                if not integers or place.setdefault(integers[0], len(points)) != len(points):
                    raise Refused(f"line {number}: expected every node once, found {integers[:1]}")
                points.append(point)
        elif words[0] == "EBLOCK":
            is_solid, open_ = words[2] == "SOLID", None
            for number, integers, _ in block(lines):
                if open_ is None:
                    head, nodes = (integers[:11], integers[11:]) if is_solid else (integers[:5], integers[5:])
                    if len(head) < (11 if is_solid else 5):
                        raise Refused(f"line {number}: expected {11 if is_solid else 5} integers, then nodes")
                    kind = head[1] if is_solid or chosen is None else chosen
                    count = head[8] if is_solid else ELEMENTS.get(types.get(kind, 0), ("", len(nodes)))[1]
                    open_ = (number, head[10] if is_solid else head[0], kind, nodes)
                else:
                    open_[3].extend(integers)
                if len(open_[3]) >= count:
                    elements.append((*open_[:3], open_[3][:count]))
                    open_ = None
            if open_:
                raise Refused(f"line {number}: expected {count} nodes of element {open_[1]}, found the end of the block")
        elif words[0] == "ETBLOCK":
            types.update({integers[0]: integers[1] for _, integers, _ in block(lines, is_free=True)})
        elif words[0] == "ET":
            name = re.search(r"\d+$", words[2])
            if not name or not words[1].isdigit():
                raise Refused(f"line {number}: expected ET,NUMBER,ELEMENT with numbers, found {line.strip()}")
            types[int(words[1])] = int(name[0])
        elif words[0] == "TYPE":
            chosen = int(words[1]) if words[1].isdigit() else None
        elif words[0] in MAKERS and not ends_block(line):
            raise Refused(f"line {number}: expected nodes and elements in blocks (CDWRITE,DB,run,cdb,,,,BLOCKED), found {words[0]}")
    cells: Dict[str, List[Any]] = {}
    others: Dict[int, int] = {}
    known: Dict[int, List[int]] = {}
    for number, label, kind, nodes in elements:
        where = f"line {number}, element {label}"
        if kind not in types:
            raise Refused(f"{where}: expected a type that ET names, found type {kind}")
        if known.setdefault(label, nodes) != nodes:
            raise Refused(f"{where}: expected every element once, found it again with other nodes")
        cell = cell_of(types[kind], nodes, where)
        if cell is None:
            others[types[kind]] = others.get(types[kind], 0) + 1
        elif any(node not in place for node in cell[1]):
            raise Refused(f"{where}: expected nodes of NBLOCK, found {[node for node in cell[1] if node not in place]}")
        else:
            add_cells(cells, cell[0], [[place[node] for node in cell[1]]])
    if not cells:
        raise Refused("expected NBLOCK with nodes and EBLOCK with solids or shells (CDWRITE,DB,run,cdb,,,,BLOCKED), found none")
    left_out = [f"{count} elements of type {name}, no solid or shell" for name, count in others.items()]
    return finished(np.array(points), cells, left_out=left_out), list(place)


def read_cdb(path: pathlib.Path) -> Run:
    run, labels = read_cdb_mesh(path)
    there = [path.with_suffix(ending) for ending in (".csv", ".txt", ".lis") if path.with_suffix(ending).exists()]
    if len(there) > 1:
        raise Refused(f"results: expected one file of the same name, found {' and '.join(map(str, there))}")
    for results in there:
        run.states = (read_table if results.suffix == ".csv" else read_prnsol)(results).at_nodes(labels)
    ends = [np.array([[int(c) for c in edge] for edge in EDGES[kind].split()]) for kind in run.cells if kind in EDGES]
    quadratic = [nodes for kind, nodes in run.cells.items() if kind in EDGES]
    for values in (values for _, values in run.states) if quadratic else ():
        for value in values.values():
            fill_middles(value, [(n[:, -len(e) :], n[:, e[:, 0]], n[:, e[:, 1]]) for n, e in zip(quadratic, ends)])
    return run


def fill_middles(value: Array, edges: List[Tuple[Array, Array, Array]]) -> None:
    """Mean of the edge's ends at mid-side nodes, if all of them have no value or zero: Ansys gives stress at corners only."""
    empty = lambda at: (np.isnan(value[at]) | (value[at] == 0)).all()
    if all(empty(middle) and np.isfinite(value[a]).all() and np.isfinite(value[b]).all() for middle, a, b in edges):
        for middle, a, b in edges:
            value[middle] = 0.5 * (value[a] + value[b])
