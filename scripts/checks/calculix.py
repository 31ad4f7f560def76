"""CalculiX solves what our own solver solves, and its results are imported. See scripts/check.sh.

A finger of a Yeoh rubber on our own mesh, under its weight and a little pressure, free and on a plate: the same nodes, the same law,
pressure on the same faces; the sheet is made so thin that it does nothing. Compared: displacement of every node, force on the plate.
"""
import argparse
import json
import pathlib
import re
import subprocess
import tempfile

import meshio
import numpy

ACTUATOR = "models/pneunet/actuator.toml"
CHANGES = {
    "name": '"finger"', "base.length_mm": 30, "base.width_mm": 3, "base.lower_mm": 3, "base.upper_mm": 3, "body.start_mm": 10,
    "body.length_mm": 6, "body.width_mm": 3, "body.top_mm": 8, "body.pocket_mm": 0.5, "chambers.count": 1, "chambers.first_mm": 12,
    "chambers.length_mm": 2, "chambers.width_mm": 1, "chambers.top_mm": 7, "chambers.pitch_mm": 20, "channels.width_mm": 0.5,
    "channels.top_mm": 6.2, "slots.floor_mm": 6.5, "elastomer.bulk_mpa": 4.4, "sheet.youngs_mpa": 1e-3, "sheet.thickness_mm": 1e-3,
    "loads.gravity_mm_s2": [0.0, -5e4, 0.0], "loads.cavity_load": '"consistent"', "support.fixed": '"base-start"',
    "obstacle.x_mm": [-5.0, 40.0], "obstacle.z_mm": [-5.0, 9.0], "mesh.file": '"mesh.vtu"', "mesh.nodes": 0, "mesh.size_mm": 0.65,
}
LAW = {"c10_mpa": 0.11, "c20_mpa": 0.02, "c30_mpa": 0.0}
PRESSURE_MPA = 0.002
GAP_MM = 1.0
SIZE_MM = 0.65
PENALTY_MPA_PER_MM = 6.63
FACES = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]  # Abaqus' P1 to P4


def actuator(folder):
    """The reference actuator's file with other values."""
    section, lines = "", []
    for line in pathlib.Path(ACTUATOR).read_text().splitlines():
        heading = re.match(r"\[(.*)\]", line)
        section = f"{heading[1]}." if heading else section
        key = re.match(r"(\w+) *=", line)
        if section == "elastomer.law." and key:
            if key[1] == "law":
                lines += ['law = "yeoh"'] + [f"{name} = {value}" for name, value in LAW.items()]
        elif key and section + key[1] in CHANGES:
            lines.append(f"{key[1]} = {CHANGES[section + key[1]]}")
        else:
            lines.append(line)
    path = folder / "actuator.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def listed(numbers, width=8):
    return "\n".join(", ".join(str(n) for n in numbers[i:i + width]) + "," for i in range(0, len(numbers), width)).rstrip(",") + "\n"


def job(mesh, gap_mm):
    """An input file of CalculiX: pressure follows the faces of the cavity; the plate is one element whose nodes are held."""
    points, tets = mesh.points, mesh.cells_dict["tetra10"]
    count = len(points)
    owners = {}
    for e, tet in enumerate(tets):
        for f, face in enumerate(FACES):
            owners.setdefault(tuple(sorted(tet[face])), []).append((e, f))
    outer = [(key, found[0]) for key, found in owners.items() if len(found) == 1]
    low, high = points.min(axis=0), points.max(axis=0)
    centre = {key: points[list(key)].mean(axis=0) for key, _ in outer}
    inside = lambda c: 12 - 1e-6 <= c[0] <= 14 + 1e-6 and 1 - 1e-6 <= c[2] <= 2 + 1e-6 and 3 < c[1] <= 7 + 1e-6
    cavity = [at for key, at in outer if inside(centre[key])]
    bottom = [at for key, at in outer if all(abs(points[list(key)][:, 1] - low[1]) < 1e-6)]
    fixed = [i + 1 for i, p in enumerate(points) if abs(p[0] - low[0]) < 1e-6 and p[1] <= 6 + 1e-6]
    text = "*NODE, NSET=BODY\n" + "".join(f"{i + 1}, {p[0]:.10g}, {p[1]:.10g}, {p[2]:.10g}\n" for i, p in enumerate(points))
    text += "*ELEMENT, TYPE=C3D10, ELSET=RUBBER\n" + "".join(f"{e + 1}, " + ", ".join(str(n + 1) for n in tet) + "\n" for e, tet in enumerate(tets))
    text += "*NSET, NSET=FIXED\n" + listed(fixed)
    bulk = CHANGES["elastomer.bulk_mpa"]
    text += f"*MATERIAL, NAME=RUBBER\n*HYPERELASTIC, YEOH\n{LAW['c10_mpa']}, {LAW['c20_mpa']}, {LAW['c30_mpa']}, {2 / bulk}, 1e10, 1e10\n"
    text += "*DENSITY\n1e-9\n*SOLID SECTION, ELSET=RUBBER, MATERIAL=RUBBER\n"
    if gap_mm is not None:
        y, thick = -gap_mm, 2.0
        corners = [(-5, y - thick, -5), (40, y - thick, -5), (40, y - thick, 9), (-5, y - thick, 9)]
        corners += [(x, y, z) for x, _, z in corners]
        text += "*NODE, NSET=PLATE\n" + "".join(f"{count + k + 1}, {x}, {v}, {z}\n" for k, (x, v, z) in enumerate(corners))
        order = [count + k + 1 for k in (3, 2, 1, 0, 7, 6, 5, 4)]
        text += f"*ELEMENT, TYPE=C3D8, ELSET=PLATE\n{len(tets) + 1}, " + ", ".join(map(str, order)) + "\n"
        text += "*MATERIAL, NAME=STEEL\n*ELASTIC\n1000., 0.3\n*SOLID SECTION, ELSET=PLATE, MATERIAL=STEEL\n*BOUNDARY\nPLATE, 1, 3\n"
        text += "*SURFACE, NAME=BOTTOM\n" + "".join(f"{e + 1}, S{f + 1}\n" for e, f in bottom)
        text += f"*SURFACE, NAME=TOP\n{len(tets) + 1}, S2\n"
        text += "*SURFACE INTERACTION, NAME=PENALTY\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n"
        text += f"{PENALTY_MPA_PER_MM}, 1e-6\n*CONTACT PAIR, INTERACTION=PENALTY, TYPE=SURFACE TO SURFACE\nBOTTOM, TOP\n"
    text += "*BOUNDARY\nFIXED, 1, 3\n*STEP, NLGEOM, INC=200\n*STATIC\n0.1, 1., 1e-4, 0.25\n*DLOAD\nRUBBER, GRAV, 5e4, 0., -1., 0.\n"
    text += "".join(f"{e + 1}, P{f + 1}, {PRESSURE_MPA}\n" for e, f in cavity)
    text += "*NODE FILE, NSET=BODY\nU\n*EL FILE, ELSET=RUBBER\nS\n"
    if gap_mm is not None:
        text += "*NODE PRINT, NSET=PLATE, TOTALS=ONLY\nRF\n"
    return text + "*END STEP\n"


def run(*words, cwd=None):
    ended = subprocess.run(list(map(str, words)), capture_output=True, text=True, cwd=cwd)
    assert ended.returncode == 0, f"{words}: {ended.returncode}\n{ended.stdout[-500:]}{ended.stderr}"
    return ended.stdout


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--programs", required=True)
    parser.add_argument("--keep", help="folder for the files")
    options = parser.parse_args()
    tool = pathlib.Path(options.programs).resolve() / "softtwin"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(options.keep or name)
        description = actuator(folder)
        run(tool, "mesh", "--actuator", description, "--size-mm", SIZE_MM, "--out", folder / "mesh.vtu")
        mesh = meshio.read(folder / "mesh.vtu")
        for state, gap in (("free", None), ("contact", GAP_MM)):
            (folder / f"{state}.inp").write_text(job(mesh, gap))
            run("ccx", "-i", state, cwd=folder)
            run(tool, "import", "results", folder / f"{state}.frd", "--length-unit", "mm", "--stress-unit", "mpa",
                "--ramp", f"pressure_mpa={PRESSURE_MPA}", "--out", folder / f"{state}_db")
            theirs = numpy.load(folder / f"{state}_db" / "snapshots.npy")[0]
            out = folder / f"{state}.npy"
            words = [] if gap is None else ["--gap-mm", gap]
            lines = run(tool, "simulate", "--actuator", description, "--pressure-mpa", PRESSURE_MPA, *words, "--out", out)
            ours, answer = numpy.load(out), json.loads(lines.splitlines()[-1])
            error = numpy.linalg.norm(theirs[:, :3] - ours[:, :3], axis=1).max() / ours[:, 3].max()
            print(f"{state}: {len(ours)} nodes, largest displacement {ours[:, 3].max():.3f} mm, worst node {100 * error:.2f} % of it off")
            assert error <= 0.01, "displacement: at most 1 % of the largest"
            if gap is not None:
                totals = re.findall(r"total force.*\n+\s*(\S+)\s+(\S+)\s+(\S+)", (folder / f"{state}.dat").read_text())
                force, own = abs(float(totals[-1][1])), answer["contact_force_n"]
                print(f"force on the plate: {force:.4f} N by CalculiX, {own:.4f} N by softtwin simulate")
                assert own > 0.1 and abs(force - own) <= 0.02 * own, "force: within 2 %"


if __name__ == "__main__":
    main()
