"""XDMF as FEniCS, meshio and ParaView write it: a uniform grid, or temporal collections of such grids.

Collections of the same times are one series: FEniCS writes one per function. The mesh is in every grid, or referred to.
"""

import pathlib
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from .run import SIZES, Array, Refused, Run, Values, add_cells, finished

#: Names of topologies; number in a mixed one, meshio's name, nodes in the file (further nodes in faces and cell are ignored).
TOPOLOGIES = {
    "tetrahedron": (0x6, "tetra", 4), "tetrahedron_10": (0x26, "tetra10", 10), "hexahedron": (0x9, "hexahedron", 8),
    "hexahedron_20": (0x30, "hexahedron20", 20), "hexahedron_27": (0x32, "hexahedron20", 27), "wedge": (0x8, "wedge", 6),
    "wedge_15": (0x28, "wedge15", 15), "triangle": (0x4, "triangle", 3), "triangle_6": (0x24, "triangle6", 6),
    "quadrilateral": (0x5, "quad", 4), "quadrilateral_8": (0x25, "quad8", 8),
}  # fmt: skip
SHORT = {"tet_10": "tetrahedron_10", "hex_20": "hexahedron_20", "hex_27": "hexahedron_27", "tri_6": "triangle_6", "quad_8": "quadrilateral_8"}


def read(path: pathlib.Path) -> Run:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True)
    try:
        root = etree.parse(path, parser).getroot()
    except etree.XMLSyntaxError as error:
        raise Refused(f"expected XDMF that is not cut short, found {error}") from None
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = etree.QName(element).localname
    return Reader(path, root).run()


class Reader:
    def __init__(self, path: pathlib.Path, root: Any) -> None:
        self.path, self.root = path, root
        self.files: Dict[str, Any] = {}
        self.mesh: Optional[Tuple[Tuple[Any, Any], Run]] = None
        self.left_out: List[str] = []

    def run(self) -> Run:
        grids = self.root.findall("Domain/Grid")
        series = [grid for grid in grids if grid.get("GridType", "Uniform").lower() != "uniform"]
        if not series and len(grids) != 1:
            raise Refused(f"Domain: expected one Grid or a temporal collection (ParaView: Merge Blocks, save again), found {len(grids)} grids")
        states: List[Tuple[Optional[float], Values]] = []
        for collection in series or [None]:
            found = [self.state(grids[0], None)] if collection is None else self.collection(collection)
            if states and [time for time, _ in states] != [time for time, _ in found]:
                raise Refused(f"Grid {collection.get('Name')}: expected the times of the first collection, {[t for t, _ in states]}")
            again = sorted({name for (_, a), (_, b) in zip(states, found) for name in a if name in b})
            if again:
                raise Refused(f"Grid {collection.get('Name')}: expected every quantity in one collection, found {', '.join(again)} again")
            states = [(t, {**values, **more}) for (t, values), (_, more) in zip(states, found)] or found
        assert self.mesh
        run = self.mesh[1]
        return Run(run.points, run.cells, states if any(values for _, values in states) else [], list(dict.fromkeys(self.left_out)))

    def collection(self, collection: Any) -> List[Tuple[Optional[float], Values]]:
        grids = collection.findall("Grid")
        nested = [grid for grid in grids if grid.get("GridType", "Uniform").lower() != "uniform"]
        if collection.get("CollectionType", "").lower() != "temporal" or nested or not grids:
            raise Refused("expected a temporal collection of uniform grids (ParaView: Merge Blocks, save again), found another")
        times: List[Optional[float]] = [None] * len(grids)
        time = collection.find("Time")
        if time is not None:
            values = self.item(time)
            is_slab = time.get("TimeType", "").lower() == "hyperslab"
            times = list(values[0] + values[1] * np.arange(len(grids)) if is_slab else values)
        return [self.state(grid, listed) for grid, listed in zip(grids, times)]

    def state(self, grid: Any, listed: Optional[float]) -> Tuple[Optional[float], Values]:
        nodes = self.read_mesh(grid)
        time = grid.find("Time")
        values: Values = {}
        for attribute in grid.findall("Attribute"):
            name = attribute.get("Name", "")
            if attribute.get("ItemType") == "FiniteElementFunction":
                raise Refused(f"{name}: expected values at nodes (FEniCS: write(u, t) instead of write_checkpoint)")
            if attribute.get("Center", "Node").lower() != "node":
                self.left_out.append(f"{name}: not at the nodes")
            elif name in values:
                raise Refused(f"{name}: expected one Attribute of this name per grid, found another")
            elif attribute.get("AttributeType", "").lower() == "tensor6":
                self.left_out.append(f"{name}: a Tensor6, whose order differs between programs; write the von Mises stress or 9 components")
            else:
                found = self.item(attribute).ravel()
                if not found.size or found.size % nodes:
                    raise Refused(f"{name}: expected values at {nodes} nodes, found {found.size}")
                values[name] = found if found.size == nodes else found.reshape(nodes, -1)
        return listed if time is None or time.get("Value") is None else float(time.get("Value")), values

    def read_mesh(self, grid: Any) -> int:
        parts = [*grid]
        for include in grid.findall("include"):
            parts.extend(self.find(include.get("xpointer", "")))
        found = {part.tag: part for part in parts if part.tag in ("Topology", "Geometry")}
        if len(found) < 2:
            raise Refused(f"Grid {grid.get('Name')}: expected Topology and Geometry, found {', '.join(found) or 'none'}")
        topology, geometry = (self.referred(found[name]) for name in ("Topology", "Geometry"))
        if self.mesh is None or self.mesh[0] != (topology, geometry):
            run = self.mesh_of(topology, geometry)
            same = self.mesh is None or np.array_equal(run.points, self.mesh[1].points) and run.cells.keys() == self.mesh[1].cells.keys()
            if not same or self.mesh and not all(np.array_equal(run.cells[k], nodes) for k, nodes in self.mesh[1].cells.items()):
                raise Refused("expected the undeformed mesh of the first grid in every grid, with the displacement as an Attribute")
            self.mesh = (topology, geometry), run
        return len(self.mesh[1].points)

    def mesh_of(self, topology: Any, geometry: Any) -> Run:
        form = (geometry.get("GeometryType") or geometry.get("Type") or "XYZ").upper()
        if form not in ("XYZ", "XY"):
            raise Refused(f"Geometry: expected GeometryType XYZ or XY, found {form}")
        points = np.asarray(self.item(geometry), float).reshape(-1, len(form))
        points = np.pad(points, ((0, 0), (0, 3 - len(form))))
        numbers = self.item(topology).ravel().astype(np.int64)
        base = int(topology.get("BaseOffset") or 0)
        name = (topology.get("TopologyType") or topology.get("Type") or "").lower()
        cells: Dict[str, List[Any]] = {}
        if name == "mixed":
            self.mixed(cells, numbers, base)
        else:
            _, kind, count = TOPOLOGIES.get(SHORT.get(name, name), (0, "", 0))
            if not count or not numbers.size or numbers.size % count:
                raise Refused(f"Topology: expected cells of {', '.join(TOPOLOGIES)} or mixed ones, found {numbers.size} numbers of {name!r}")
            add_cells(cells, kind, numbers.reshape(-1, count)[:, : SIZES[kind]] - base)
        return finished(points, cells)

    @staticmethod
    def mixed(cells: Dict[str, List[Any]], numbers: Array, base: int) -> None:
        """Cell after cell: its number, for points and lines their count, its nodes."""
        known, at = {code: (kind, count) for code, kind, count in TOPOLOGIES.values()}, 0
        while at < len(numbers):
            code = int(numbers[at])
            if code in (1, 2, 0x22):  # points, lines, quadratic lines: no cells
                at += 4 if code == 0x22 else 2 + int(numbers[at + 1]) if at + 1 < len(numbers) else 2
            elif code not in known or at + known[code][1] >= len(numbers):
                raise Refused(f"Topology: expected a cell with all its nodes at number {at}, found {numbers[at : at + 9]}")
            else:
                kind, count = known[code]
                add_cells(cells, kind, [numbers[at + 1 :][: SIZES[kind]] - base])
                at += 1 + count
        if at > len(numbers):
            raise Refused("Topology: expected all nodes of the last cell, found the end")

    def find(self, pointer: str) -> List[Any]:
        inner = pointer.strip()
        inner = inner[len("xpointer(") : -1] if inner.startswith("xpointer(") else inner
        try:
            found = self.root.xpath(inner)
        except Exception as error:
            raise Refused(f"reference: expected a path such as /Xdmf/Domain/Grid[1]/Topology, found {pointer} ({error})") from None
        if not isinstance(found, list) or not found:
            raise Refused(f"reference: {pointer} names no element")
        return found

    def referred(self, element: Any) -> Any:
        for _ in range(8):
            reference = element.get("Reference")
            if reference is None:
                return element
            element = self.find(element.text or "" if reference == "XML" else reference)[0]
        raise Refused("expected references that end at an element")

    def item(self, element: Any) -> Array:
        """Numbers of the data item in an element, or in the one that it refers to."""
        element = self.referred(element)
        if element.tag != "DataItem":
            items = element.findall("DataItem")
            if len(items) != 1:
                raise Refused(f"{element.tag} {element.get('Name', '')}: expected one DataItem, found {len(items)}")
            return self.item(items[0])
        place = f"{element.getparent().tag} {element.getparent().get('Name', '')}".strip()
        if element.get("ItemType", "Uniform") != "Uniform":
            raise Refused(f"{place}: expected a DataItem with its numbers (ItemType Uniform), found {element.get('ItemType')}")
        text, form = (element.text or "").strip(), element.get("Format", "XML").upper()
        try:
            shape = tuple(int(word) for word in element.get("Dimensions", "").split())
            if form == "XML":
                values = np.array(text.split(), float)
            elif form == "BINARY":
                values = self.binary(element, text, int(np.prod(shape)))
            elif form in ("HDF", "HDF5"):
                values = self.dataset(text)
            else:
                raise Refused(f"{place}: expected Format XML, Binary or HDF, found {form}")
            if not shape or values.size != np.prod(shape, dtype=object):
                raise Refused(f"{place}: expected Dimensions {shape} of its numbers, found {values.size} numbers")
            return values.reshape(shape)
        except (KeyError, OSError, OverflowError, TypeError) as error:
            raise Refused(f"{place}: cannot read {text[:80]}: {error}") from None

    def binary(self, element: Any, name: str, count: int) -> Array:
        kind = (element.get("DataType") or element.get("NumberType") or "Float").lower()
        size = {"char": 1, "uchar": 1}.get(kind, int(element.get("Precision") or 4))
        if element.get("Compression", "Raw") != "Raw":
            raise Refused("expected binary data without compression")
        letter = {"float": "f", "int": "i", "char": "i", "uint": "u", "uchar": "u"}[kind]
        order = ">" if element.get("Endian", "").lower() == "big" else "<"
        return np.fromfile(self.path.with_name(name), f"{order}{letter}{size}", count, offset=int(element.get("Seek") or 0))

    def dataset(self, text: str) -> Array:
        import h5py

        name, _, dataset = text.rpartition(":")
        if name not in self.files:
            self.files[name] = h5py.File(self.path.with_name(name.strip()), "r")
        return self.files[name][dataset][()]
