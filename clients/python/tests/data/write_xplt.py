"""Writes the .xplt files in the form of FEBio's plot files; febio-python (0.2) reads the plain one."""

import os
import pathlib
import struct
import zlib

import numpy as np
from febio_python.xplt import read_xplt

# Two hexahedra on each other, a wedge on a face of the upper one, and a 15-node tetrahedron beside them.
POINTS = [(x, y, z) for z in (0, 1, 2) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))] + [(0, 0.5, 3), (1, 0.5, 3)]
TET = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
FACES = [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 1, 2, 3)]
TET15 = TET + [tuple(np.mean([TET[k] for k in part], axis=0)) for part in EDGES + FACES]
POINTS += [(x + 3, y, z) for x, y, z in TET15]
# Number of the type, and the elements.
DOMAINS = [(0, [range(0, 8), range(4, 12)]), (1, [[8, 11, 12, 9, 10, 13]]), (8, [range(14, 29)])]
# Type, format, name: float, vec3f, mat3fs; at nodes, elements, nodes of elements.
NODAL = [(1, 0, "displacement"), (0, 0, "fluid pressure")]
ELEMENT = [(2, 1, "stress"), (0, 0, "density"), (1, 2, "flux=own flux"), (0, 3, "strain energy")]


def block(number, *parts):
    data = b"".join(parts)
    return struct.pack("<2I", number, len(data)) + data


def word(number, value):
    return block(number, struct.pack("<I", value))


def floats(number, values):
    return block(number, np.asarray(values, dtype="<f4").tobytes())


def items(number, quantities):
    item = lambda kind, form, name: block(
        0x01020001, word(0x01020002, kind), word(0x01020003, form), block(0x01020004, name.encode().ljust(64, b"\0")))
    return block(number, *(item(*quantity) for quantity in quantities))


def root(version, compression):
    header = block(0x01010000, word(0x01010001, version), word(0x01010004, compression),
                   block(0x01010006, struct.pack("<I", 8) + b"FEBio4.0"))
    return block(0x01000000, header, block(0x01020000, items(0x01023000, NODAL), items(0x01024000, ELEMENT)))


def mesh(part=lambda number: number):
    coordinates = b"".join(struct.pack("<I3f", node + 1, *point) for node, point in enumerate(POINTS))
    nodes = block(0x01041000, block(0x01041100, word(0x01041101, len(POINTS)), word(0x01041102, 3)),
                  block(0x01041200, coordinates))
    domains, label = [], 0
    for at, (kind, elements) in enumerate(DOMAINS):
        header = block(0x01042101, word(0x01042102, kind), word(0x01042103, at + 1), word(0x01032104, len(elements)))
        rows = []
        for element in elements:
            label += 1
            rows.append(block(0x01042201, struct.pack(f"<{len(element) + 1}I", label, *element)))
        domains.append(block(0x01042100, header, block(0x01042200, *rows)))
    return block(0x01040000, nodes, block(0x01042000, *domains))


def distinct(elements):
    return list(dict.fromkeys(node for element in elements for node in element))


def state(time, status=0):
    variable = lambda number, *regions: block(0x02020001, word(0x02020002, number), block(0x02020003, *regions))
    n = np.arange(len(POINTS))
    nodal = [variable(1, floats(0, time * np.stack([0.1 * n, -0.05 * n, 0.01 * n * n], axis=1))), variable(2, floats(0, time * n))]
    element = [[], [], [], []]
    for at, (_, elements) in enumerate(DOMAINS):
        # Uniaxial stress along x: the number of the domain, and one more for each element.
        stress = [[time * (at + 1 + k), 0, 0, 0, 0, 0] for k in range(len(elements))]
        element[0].append(floats(at + 1, stress))
        element[1].append(floats(at + 1, [10.0 * node for node in distinct(elements)]))
        element[2].append(floats(at + 1, [[node, at, k] for k, nodes in enumerate(elements) for node in nodes]))
        element[3].append(floats(at + 1, [time]))
    elements = [variable(number + 1, *regions) for number, regions in enumerate(element)]
    header = block(0x02010000, word(0x02010001, 0), floats(0x02010002, [time]), word(0x02010003, status))
    return block(0x02000000, header, block(0x02020000, block(0x02020300, *nodal), block(0x02020400, *elements)))


STATES = [state(0.0), state(0.5), state(0.75, status=1), state(1.0)]
os.chdir(pathlib.Path(__file__).parent)
with open("plain.xplt", "wb") as out:
    out.write(b"BEF\0" + root(0x34, 0) + mesh() + b"".join(STATES))
with open("compressed.xplt", "wb") as out:
    out.write(b"BEF\0" + root(0x35, 1) + mesh() + b"".join(zlib.compress(state) for state in STATES))

read, states = read_xplt("plain.xplt")
assert np.allclose(read.nodes[0].coordinates, POINTS) and list(states.timesteps) == [0.0, 0.5, 0.75, 1.0]
assert [[list(row) for row in part.connectivity] for part in read.elements] == [
    [list(row) for row in elements] for _, elements in DOMAINS]
moved = next(data for data in states.nodes if data.name == "displacement").data
assert np.allclose(moved[3][28], [2.8, -1.4, 7.84]), moved[3][28]
# Of each quantity it reads the first domain.
stress = next(data for data in states.elements if data.name == "stress")
assert stress.dom == 0 and [list(row) for row in stress.data[3]] == [[1, 0, 0, 0, 0, 0], [2, 0, 0, 0, 0, 0]]
print("febio-python reads", len(states.timesteps), "states")
