"""Snapshots of Ansys' static reduced-order models as a database: a folder per quantity with settings.json, points.bin, doe.csv and
`snapshots/*.bin` (a u64 count, then f64, little-endian). One quantity deforms the points, a second one may be a stress."""

import csv
import json
import pathlib
import shutil
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from .cdb import read_cdb_mesh
from .run import Array, Refused, write_vtu

LENGTHS = {"m": 1e3, "cm": 10.0, "mm": 1.0, "in": 25.4}
PRESSURES = {"Pa": 1e-6, "kPa": 1e-3, "bar": 0.1, "MPa": 1.0, "GPa": 1e3, "psi": 6.894757293168e-3}
#: Names of a parameter with its unit in brackets, the column of cases.csv and the units.
COLUMNS = {"pressure": ("pressure_mpa", PRESSURES), "p": ("pressure_mpa", PRESSURES), "gap": ("gap_mm", LENGTHS),
           "force": ("contact_force_n", {"N": 1.0}), "contact_force": ("contact_force_n", {"N": 1.0})}  # fmt: skip


def binary(path: pathlib.Path, count: Optional[int] = None) -> Array:
    data = path.read_bytes()
    stated = int.from_bytes(data[:8], "little")
    if len(data) != 8 + 8 * stated or count not in (None, stated):
        raise Refused(f"{path}: expected {stated if count is None else count} numbers after their count, found {len(data)} bytes")
    values = np.frombuffer(data[8:], "<f8")
    if not np.isfinite(values).all():
        raise Refused(f"{path}: expected finite numbers")
    return values


def design(path: pathlib.Path) -> Tuple[List[str], List[Dict[str, str]]]:
    """Snapshot files, and per state the columns of cases.csv."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        header, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row]
    states: List[Dict[str, str]] = [{} for _ in rows]
    for at, title in enumerate(header[1:], 1):
        name, unit = title.rstrip("]").partition("[")[::2]
        key = name.strip().lower().replace(" ", "_")
        column, units = COLUMNS.get(key, (key, {"": 1.0}))
        factor = units.get(unit) if column in ("pressure_mpa", "gap_mm", "contact_force_n", "split") else None
        if factor is None:
            raise Refused(f"{path}: expected pressure[MPa], gap[mm], contact_force[N] or split (or other units), found {title}")
        for number, (row, state) in enumerate(zip(rows, states), 2):
            try:
                state[column] = row[at] if column == "split" or not row[at] else repr(factor * float(row[at]))
            except (IndexError, ValueError):
                raise Refused(f"{path}: line {number}: expected a number for {title}, found {row}") from None
    if not states or any("pressure_mpa" not in state for state in states):
        raise Refused(f"{path}: expected states with pressure[MPa]")
    if any(state.get("gap_mm") and not state.get("contact_force_n") for state in states):
        raise Refused(f"{path}: expected contact_force[N] for states with a gap")
    if any(pathlib.PurePath(row[0]).name != row[0] for row in rows):
        raise Refused(f"{path}: expected names of files without folders")
    return [row[0] for row in rows], states


def convert(folder: pathlib.Path, out: pathlib.Path) -> str:
    quantities: Dict[bool, Tuple[pathlib.Path, Any, Any]] = {}
    for path in sorted(path.parent for path in folder.glob("*/settings.json")):
        settings = json.loads((path / "settings.json").read_text("utf-8"))
        moves, shape = bool(settings.get("deformation")), settings.get("dimensionality")
        is_known = shape == [3] if moves else shape == [1] or shape == [3, 3] and bool(settings.get("symmetricalDim"))
        factor = (LENGTHS if moves else PRESSURES).get(settings.get("unit"))
        if not is_known or factor is None or settings.get("unitFactor", 1) != 1 or moves in quantities:
            raise Refused(f"{path}: expected one deformation ([3], m) and at most one stress ([1] or symmetric [3, 3], Pa), found {settings}")
        quantities[moves] = path, settings, factor
    if True not in quantities:
        raise Refused(f"{folder}: expected a folder per quantity with settings.json, one of them a deformation")
    path, _, factor = quantities[True]
    files, states = design(path / "doe.csv")
    points = factor * binary(path / "points.bin").reshape(-1, 3)
    fields = [("x", "mm", "coordinate"), ("y", "mm", "coordinate"), ("z", "mm", "coordinate"), ("displacement", "mm", "magnitude")]
    moved = np.stack([factor * binary(path / "snapshots" / name, points.size).reshape(-1, 3) for name in files])
    columns = [points + moved, np.linalg.norm(moved, axis=2, keepdims=True)]
    if False in quantities:
        path, settings, factor = quantities[False]
        if design(path / "doe.csv") != (files, states):
            raise Refused(f"{path}: expected the states of the deformation in doe.csv")
        width = 1 if settings["dimensionality"] == [1] else 6
        s = np.stack([factor * binary(path / "snapshots" / name, width * len(points)).reshape(-1, width) for name in files])
        if width == 6:  # XX, YY, ZZ, XY, YZ, XZ
            normal = sum((s[..., a] - s[..., b]) ** 2 for a, b in ((0, 1), (1, 2), (2, 0)))
            s = np.sqrt(0.5 * normal + 3 * (s[..., 3:] ** 2).sum(axis=2))[..., None]
        columns.append(s)
        fields.append(("von_mises", "MPa", "stress"))
    out.mkdir()
    np.save(out / "snapshots.npy", np.concatenate(columns, axis=2).astype(np.float32))
    mesh = next((folder / f"mesh.{ending}" for ending in ("vtu", "inp", "cdb") if (folder / f"mesh.{ending}").exists()), None)
    name = "" if mesh is None else "mesh.vtu" if mesh.suffix == ".cdb" else mesh.name
    if mesh is not None and mesh.suffix == ".cdb":
        write_vtu(out / name, read_cdb_mesh(mesh)[0])
    elif mesh is not None:
        shutil.copy(mesh, out / name)
    with open(out / "cases.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["case", "regime", "split", "pressure_mpa", "gap_mm", "contact_force_n"])
        for state, source in zip(states, files):
            regime = "contact" if state.get("gap_mm") else "free"
            case = source[:-4] if source.endswith(".bin") else source
            force = state.get("contact_force_n") or "0"
            writer.writerow([case, regime, state.get("split") or "train", state["pressure_mpa"], state.get("gap_mm", ""), force])
    quoted = json.dumps  # TOML's basic strings
    lines = ["layout = 1", f"actuator = {quoted(folder.resolve().name)}", f"nodes = {len(points)}", 'cases = "cases.csv"']
    lines += ['snapshots = "snapshots.npy"', *([f"mesh = {quoted(name)}"] if name else [])]
    for field, unit, kind in fields:
        lines += ["[[field]]", f'name = "{field}"', f'unit = "{unit}"', f'kind = "{kind}"']
    for field, unit in (("pressure_mpa", "MPa"), ("gap_mm", "mm")):
        lines += ["[[input]]", f'name = "{field}"', f'unit = "{unit}"']
    (out / "database.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return f"{len(files)} states of {len(points)} nodes" + ("" if name else "; no surface: no mesh.vtu, mesh.inp or mesh.cdb in the folder")
