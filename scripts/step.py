"""Meshes a STEP file with gmsh: `softtwin mesh --step` runs it, with a JSON object of options, and reads the JSON object it prints.

Parts that touch are bonded. Volumes have the names of the file's parts. Closed inner walls are `cavity`, `cavity.2`, ... from small x on;
other surfaces are chosen by `faces`: the plane end of an axis (xmin, xmax, ymin, ...), `outer`, or face numbers joined by `+`.
"""

import json
import sys

import gmsh
import numpy as np

# Growth of the element size per distance from a thin wall.
GROWTH = 0.4


def import_parts(path):
    """Bonded solids of the file: names of its parts, each with its volumes."""
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    solids = [entity for entity in gmsh.model.occ.importShapes(path) if entity[0] == 3]
    if not solids:
        sys.exit("expected solids, found none: export the parts as solids, not as surfaces")
    gmsh.model.occ.synchronize()
    names = [gmsh.model.getEntityName(*solid).split("/")[-1] for solid in solids]
    pieces = [[solid] for solid in solids]
    if len(solids) > 1:
        _, pieces = gmsh.model.occ.fragment(solids[:1], solids[1:])
        gmsh.model.occ.synchronize()
    parts = {}
    for place, (name, own) in enumerate(zip(names, pieces)):
        # gmsh's own writer leaves the name of its translator.
        label = name if name and "STEP translator" not in name else f"part{place + 1}"
        while label in parts:
            label += f"-{place + 1}"
        parts[label] = [tag for dim, tag in own if dim == 3]
    return parts


def shells():
    """Connected boundary surfaces of the whole body: the outer one, then the inner ones by x."""
    faces = [tag for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), combined=True, oriented=False)]
    edges = {tag: {abs(e) for _, e in gmsh.model.getBoundary([(2, tag)], oriented=False)} for tag in faces}
    groups = []
    for tag in faces:
        joined = [g for g in groups if any(edges[tag] & edges[other] for other in g)]
        groups = [g for g in groups if g not in joined] + [sum(joined, [tag])]
    extent = lambda g: np.prod(np.ptp(np.array([gmsh.model.getBoundingBox(2, t) for t in g]).reshape(-1, 3), axis=0))
    outer = max(groups, key=extent)
    inner = sorted((g for g in groups if g is not outer), key=lambda g: min(gmsh.model.getBoundingBox(2, t)[0] for t in g))
    return outer, inner


def chosen(selection, outer):
    """Faces of a selection among the outer ones."""
    if selection == "outer":
        return outer
    boxes = {tag: gmsh.model.getBoundingBox(2, tag) for tag in outer}
    ends = {axis + end: (k, end) for k, axis in enumerate("xyz") for end in ("min", "max")}
    if selection in ends:
        axis, end = ends[selection]
        at = (min if end == "min" else max)(box[axis + 3 * (end == "max")] for box in boxes.values())
        return [tag for tag, box in boxes.items() if max(abs(box[axis] - at), abs(box[axis + 3] - at)) < 1e-3]
    try:
        tags = [int(word) for word in selection.split("+")]
    except ValueError:
        sys.exit(f"expected {', '.join(ends)}, outer or face numbers joined by +, found {selection}")
    known = {tag for _, tag in gmsh.model.getEntities(2)}
    if missing := sorted(set(tags) - known):
        sys.exit(f"no face {', '.join(map(str, missing))}; there are 1 to {max(known)}")
    return tags


def thicknesses():
    """Middles of the surface triangles and the wall's thickness behind each, by a ray along the inner normal."""
    tags, points, _ = gmsh.model.mesh.getNodes()
    place = np.zeros((int(max(tags)) + 1, 3))
    place[tags] = np.reshape(points, (-1, 3))
    triangles = place[np.reshape(gmsh.model.mesh.getElementsByType(2)[1], (-1, 3))]
    middle = triangles.mean(axis=1)
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(first, second)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    wall = np.full(len(middle), np.inf)
    for k in range(len(middle)):
        for ray in (normal[k], -normal[k]):
            h = np.cross(ray, second)
            a = np.einsum("ij,ij->i", first, h)
            crosses = np.abs(a) > 1e-12 * np.abs(a).max()
            a = np.where(crosses, a, 1.0)
            s = middle[k] - triangles[:, 0]
            u = np.einsum("ij,ij->i", s, h) / a
            q = np.cross(s, first)
            v = q @ ray / a
            t = np.einsum("ij,ij->i", second, q) / a
            hit = crosses & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
            if hit.any() and solid_behind(middle[k] + 0.5 * t[hit].min() * ray):
                wall[k] = min(wall[k], t[hit].min())
    return middle, wall


def solid_behind(point):
    return any(gmsh.model.isInside(3, tag, point) for _, tag in gmsh.model.getEntities(3))


def refine(size, through):
    """Elements of at most `size`; at thin walls, of the thickness over `through`, at least 10 % of the size, growing away from them."""
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
    gmsh.model.mesh.generate(2)
    middle, wall = thicknesses()
    gmsh.model.mesh.clear()
    wanted = np.maximum(wall / through, 0.1 * size)
    thin = wanted < size
    if thin.any():
        places, wanted = middle[thin], wanted[thin]
        growing = lambda x: float((wanted + GROWTH * np.linalg.norm(places - x, axis=1)).min())
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, own: min(own, growing((x, y, z))))
    return float(wall.min()) if np.isfinite(wall.min()) else None


def main():
    options = json.loads(sys.argv[1])
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    parts = import_parts(options["step"])
    outer, inner = shells()
    groups = {("cavity" if k == 0 else f"cavity.{k + 1}"): tags for k, tags in enumerate(inner)}
    for name, selection in options["faces"]:
        tags = chosen(selection, outer)
        if not tags:
            sys.exit(f"{name}: no plane face at {selection}")
        groups[name] = sorted({*groups.get(name, []), *tags})
    wall = refine(options["size_mm"], options["through"])
    for name, tags in parts.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    for option, value in {"ElementOrder": 2, "SecondOrderLinear": 1, "Optimize": 1, "MshFileVersion": 4.1, "Binary": 1}.items():
        gmsh.option.setNumber(f"Mesh.{option}", value)
    gmsh.model.mesh.generate(3)
    gmsh.write(options["out"])
    elements, _ = gmsh.model.mesh.getElementsByType(11)
    quality = gmsh.model.mesh.getElementQualities(elements, "gamma")
    faces = [
        {"face": tag, "area_mm2": gmsh.model.occ.getMass(2, tag), "centre_mm": list(gmsh.model.occ.getCenterOfMass(2, tag))}
        for _, tag in gmsh.model.getEntities(2)
    ]
    centres = {face["face"]: np.array(face["centre_mm"]) * face["area_mm2"] for face in faces}
    areas = {face["face"]: face["area_mm2"] for face in faces}
    cavities = [
        {"name": name, "faces": tags, "centre_mm": list(sum(centres[tag] for tag in tags) / sum(areas[tag] for tag in tags))}
        for name, tags in groups.items() if name.split(".")[0] == "cavity"
    ]
    print(json.dumps({
        "tetrahedra": len(elements), "quality_least": float(min(quality)), "quality_median": float(np.median(quality)),
        "below_0_1": int((quality < 0.1).sum()), "thinnest_wall_mm": wall, "faces": faces,
        "cavities": cavities, "volume_mm3": sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3)),
    }))


main()
