"""A finger of our mesher solved by `softtwin simulate` and by CalculiX, and why they differ where they do. See scripts/check.sh.

Two elements, one law: `crates/fem` has one pressure an element, or as CalculiX' C3D10 the pressure of each Gauss point
(`elastomer.volume_change = "points"`). With the same element the programs must agree; `elements.py` is a second implementation of both.
"""
import argparse
import json
import os
import pathlib
import subprocess
import tempfile

import meshio
import numpy
import scipy.spatial

from elements import FACES, Body

LAW, DENSITY, GRAVITY = (0.4, 0.02, 0.004), 1e-9, 9810.0  # MPa, t/mm3, mm/s2
PLATE_MPA_PER_MM, ROUNDING_MM = 66.3, 0.0015
# One chamber in a bar: no slots, walls as wide as the hole, and the sheet too soft to be felt.
FINGER = {
    "base.length_mm": 60.0, "base.width_mm": 6.0, "base.lower_mm": 2.0, "base.upper_mm": 2.0,
    "body.start_mm": 0.0, "body.length_mm": 60.0, "body.width_mm": 6.0, "body.top_mm": 8.0, "body.pocket_mm": 0.0,
    "chambers.count": 1, "chambers.first_mm": 4.0, "chambers.length_mm": 52.0, "chambers.pitch_mm": 60.0, "chambers.width_mm": 2.0,
    "chambers.top_mm": 6.0, "channels.width_mm": 2.0, "channels.top_mm": 5.0,
    "elastomer.density_t_per_mm3": DENSITY, "sheet.youngs_mpa": 1e-9, "support.fixed": '"base-start"',
    "loads.cavity_load": '"consistent"', "mesh.file": '"mesh.vtu"', "mesh.nodes": 0,
    "contact.obstacle_penalty_mpa_per_mm": PLATE_MPA_PER_MM, "contact.obstacle_smoothing_mm": ROUNDING_MM,
}  # fmt: skip
YEOH = ['law = "yeoh"', *(f"c{k}0_mpa = {c}" for k, c in zip((1, 2, 3), LAW))]
# CalculiX stops at a residual of half a per cent of the mean force unless it is told otherwise.
TOLERANCES = ["*CONTROLS, PARAMETERS=FIELD", "1e-5,1e-4"]
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
BARS = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
QUADS = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]


def actuator(bulk, volume_change):
    """The reference's file with the finger's values."""
    stiffness = f'{float(bulk)}\nvolume_change = "{volume_change}"'
    values, lines, section = {**FINGER, "elastomer.bulk_mpa": stiffness}, [], ""
    for line in pathlib.Path("models/pneunet/actuator.toml").read_text().splitlines():
        if line.startswith("["):
            section = line[1 : line.index("]")]
        key = f"{section}.{line.split(' = ')[0]}"
        if section == "elastomer.law" and " = " in line:
            lines, line = lines + YEOH if line.startswith("law") else lines, None
        elif key in values:
            line = f"{line.split(' = ')[0]} = {values.pop(key)}"
        lines += [line] if line is not None else []
    assert not values, f"not in the reference's actuator.toml: {list(values)}"
    return "\n".join(lines) + "\n"


class Finger:
    """A mesh, solved by every program for the same loads."""

    def __init__(self, programs, folder, size, bulk):
        self.program, self.folder, self.bulk = pathlib.Path(programs).resolve() / "softtwin", folder, bulk
        folder.mkdir()
        self.file = folder / "finger.toml"
        self.file.write_text(actuator(bulk, "mean"))
        self.run("mesh", "--actuator", self.file, "--size-mm", size)
        mesh = meshio.read(folder / "mesh.vtu")
        self.points, self.tets = mesh.points.astype(float), mesh.cells[0].data
        self.fixed = numpy.flatnonzero(numpy.abs(self.points[:, 0]) < 1e-6)
        self.high = self.points.max(0)

    def run(self, *arguments):
        ended = subprocess.run([self.program, *map(str, arguments)], capture_output=True, text=True)
        assert ended.returncode == 0, f"{arguments}: {ended.returncode}\n{ended.stderr}"
        return ended.stdout

    def ours(self, volume_change, pressure, gap):
        self.file.write_text(actuator(self.bulk, volume_change))
        plate = [] if gap is None else ["--gap", gap]
        out = self.folder / "state.npy"
        state = self.run("simulate", "--actuator", self.file, "--pressure", pressure, *plate, "--out", out)
        return numpy.load(out)[:, :3] - self.points, json.loads(state.splitlines()[-1])["contact_force_n"]

    def surfaces(self, elements, faces):
        """(element, face) on the cavity's walls and on the underside: every outer face lies on a side of the bar."""
        owners = {}
        for e, element in enumerate(elements):
            for f, face in enumerate(faces):
                owners.setdefault(tuple(sorted(element[face])), []).append((e, f))
        cavity, bottom = [], []
        for nodes, owner in owners.items():
            at = self.points[list(nodes)]
            outer = numpy.concatenate([at.max(0) < 1e-6, (self.high - at).max(0) < 1e-6])
            if len(owner) == 1:
                cavity += [] if outer.any() else owner
                bottom += owner if outer[1] else []
        return cavity, bottom

    def second(self, found, volumetric, face_points, pressure, gap):
        """Results of elements.py for a program's states."""
        surfaces = self.surfaces(self.tets, [face[:3] for face in FACES])
        material = (LAW, self.bulk, DENSITY, volumetric, face_points, (PLATE_MPA_PER_MM, ROUNDING_MM))
        return Body(self.points, self.tets, self.fixed, *surfaces, *material).solve(found[0], GRAVITY, pressure, gap)

    def hexahedra(self):
        """The boxes whose six tetrahedra the mesh has, as 20-node hexahedra."""
        low, high = self.points[self.tets].min(1), self.points[self.tets].max(1)
        boxes = numpy.unique(numpy.round(numpy.hstack([low, high]), 4), axis=0).reshape(-1, 2, 3)
        assert 6 * len(boxes) == len(self.tets), "the mesh is not one of boxes in six tetrahedra each"
        corners = [[[box[c[k], k] for k in range(3)] for c in CORNERS] for box in boxes]
        places = [c + [numpy.mean([c[i], c[j]], 0) for i, j in BARS] for c in corners]
        away, nodes = scipy.spatial.cKDTree(self.points).query(places)
        assert away.max() < 1e-3, f"no node at a corner or an edge's middle of a box, the nearest {away.max():.3g} mm away"
        return nodes

    def body(self, kind):
        """Nodes, elements of that kind, supports and material for CalculiX; elements, and their faces on cavity and underside."""
        elements, faces = (self.tets, [f[:3] for f in FACES]) if kind == "C3D10" else (self.hexahedra(), QUADS)
        cavity, bottom = self.surfaces(elements, faces)
        used = numpy.unique(elements)
        lines = ["*NODE, NSET=BODY", *(f"{n + 1},{','.join(f'{v:.9g}' for v in self.points[n])}" for n in used)]
        lines += [f"*ELEMENT, TYPE={kind}, ELSET=RUBBER"]
        for e, nodes in enumerate(elements + 1):
            words = [str(e + 1), *map(str, nodes)]
            lines += [",".join(words[:11]) + ("," if len(words) > 11 else "")] + [",".join(words[11:])][: len(words) // 12]
        lines += ["*NSET, NSET=FIXED", *(f"{n + 1}," for n in numpy.intersect1d(self.fixed, used)), "*BOUNDARY", "FIXED,1,3"]
        constants = ",".join(map(str, LAW))
        lines += ["*MATERIAL, NAME=YEOH", "*HYPERELASTIC, YEOH", f"{constants},{2 / self.bulk:.9e},0,0", "*DENSITY", f"{DENSITY}"]
        return [*lines, "*SOLID SECTION, ELSET=RUBBER, MATERIAL=YEOH"], elements, cavity, bottom

    def ccx(self, lines):
        """Runs CalculiX and returns the lines of its printed results."""
        (self.folder / "job.inp").write_text("\n".join([*lines, ""]))
        ended = subprocess.run(["ccx", "-i", "job"], cwd=self.folder, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        assert "Job finished" in ended.stdout, f"ccx: {ended.stdout[-1500:]}"
        return (self.folder / "job.dat").read_text().splitlines()

    def calculix(self, kind, pressure, gap):
        """Results of CalculiX with elements C3D10 (the same tetrahedra) or C3D20R (the boxes); displacements are NaN where it has no node."""
        lines, elements, cavity, bottom = self.body(kind)
        if gap is not None:
            lines += plate_lines(len(self.points) + 1, len(elements) + 1, gap, self.high)
            lines += ["*SURFACE, NAME=UNDERSIDE", *(f"{e + 1},S{f + 1}" for e, f in bottom)]
            lines += ["*SURFACE INTERACTION, NAME=PENALTY", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
            lines += [f"{PLATE_MPA_PER_MM}", "*CONTACT PAIR, INTERACTION=PENALTY, TYPE=SURFACE TO SURFACE", "UNDERSIDE,TOP"]
        lines += ["*STEP, NLGEOM, INC=200", "*STATIC", "0.5,1.0,1e-4", *TOLERANCES, "*DLOAD", f"RUBBER,GRAV,{GRAVITY},0,-1,0"]
        lines += [f"{e + 1},P{f + 1},{pressure}" for e, f in cavity]
        lines += ["*NODE PRINT, NSET=BODY, FREQUENCY=999", "U"]
        lines += [] if gap is None else ["*NODE PRINT, NSET=PLATE, FREQUENCY=999, TOTALS=ONLY", "RF"]
        moved, force = numpy.full_like(self.points, numpy.nan), 0.0
        for row in (line.split() for line in self.ccx([*lines, "*END STEP"])):
            if len(row) == 4 and row[0].isdigit():
                moved[int(row[0]) - 1] = [float(v) for v in row[1:]]
            elif len(row) == 3 and gap is not None:
                force = float(row[1])
        return moved, force


    def swing(self, trace, step):
        """Height of the tip over time by both programs: same elements, same method (alpha = -0.05), no damping. The trace has times, pressures
        and factors of gravity."""
        self.file.write_text(actuator(self.bulk, "points"))
        (self.folder / "trace.csv").write_text(
            "t_s,pressure_mpa,loads.gravity_mm_s2.1\n" + "".join(f"{t},{p},{-GRAVITY * g}\n" for t, p, g in trace)
        )
        options = ["--trace", self.folder / "trace.csv", "--out", self.folder / "swing", "--step-ms", 1e3 * step, "--step-error-mm", 1000]
        self.run("simulate", "--actuator", self.file, "--set", "dynamics.beta_s=0", *options)
        table = numpy.genfromtxt(self.folder / "swing" / "series.csv", delimiter=",", names=True)
        tip = numpy.linalg.norm(self.points - [self.high[0], *self.points[self.points[:, 0] > self.high[0] - 0.01, 1:].mean(0)], axis=1).argmin()
        lines, _, cavity, _ = self.body("C3D10")
        start = trace[0][1]
        lines += [f"*NSET, NSET=TIP\n{tip + 1},", "*AMPLITUDE, NAME=PRESSURE", *(f"{t},{p / start}" for t, p, _ in trace)]
        lines += ["*AMPLITUDE, NAME=WEIGHT", *(f"{t},{g}" for t, _, g in trace)]
        gravity, wall = f"RUBBER,GRAV,{GRAVITY},0,-1,0", [f"{e + 1},P{f + 1},{start}" for e, f in cavity]
        lines += ["*STEP, NLGEOM, INC=200", "*STATIC", "0.5,1.0,1e-4", *TOLERANCES, "*DLOAD", gravity, *wall, "*EL FILE", "ENER", "*END STEP"]
        lines += ["*STEP, NLGEOM, INC=100000", "*DYNAMIC, DIRECT, ALPHA=-0.05", f"{step},{trace[-1][0]}", *TOLERANCES]
        lines += ["*DLOAD, AMPLITUDE=WEIGHT", gravity, "*DLOAD, AMPLITUDE=PRESSURE", *wall]
        printed = self.ccx([*lines, "*NODE PRINT, NSET=TIP, FREQUENCY=1", "U", "*END STEP"])
        rows, time = [], 0.0
        for line in printed:
            words = line.split()
            time = float(words[-1]) if "time" in words else time
            if len(words) == 4 and words[0] == str(tip + 1):
                rows.append((time - 1.0, float(words[2])))  # the static step takes the first second
        theirs = numpy.array(rows)[1:]
        at_rest = self.points[tip, 1]
        return (table["t_s"], table["tip_y_mm"] - at_rest), (theirs[:, 0], theirs[:, 1])


def swing_of(t, y):
    """Frequency and amplitudes (half the heights) of the lowest mode, by six extrema after the step, refined by parabolas."""
    turns, least = [], 0.3 * (y.max() - y.min())
    for k in range(1, len(y) - 1):
        if t[k] > 0.01 and (y[k] - y[k - 1]) * (y[k + 1] - y[k]) < 0 and (not turns or abs(y[k] - y[turns[-1]]) > least):
            turns.append(k)
    assert len(turns) >= 6, f"{len(turns)} extrema, expected 6"
    times, heights = [], []
    for k in turns[:6]:
        d = 0.5 * (y[k - 1] - y[k + 1]) / (y[k - 1] - 2 * y[k] + y[k + 1])
        times.append(t[k] + d * (t[k + 1] - t[k]))
        heights.append(y[k] - 0.25 * (y[k - 1] - y[k + 1]) * d)
    return 2.5 / (times[5] - times[0]), 0.5 * numpy.abs(numpy.diff(heights))


def plate_lines(node, element, gap, high):
    """A rigid block below, its top face in the plane y = -gap."""
    low, top = (-5.0, -gap - 2.0, -5.0), (high[0] + 5.0, -gap, high[2] + 5.0)
    places = [[(low, top)[c[k]][k] for k in range(3)] for c in CORNERS]
    lines = ["*NODE, NSET=PLATE", *(f"{node + i},{','.join(f'{v:.9g}' for v in p)}" for i, p in enumerate(places))]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=BLOCK", ",".join(map(str, [element, *range(node, node + 8)])), "*BOUNDARY", "PLATE,1,3"]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "200000,0.3", "*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL"]
    return [*lines, "*SURFACE, NAME=TOP", f"{element},S5"]


class Book:
    """Comparisons, printed as they come."""

    def __init__(self):
        self.missed = []
        print(f"{'':44} {'displacement':>22} {'force (N)':>18}\n{'':44} {'largest (mm)   off':>22} {'':>9} {'off':>8}")

    def compare(self, what, found, reference, bounds=None):
        """Largest distance of a node from the reference's place, relative to the largest displacement; force relative to force."""
        (moved, force), (expected, expected_force) = found, reference
        there = ~numpy.isnan(moved + expected).any(1)
        largest = numpy.linalg.norm(expected[there], axis=1).max()
        errors = [numpy.linalg.norm((moved - expected)[there], axis=1).max() / largest]
        errors += [abs(force / expected_force - 1)] if expected_force else []
        missed = bounds is not None and any(not error <= bound for error, bound in zip(errors, bounds))
        at_most = f"  at most {', '.join(f'{100 * b:g} %' for b in bounds[: len(errors)])}" if bounds else ""
        size = numpy.linalg.norm(moved[there], axis=1).max()
        text = f"{what:44} {size:9.5f} {100 * errors[0]:10.4f} %"
        text += f" {force:9.6f} {100 * errors[1]:8.4f} %" if expected_force else ""
        print(text + at_most + ("  MISSED" if missed else ""), flush=True)
        self.missed += [what] if missed else []


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", required=True)
    parser.add_argument("--bulk", type=float, nargs="+", default=[20.0, 2000.0], help="bulk moduli (MPa); the shear modulus is 0.8")
    parser.add_argument("--size-mm", type=float, default=6.0)
    parser.add_argument("--pressure-mpa", type=float, default=0.1)
    parser.add_argument("--gap-mm", type=float, default=0.6)
    parser.add_argument("--finer-mm", type=float, nargs="*", default=[], help="sizes of finer meshes on which both programs are compared")
    options = parser.parse_args()
    book, loads = Book(), [(0.0, None), (options.pressure_mpa, None), (options.pressure_mpa, options.gap_mm)]
    with tempfile.TemporaryDirectory() as folder:
        for bulk in options.bulk:
            finger = Finger(options.programs, pathlib.Path(folder) / f"{bulk}", options.size_mm, bulk)
            for pressure, gap in loads:
                print(f"\nK = {bulk:g} MPa, {len(finger.points)} nodes, {pressure:g} MPa, {'no plate' if gap is None else f'plate at {gap:g} mm'}")
                found = {change: finger.ours(change, pressure, gap) for change in ("points", "mean")}
                calculix = finger.calculix("C3D10", pressure, gap)
                for change, ours in found.items():
                    book.compare(f"softtwin, {change} / second implementation", ours, finger.second(ours, change, 6, pressure, gap), (1e-4, 1e-4))
                book.compare("softtwin, points / CalculiX C3D10", found["points"], calculix, (0.01, 0.02))
                book.compare("softtwin, mean / CalculiX C3D10", found["mean"], calculix)
                book.compare("softtwin, mean / CalculiX C3D20R", found["mean"], finger.calculix("C3D20R", pressure, gap))
        finger = Finger(options.programs, pathlib.Path(folder) / "swing", options.size_mm, options.bulk[0])
        step, trace = 1e-3, [(0.0, 0.02, 1.0), (0.005, 0.06, 0.5), (0.25, 0.06, 0.5)]
        (ours_hz, ours_mm), (ccx_hz, ccx_mm) = (swing_of(*series) for series in finger.swing(trace, step))
        off = ours_hz / ccx_hz - 1, numpy.abs(ours_mm / ccx_mm - 1).max()
        print(f"\nswing after a step of pressure and gravity: softtwin {ours_hz:.4f} Hz, {ours_mm.max():.4f} mm; CalculiX *DYNAMIC {ccx_hz:.4f} Hz, {ccx_mm.max():.4f} mm")
        print(f"{100 * off[0]:+.3f} % in frequency (at most 1 %), {100 * off[1]:.3f} % in amplitude (at most 3 %)", flush=True)
        book.missed += ["swing"] if abs(off[0]) > 0.01 or off[1] > 0.03 else []
        for size in options.finer_mm:
            finger = Finger(options.programs, pathlib.Path(folder) / f"finer-{size}", size, options.bulk[0])
            for pressure, gap in loads:
                print(f"\n{size:g} mm, {len(finger.points)} nodes, {pressure:g} MPa, {'no plate' if gap is None else f'plate at {gap:g} mm'}")
                calculix = finger.calculix("C3D20R", pressure, gap)
                book.compare("softtwin, mean / CalculiX C3D20R", finger.ours("mean", pressure, gap), calculix)
    assert not book.missed, f"{len(book.missed)} comparisons miss their bound: {book.missed}"


main()
