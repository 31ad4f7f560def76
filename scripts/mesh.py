#!/usr/bin/env python3
"""Builds an actuator's second-order tetrahedral mesh with gmsh from its actuator.toml.

    scripts/mesh.py models/pneunet/actuator.toml [--out FILE] [--finer TIMES] [--search SECONDS]

gmsh comes from PyPI into target/mesh-venv. On a bare Debian or Ubuntu it needs these libraries:
    apt-get install python3-venv libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1
The committed mesh needs none of this. Physical names: volume `solid`; surfaces `sheet`, `cavity`, `fixed`, `bottom`, `slot_lower_0`,
`slot_upper_0`, ... (the walls of slot i on its lower-x and upper-x side). Writes binary .msh 4.1.
"""

import argparse
import math
import os
import random
import subprocess
import sys
import time
import tomllib
import venv
from pathlib import Path

try:
    import gmsh
    import numpy as np
except ImportError:
    home = Path(__file__).resolve().parents[1] / "target/mesh-venv"
    if Path(sys.prefix) == home:
        raise
    venv.create(home, with_pip=True)
    subprocess.run([home / "bin/pip", "install", "--quiet", "gmsh==4.15.2", "numpy"], check=True)
    os.execv(home / "bin/python", [home / "bin/python", *sys.argv])

TOLERANCE_MM = 1e-6
MOST_FLIPS = 10  # more would lower the quality: search for better parameters instead
CORNER_PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def boxes(a):
    """Boxes (x0, x1, y0, y1, z0, z1) of the parts: lower layer, upper layer, body, and what is cut out of them."""
    if own := [k for k in ("lengths_mm", "tops_mm", "opposite") if k in a["chambers"]] + [k for k in ("side_mm",) if k in a["slots"]]:
        sys.exit(f"mesh: expected a shape without {', '.join(own)}; softtwin mesh makes it")
    base, body, chambers, slots, channels = (a[k] for k in ("base", "body", "chambers", "slots", "channels"))
    middle = base["width_mm"] / 2
    sheet, top = base["lower_mm"], base["lower_mm"] + base["upper_mm"]
    floor = top - body["pocket_mm"]

    def across(width):
        return middle - width / 2, middle + width / 2

    length, full = base["length_mm"], (0.0, base["width_mm"])
    lower = (0.0, length, 0.0, sheet, *full)
    upper = (0.0, length, sheet, top, *full)
    start = body["start_mm"]
    block = (start, start + body["length_mm"], floor, body["top_mm"], *across(body["width_mm"]))
    cuts = []
    for i in range(chambers["count"]):
        x0 = chambers["first_mm"] + i * chambers["pitch_mm"]
        x1 = x0 + chambers["length_mm"]
        cuts.append((x0, x1, floor, chambers["top_mm"], *across(chambers["width_mm"])))
        if i + 1 < chambers["count"]:
            x2 = x0 + chambers["pitch_mm"]
            centre, half = (x1 + x2) / 2, slots["width_mm"] / 2
            cuts.append((centre - half, centre + half, slots["floor_mm"], body["top_mm"], *across(body["width_mm"])))
            cuts.append((x1, x2, floor, channels["top_mm"], *across(channels["width_mm"])))
    return lower, upper, block, cuts


def build_geometry(a):
    """The two bonded solids: below the sheet, and everything above it without cavities and slots."""
    occ = gmsh.model.occ

    def add(box):
        x0, x1, y0, y1, z0, z1 = box
        return 3, occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)

    lower, upper, block, cuts = boxes(a)
    lower = [add(lower)]
    above, _ = occ.fuse([add(upper)], [add(block)])
    above, _ = occ.cut(above, [add(cut) for cut in cuts])
    occ.fragment(lower, above)
    occ.synchronize()
    if len(gmsh.model.getEntities(3)) != 2:
        sys.exit(f"mesh: expected 2 bonded solids, found {len(gmsh.model.getEntities(3))}; check the parts' sizes")


def name_surfaces(a):
    """Names every plane face by where it lies."""
    base, body, chambers, slots = (a[k] for k in ("base", "body", "chambers", "slots"))
    sheet, top = base["lower_mm"], base["lower_mm"] + base["upper_mm"]
    held = {"body-start": (body["start_mm"], top, body["top_mm"]), "base-start": (0.0, 0.0, top)}
    if a["support"]["fixed"] not in held:
        sys.exit(f"mesh: expected support.fixed {' or '.join(held)}, found {a['support']['fixed']}; softtwin mesh holds any face")
    held_x, held_low, held_high = held[a["support"]["fixed"]]
    middle, half_width = base["width_mm"] / 2, body["width_mm"] / 2
    inner = chambers["width_mm"] / 2
    first = chambers["first_mm"]
    last = first + (chambers["count"] - 1) * chambers["pitch_mm"] + chambers["length_mm"]
    cavity_floor = top - body["pocket_mm"]
    groups = {}
    for dim, tag in gmsh.model.getEntities(2):
        x0, y0, z0, x1, y1, z1 = gmsh.model.getBoundingBox(dim, tag)
        plane_x, plane_y = x1 - x0 < 1e-3, y1 - y0 < 1e-3
        near = lambda v, to: abs(v - to) < 1e-3  # gmsh widens bounding boxes by its tolerance
        name = None
        if plane_y and near(y0, 0):
            name = "bottom"
        elif plane_y and near(y0, sheet):
            name = "sheet"
        elif plane_x and near(x0, held_x) and y0 > held_low - 1e-3 and y1 < held_high + 1e-3:
            name = "fixed"
        elif (
            x0 > first - 1e-3 and x1 < last + 1e-3 and y0 > cavity_floor - 1e-3 and y1 < chambers["top_mm"] + 1e-3
            and z0 > middle - inner - 1e-3 and z1 < middle + inner + 1e-3
        ):
            name = "cavity"
        elif plane_x and near(y0, slots["floor_mm"]) and near(z1 - z0, 2 * half_width):
            for i in range(chambers["count"] - 1):
                centre = first + i * chambers["pitch_mm"] + (chambers["pitch_mm"] + chambers["length_mm"]) / 2
                if near(x0, centre - slots["width_mm"] / 2):
                    name = f"slot_lower_{i}"
                elif near(x0, centre + slots["width_mm"] / 2):
                    name = f"slot_upper_{i}"
        if name:
            groups.setdefault(name, []).append(tag)
    expected = {"bottom", "sheet", "fixed", "cavity"}
    expected |= {f"slot_{side}_{i}" for side in ("lower", "upper") for i in range(chambers["count"] - 1)}
    if missing := sorted(expected - groups.keys()):
        sys.exit(f"mesh: no face found for {', '.join(missing)}; check the parts' sizes")
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="solid")
    for name, tags in sorted(groups.items()):
        gmsh.model.addPhysicalGroup(2, tags, name=name)


def mesh_solids(m, finer=1.0):
    """First-order tetrahedra: seeded edges, frontal triangles and tetrahedra, optimised. `finer`: factor on the parts of each edge."""
    size = m["size_mm"] / finer
    for option, value in {
        "Mesh.RandomSeed": m["random_seed"],
        "Mesh.Algorithm": 6,  # frontal Delaunay triangles
        "Mesh.Algorithm3D": 4,  # frontal tetrahedra
        "Mesh.OptimizeThreshold": m["optimise_below"],
        "Mesh.MeshSizeMin": 0,
        "Mesh.MeshSizeMax": size,
    }.items():
        gmsh.option.setNumber(option, value)
    for entity in gmsh.model.getEntities(0):
        gmsh.model.mesh.setSize([entity], size)
    for _, tag in gmsh.model.getEntities(1):
        parts = max(1, int(gmsh.model.occ.getMass(1, tag) / m["seed_mm"] + 0.5))
        gmsh.model.mesh.setTransfiniteCurve(tag, math.ceil(parts * finer - 1e-9) + 1)
    gmsh.model.mesh.generate(3)
    for _ in range(m["netgen_passes"]):
        gmsh.model.mesh.optimize("Netgen")


def corners():
    """Corner nodes of all tetrahedra, n x 4, and the elements' tags."""
    tags, nodes = gmsh.model.mesh.getElementsByType(4)
    return np.reshape(nodes, (-1, 4)), tags


def second_order_nodes(tets):
    """Nodes of the second-order mesh: one a corner, one an edge."""
    edges = np.sort(np.concatenate([tets[:, pair] for pair in CORNER_PAIRS]), axis=1)
    return len(np.unique(tets)) + len(np.unique(edges, axis=0))


def qualities(tets, points):
    """Mean-ratio quality, 1 for a regular tetrahedron, at most 0 for an inverted one."""
    x = points[tets]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    squares = sum(((x[:, i] - x[:, j]) ** 2).sum(axis=1) for i, j in CORNER_PAIRS)
    return 12 * np.cbrt(9 * np.clip(volume, 0, None) ** 2) / squares


def add_edges(number):
    """Adds that many edges, hence mid-side nodes: the best 2-3 flips inside the solids (two tetrahedra to three)."""
    points = np.zeros((int(gmsh.model.mesh.getMaxNodeTag()) + 1, 3))
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points[tags] = np.reshape(coordinates, (-1, 3))
    choices = []
    for _, volume in gmsh.model.getEntities(3):
        elements, nodes = gmsh.model.mesh.getElementsByType(4, volume)
        tets = np.reshape(nodes, (-1, 4))
        shared = {}
        for e, tet in enumerate(tets):
            for apex in range(4):
                shared.setdefault(frozenset(np.delete(tet, apex).tolist()), []).append((e, tet[apex]))
        for face, sides in shared.items():
            if len(sides) == 2:
                (e, top), (f, bottom) = sides
                ring = sorted(face)
                new = np.array([[top, bottom, ring[i], ring[i - 1]] for i in range(3)], dtype=np.int64)
                if np.linalg.det(points[new[0, 1:]] - points[new[0, 0]]) < 0:
                    new = new[:, [1, 0, 2, 3]]
                choices.append((qualities(new, points).min(), volume, elements[e], elements[f], new))
    touched = set()
    for quality, volume, e, f, new in sorted(choices, key=lambda c: -c[0]):
        if number == 0:
            return
        if quality > 0 and not touched & {e, f}:
            touched |= {e, f}
            gmsh.model.mesh.removeElements(3, volume, [e, f])
            gmsh.model.mesh.addElementsByType(volume, 4, [], new.ravel())
            number -= 1


def search(a, wanted, seconds):
    """Varies the element size a little until flips can close the rest; prints the figures to record."""
    rng, end, base = random.Random(1), time.monotonic() + seconds, a["mesh"]
    while time.monotonic() < end:
        m = dict(base, size_mm=round(base["size_mm"] + rng.uniform(-0.1, 0.1), 3))
        gmsh.model.mesh.clear()
        mesh_solids(m)
        missing = wanted - second_order_nodes(corners()[0])
        if 0 <= missing <= MOST_FLIPS:
            print(f"size_mm = {m['size_mm']} ({missing} flips)")
            return
    sys.exit(f"mesh: {wanted} nodes not met in {seconds} s; change seed_mm or random_seed and search again")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("actuator", type=Path, help="actuator.toml, as in models/pneunet/")
    parser.add_argument("--out", type=Path, help="the .msh to write (default: mesh.file)")
    parser.add_argument("--search", type=float, metavar="SECONDS", help="look for parameters that give mesh.nodes")
    parser.add_argument("--finer", type=float, default=1.0, metavar="TIMES", help="factor on the number of parts of every edge, at least 1")
    args = parser.parse_args()
    if not 1.0 <= args.finer <= 10.0:
        parser.error(f"--finer: expected 1 to 10, found {args.finer}")
    a = tomllib.loads(args.actuator.read_text())
    out = args.out or args.actuator.parent / a["mesh"]["file"]
    if out.suffix != ".msh":
        sys.exit(
            f"{args.actuator}: mesh.file: expected a name with the ending .msh, found {out.name}; give --out FILE.msh and set mesh.file "
            "to it. A .vtu is made by `softtwin mesh`, without gmsh"
        )
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    build_geometry(a)
    name_surfaces(a)
    wanted = a["mesh"]["nodes"] if args.finer == 1.0 else 0
    if args.search:
        return search(a, wanted, args.search)
    mesh_solids(a["mesh"], args.finer)
    missing = wanted - second_order_nodes(corners()[0])
    if wanted and 0 < missing <= MOST_FLIPS:
        add_edges(missing)
    tets, tags = corners()
    quality = gmsh.model.mesh.getElementQualities(tags, "gamma")
    gmsh.model.mesh.setOrder(2)
    count = len(gmsh.model.mesh.getNodes()[0])
    if wanted and count != wanted:
        sys.exit(f"mesh: expected {wanted} nodes, found {count}; search for a size_mm with --search 600")
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(str(out))
    low, middle = np.min(quality), np.median(quality)
    print(f"{out}: {count} nodes, {len(tets)} tetrahedra, quality (gamma) {low:.3f} at least, {middle:.3f} median")


if __name__ == "__main__":
    main()
