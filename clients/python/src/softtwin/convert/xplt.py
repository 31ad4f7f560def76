"""FEBio's plot file, versions 3.0 to 3.5 as FEBio 3 and 4 write them: a dictionary, the mesh, then states, compressed or not.

Numbers of sections, types and formats are those of FEBio Studio's reader. Values of elements become the mean at each node over the
elements there. States that did not converge and an incomplete last one are left out. febio-python reads one domain per quantity
and no compressed files, hence these lines.
"""

import pathlib
import zlib
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Optional, Tuple

import numpy as np

from .run import SIZES, Array, Refused, Run, Values, add_cells, finished

ROOT, HEADER, VERSION, COMPRESSION, DICTIONARY, MESH, STATE = 0x01000000, 0x01010000, 0x01010001, 0x01010004, 0x01020000, 0x01040000, 0x02000000
#: Numbers of each type: scalar, vector, tensors (symmetric, diagonal, fourth order, full); a list gives its size.
TYPES = [1, 3, 6, 3, 21, 9]
#: Nodes of each type of element, and meshio's name of the cell of its first nodes; "": no cell, None: not supported.
ELEMENTS: List[Tuple[int, Optional[str]]] = [
    (8, "hexahedron"), (6, "wedge"), (4, "tetra"), (4, "quad"), (3, "triangle"), (2, ""), (20, "hexahedron20"), (10, "tetra10"),
    (15, "tetra10"), (27, "hexahedron20"), (6, "triangle6"), (8, "quad8"), (9, "quad8"), (15, "wedge15"), (20, None), (10, None),
    (5, "pyramid"), (5, "tetra"), (13, "pyramid13"), (3, ""),
]  # fmt: skip


@dataclass
class Block:
    """Bytes of a block in the order of the file."""

    data: bytes
    order: str

    def words(self) -> Array:
        return np.frombuffer(self.data[: len(self.data) // 4 * 4], f"{self.order}u4")

    def floats(self) -> Array:
        return self.words().view(f"{self.order}f4").astype(float)

    def first(self, default: int = 0) -> int:
        return int(self.words()[0]) if len(self.data) >= 4 else default

    def blocks(self) -> Iterator[Tuple[int, "Block"]]:
        at = 0
        while at < len(self.data):
            number, size = Block(self.data[at : at + 8], self.order).words() if len(self.data) - at >= 8 else (0, len(self.data))
            at += 8 + int(size)
            if at > len(self.data):
                raise Refused("expected blocks that end within the one around them: the file is cut short or damaged")
            yield int(number), Block(self.data[at - int(size) : at], self.order)

    def get(self, *path: int) -> "Block":
        """The block at a path of numbers; an empty one if there is none."""
        found = self
        for number in path:
            found = next((block for other, block in found.blocks() if other == number), Block(b"", self.order))
        return found


@dataclass
class Item:
    """Quantity of the dictionary: name, numbers per place, and place: 0 node, 1 element, 2 node of each element."""

    name: str
    size: int
    place: int


def items(section: Block) -> List[Optional[Item]]:
    found: List[Optional[Item]] = []
    for _, item in section.blocks():
        kind, place, size = (item.get(0x01020000 + k).first(-1) for k in (2, 3, 5))
        size = TYPES[kind] if 0 <= kind < len(TYPES) else size if kind == len(TYPES) else 0
        name = item.get(0x01020004).data.split(b"\0")[0].decode("utf-8", "replace")
        found.append(Item(name.split("=", 1)[-1], size, place) if size > 0 and place in (0, 1, 2) else None)
    return found


def read(path: pathlib.Path) -> Run:
    data = path.read_bytes()
    order = {b"BEF\0": "<", b"\0FEB": ">"}.get(data[:4])
    if order is None:
        raise Refused(f"expected FEBio's tag (42 45 46 00), found {data[:4].hex(' ')}")
    head = [block for _, block in zip(range(2), Block(data[4:], order).blocks())]
    if [number for number, _ in head] != [ROOT, MESH]:
        raise Refused("expected a header and a mesh (was the job stopped at its start?)")
    root, section = (block for _, block in head)
    version = root.get(HEADER, VERSION).first()
    if not 0x30 <= version <= 0x35:
        raise Refused(f"expected version 3.0 to 3.5 (others: FEBio Studio, File > Export > VTK), found {version >> 4}.{version & 15}")
    run, domains = read_mesh(section)
    dictionary = [items(root.get(DICTIONARY, number)) for number in (0x01023000, 0x01024000)]
    is_compressed = root.get(HEADER, COMPRESSION).first() != 0
    rest, number = data[4 + 16 + len(root.data) + len(section.data) :], 0
    while rest:
        number += 1
        try:
            state, rest = next_section(Block(rest, order), is_compressed)
            status = state.get(0x02010000, 0x02010003).first()
        except (Refused, zlib.error):
            run.left_out.append(f"state {number}: the file ends within it, or it is damaged (was the job stopped?)")
            break
        if status:
            run.left_out.append(f"state {number}: not converged (status {status})")
        else:
            run.states.append(read_state(state, dictionary, domains, len(run.points), f"state {number}"))
    return run


def next_section(rest: Block, is_compressed: bool) -> Tuple[Block, bytes]:
    data, after = rest.data, b""
    if is_compressed:
        expander = zlib.decompressobj()
        data, after = expander.decompress(data), expander.unused_data
        if not expander.eof:
            raise Refused("a section without its end")
    number, section = next(Block(data, rest.order).blocks())
    if number != STATE:
        raise Refused("expected states with one mesh (no remeshing)" if number == MESH else "expected a state")
    return section, after if is_compressed else data[8 + len(section.data) :]


def read_mesh(section: Block) -> Tuple[Run, List[Array]]:
    count = section.get(0x01041000, 0x01041100, 0x01041101).first()
    coordinates = section.get(0x01041000, 0x01041200).floats()
    width = coordinates.size // max(count, 1)  # 4: the number of the node is before its coordinates
    if width not in (3, 4) or width * count != coordinates.size:
        raise Refused(f"mesh: expected {count} nodes of 3 coordinates, found {coordinates.size} numbers")
    cells: Dict[str, List[Any]] = {}
    domains: List[Array] = []
    for number, domain in section.get(0x01042000).blocks():
        if number != 0x01042100:
            continue
        place, kind = f"mesh, domain {len(domains) + 1}", domain.get(0x01042101, 0x01042102).first(-1)
        size, cell = ELEMENTS[kind] if 0 <= kind < len(ELEMENTS) else (0, None)
        if cell is None:
            raise Refused(f"{place}: expected tetrahedra, hexahedra, wedges, pyramids, shells or trusses, found type {kind}")
        rows = [element.words()[1:] for _, element in domain.get(0x01042200).blocks()]
        if any(len(row) != size or row.max() >= count for row in rows):
            raise Refused(f"{place}: expected elements of {size} nodes below {count}")
        domains.append(np.array(rows, np.int64).reshape(-1, size))
        if cell:
            if any(len(set(row.tolist())) < size for row in rows):
                raise Refused(f"{place}: expected elements whose nodes differ (FEBio Studio, File > Export > VTK makes cells of collapsed ones)")
            add_cells(cells, cell, domains[-1][:, : SIZES[cell]])
    return finished(coordinates.reshape(count, width)[:, -3:], cells), domains


def read_state(
    state: Block, dictionary: List[List[Optional[Item]]], domains: List[Array], nodes: int, name: str
) -> Tuple[Optional[float], Values]:
    values: Values = {}
    for known, number in zip(dictionary, (0x02020300, 0x02020400)):
        for _, variable in state.get(0x02020000, number).blocks():
            at = variable.get(0x02020002).first()
            if not 1 <= at <= len(known):
                raise Refused(f"{name}: expected quantities 1 to {len(known)} of the dictionary, found {at}")
            item = known[at - 1]
            regions = list(variable.get(0x02020003).blocks())
            if item is None or not regions:
                continue
            place = f"{name}, {item.name}"
            if number == 0x02020300:
                found = sized(np.concatenate([region.floats() for _, region in regions]), nodes, item, place)
            else:
                found = means(regions, item, domains, nodes, place)
            values[item.name] = found if item.size > 1 else found[:, 0]
    time = state.get(0x02010000, 0x02010002).floats()
    return float(time[0]) if time.size and np.isfinite(time[0]) else None, values


def sized(found: Array, rows: int, item: Item, place: str) -> Array:
    if found.size != rows * item.size:
        raise Refused(f"{place}: expected {rows * item.size} numbers, found {found.size}")
    return found.reshape(rows, item.size)


def means(regions: List[Tuple[int, Block]], item: Item, domains: List[Array], nodes: int, place: str) -> Array:
    """Means at the nodes; NaN at nodes without an element that has a value."""
    sums, counts = np.zeros((nodes, item.size)), np.zeros(nodes)
    for number, region in regions:
        if not 1 <= number <= len(domains):
            raise Refused(f"{place}: expected domains 1 to {len(domains)}, found {number}")
        domain, found = domains[number - 1], region.floats()
        if item.place == 0:  # at each node of the region, in the order in which its elements first name them
            members = np.array(list(dict.fromkeys(domain.ravel().tolist())), np.int64)
            found = sized(found, len(members), item, place)
        else:
            members = domain.ravel()
            found = sized(found, len(members) if item.place == 2 else len(domain), item, place)
            found = found if item.place == 2 else np.repeat(found, domain.shape[1], axis=0)
        np.add.at(sums, members, found)
        np.add.at(counts, members, 1)
    with np.errstate(invalid="ignore"):
        return sums / counts[:, None]
