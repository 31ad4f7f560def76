"""`softtwin-convert`: results and meshes of other programs as files that softtwin reads, recordings as files that Foxglove draws.

    softtwin-convert run.xdmf     run.npz: XDMF of FEniCS, meshio, ParaView (numbers in the file, in binary files or HDF5)
    softtwin-convert run.xplt     run.npz: FEBio 3 and 4, compressed or not
    softtwin-convert run.cdb      run.npz: Ansys' archive with run.csv, run.txt or run.lis (PRNSOL); without them run.vtu
    softtwin-convert run.rpt      run.csv: Abaqus' field report, for the run.inp of the same name
    softtwin-convert run.vtk      run.npz, or run.vtu if no values are at its nodes: any other file that meshio reads
    softtwin-convert exchange/    exchange-database/: snapshots of Ansys' static reduced-order models
    softtwin-convert run.mcap     run.foxglove.mcap: coloured surface, points, frames and numbers
"""

import argparse
import pathlib
import re
import sys
from typing import Optional, Sequence

import numpy as np

from . import cdb, exchange, tables, xdmf, xplt
from .run import SIZES, Refused, Run, write_npz, write_vtu

READERS = {".xdmf": xdmf.read, ".xmf": xdmf.read, ".xplt": xplt.read, ".cdb": cdb.read_cdb}
__all__ = ["Refused", "Run", "convert", "main", "read"]


def read(path: pathlib.Path) -> Run:
    """Nodes, cells and states of a file, by its ending."""
    reader = READERS.get(path.suffix.lower())
    if reader:
        return reader(path)
    if path.suffix.lower() == ".inp":
        raise Refused("expected a file that softtwin does not read itself: softtwin import (results) applies systems and instances of .inp")
    if path.suffix.lower() in (".bdf", ".fem", ".nas"):
        refuse_systems(path)
    import meshio

    try:
        mesh = meshio.read(path)
    except meshio.ReadError as error:
        raise Refused(f"expected .xdmf, .xplt, .cdb, .rpt, .mcap, a folder or a file that meshio reads: {error}") from None
    left_out = [f"cells {block.type}" for block in mesh.cells if block.type not in SIZES]
    cells = {kind: mesh.get_cells_type(kind) for kind in dict.fromkeys(block.type for block in mesh.cells) if kind in SIZES}
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    values = {name: np.asarray(data).reshape(len(points), -1).squeeze() for name, data in mesh.point_data.items()}
    return Run(points, cells, [(None, values)] if values else [], left_out)


def refuse_systems(path: pathlib.Path) -> None:
    """Refuses what meshio's reader of Nastran ignores: nodes in other systems, and nodes in other files."""
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
        found = re.match(r"(CORD\d\w|GRDSET|INCLUDE)\b", line.strip().upper())
        if found:
            raise Refused(f"line {number}: expected one file with all nodes in the global system, found {found[1]}")


def convert(path: pathlib.Path, out: Optional[pathlib.Path] = None, **looks: object) -> str:
    """Converts one file or folder and returns one line that names the result. A mesh alone is written if `out` ends in .vtu."""
    if path.suffix.lower() == ".mcap":
        from . import foxglove

        out = out or path.with_suffix(".foxglove.mcap")
        return f"{out}: {foxglove.convert(path, out, **looks)}"  # type: ignore[arg-type]
    if path.is_dir():
        out = out or path.with_name(path.resolve().name + "-database")
        return f"{out}: {exchange.convert(path, out)}"
    if path.suffix.lower() == ".rpt":
        out = path.with_suffix(".csv") if out is None or out.suffix == ".npz" else out
        return f"{out}: {tables.convert_rpt(path, out)}"
    run = read(path)
    if not run.cells:
        raise Refused("expected cells that softtwin reads: " + ", ".join(SIZES))
    out = out or path.with_suffix(".npz" if run.states else ".vtu")
    (write_vtu if out.suffix == ".vtu" else write_npz)(out, run)
    cells = ", ".join(f"{len(nodes)} {kind}" for kind, nodes in run.cells.items())
    names = dict.fromkeys(name for _, values in run.states for name in values)
    states = f", {len(run.states)} states of {', '.join(names)}" if run.states and out.suffix != ".vtu" else ""
    left_out = "".join(f"\n  left out: {reason}" for reason in run.left_out)
    return f"{out}: {len(run.points)} nodes, {cells}{states}{left_out}"


def main(arguments: Optional[Sequence[str]] = None) -> int:
    parser = argparse.ArgumentParser("softtwin-convert", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", metavar="FILE", nargs="+", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, help="file to write; with one FILE only")
    recordings = parser.add_argument_group("recordings")
    recordings.add_argument("--model", action="append", default=[], type=pathlib.Path, help="model file of an actuator, for its surface")
    recordings.add_argument("--scene", type=pathlib.Path, help="scene file: its models, and the places of its actuators")
    recordings.add_argument("--frames", type=float, default=30.0, help="pictures per second of each field topic (default: 30)")
    options = parser.parse_args(arguments)
    if options.out and len(options.paths) > 1:
        parser.error("--out: expected one FILE")
    for path in options.paths:
        is_recording = path.suffix.lower() == ".mcap"
        looks = {"models": options.model, "scene": options.scene, "frames": options.frames} if is_recording else {}
        try:
            print(convert(path, options.out, **looks))
        except ImportError as error:
            sys.exit(f"softtwin-convert: {error}; install with: pip install 'softtwin[convert]'")
        except (Refused, OSError, ValueError, KeyError, IndexError) as error:
            sys.exit(f"softtwin-convert: {path}: {error}")
    return 0
