#!/usr/bin/env python3
"""Makes the meshes of models/shapes with gmsh's Python package, which scripts/mesh.py installs: target/mesh-venv/bin/python scripts/shapes.py."""

import sys
from pathlib import Path

import gmsh

FOLDER = Path(__file__).resolve().parents[1] / "models/shapes"
occ = gmsh.model.occ


def box(x0, y0, z0, x1, y1, z1):
    return 3, occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)


def faces_in(x0, y0, z0, x1, y1, z1):
    """Tags of the faces within a box."""
    slack = 1e-3
    entities = gmsh.model.getEntitiesInBoundingBox(x0 - slack, y0 - slack, z0 - slack, x1 + slack, y1 + slack, z1 + slack, 2)
    return [tag for _, tag in entities]


def name(**surfaces):
    """Named surfaces, `cavity__left` for `cavity.left`; the whole body is one volume unless volumes are named."""
    for key, tags in surfaces.items():
        gmsh.model.addPhysicalGroup(2, tags, name=key.replace("__", "."))
    if not gmsh.model.getPhysicalGroups(3):
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="silicone")


def two_chambers():
    """Bar with a chamber above and one below its middle: bends either way."""
    hollow = [box(4, 2, 3, 46, 5, 9), box(4, 9, 3, 46, 12, 9)]
    occ.cut([box(0, 0, 0, 50, 14, 12)], hollow)
    occ.synchronize()
    name(clamp=faces_in(0, 0, 0, 0, 14, 12), cavity=faces_in(4, 9, 3, 46, 12, 9), cavity__lower=faces_in(4, 2, 3, 46, 5, 9))
    return 5.0


def skeleton():
    """Silicone block with a chamber on a strip of plastic, notched into hinges."""
    soft, _ = occ.cut([box(0, 2, 0, 56, 14, 12)], [box(4, 5, 3, 52, 11, 9)])
    strips = [box(x, 0, 2, x + 8, 2, 10) for x in range(0, 56, 16)]
    hinges = [box(x, 1, 2, x + 8, 2, 10) for x in range(8, 56, 16)]
    stiff, _ = occ.fuse(strips[:1], strips[1:] + hinges)
    occ.fragment(soft, stiff)
    occ.synchronize()
    bone = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(-1, -0.1, -1, 57, 2.1, 13, 3)]
    rest = [tag for _, tag in gmsh.model.getEntities(3) if tag not in bone]
    gmsh.model.addPhysicalGroup(3, bone, name="skeleton")
    gmsh.model.addPhysicalGroup(3, rest, name="silicone")
    name(clamp=faces_in(0, 0, 0, 0, 14, 12), cavity=faces_in(4, 5, 3, 52, 11, 9))
    return 5.0


def wound_tube():
    """Tube along x with stiff ends, wound on its mantle."""
    ends = [(3, occ.addCylinder(x, 0, 0, 3, 0, 0, 6)) for x in (0, 37)]
    wall, _ = occ.cut([(3, occ.addCylinder(3, 0, 0, 34, 0, 0, 6))], [(3, occ.addCylinder(3, 0, 0, 34, 0, 0, 4.5))])
    occ.fragment(wall, ends)
    occ.synchronize()
    caps = [tag for x in (0, 37) for _, tag in gmsh.model.getEntitiesInBoundingBox(x - 0.1, -7, -7, x + 3.1, 7, 7, 3)]
    gmsh.model.addPhysicalGroup(3, caps, name="ends")
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3) if tag not in caps], name="silicone")
    inside = [t for t in faces_in(3, -4.5, -4.5, 37, 4.5, 4.5)]
    mantle = [t for t in faces_in(3, -6, -6, 37, 6, 6) if t not in inside and gmsh.model.getType(2, t) == "Cylinder"]
    name(clamp=faces_in(0, -6, -6, 0, 6, 6), cavity=inside, film__wrap=mantle)
    return 3.0


def bellows():
    """Closed bellows of three folds along x."""
    outer = [(0, 0), (0, 6), (4, 6)] + [p for k in range(3) for p in ((7 + 6 * k, 10), (10 + 6 * k, 6))] + [(26, 6), (26, 0)]
    inner = [(3, 0), (3, 4.5), (4, 4.5)] + [p for k in range(3) for p in ((7 + 6 * k, 8.5), (10 + 6 * k, 4.5))] + [(23, 4.5), (23, 0)]

    def turned(outline):
        points = [occ.addPoint(x, r, 0) for x, r in outline]
        lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
        face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        return [e for e in occ.revolve([(2, face)], 0, 0, 0, 1, 0, 0, 6.283185307179586) if e[0] == 3]

    occ.cut(turned(outer), turned(inner))
    occ.synchronize()
    clamp = faces_in(0, -6, -6, 0, 6, 6)
    skin = [tag for _, tag in gmsh.model.getEntities(2)]
    loops = gmsh.model.occ.getSurfaceLoops(gmsh.model.getEntities(3)[0][1])[1]
    inside = min((list(loop) for loop in loops), key=lambda loop: sum(occ.getMass(2, t) for t in loop))
    name(clamp=[t for t in clamp if t in skin and t not in inside], cavity=inside)
    return 4.0


def main():
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    for make in (two_chambers, skeleton, wound_tube, bellows):
        gmsh.clear()
        size = make()
        for option, value in {
            "Mesh.MeshSizeMax": size,
            "Mesh.MeshSizeFromCurvature": 12,
            "Mesh.ElementOrder": 2,
            "Mesh.SecondOrderLinear": 1,
            "Mesh.MshFileVersion": 4.1,
            "Mesh.Binary": 1,
            "Mesh.Optimize": 1,
        }.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.mesh.generate(3)
        out = FOLDER / make.__name__.replace("_", "-") / "mesh.msh"
        gmsh.write(str(out))
        print(f"{out}: {len(gmsh.model.mesh.getNodes()[0])} nodes, {out.stat().st_size // 1000} kB")


if __name__ == "__main__":
    sys.exit(main())
