"""Values at nodes in text files: tables, listings of Ansys' PRNSOL, field reports of Abaqus."""

import csv
import pathlib
import re
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from .run import Array, Refused, Values

#: Endings of components in their order, and what may separate them from the name.
ENDINGS = (["1", "2", "3", "11", "22", "33", "12", "13", "23"], ["x", "y", "z", "xy", "yz", "xz"])


def quantities(columns: Sequence[str], rows: Array) -> Values:
    """Columns of one quantity together: U1, U2, U3 or UX, UY, UZ are U, SX, ..., SXZ are S."""
    lower = {name.lower() for name in columns}
    groups: Dict[str, List[Tuple[int, int]]] = {}
    for at, name in enumerate(columns):
        ending = next((e for e in reversed(ENDINGS[1]) if name.lower().endswith(e) and name.lower() != e
                       and all(name.lower()[: -len(e)] + axis in lower for axis in "xyz")), None)  # fmt: skip
        stem = name[: -len(ending)] if ending else name.rstrip("123")
        rest = name[len(stem) :].lower()
        rank = next((order.index(rest) for order in ENDINGS if rest in order), 99)
        groups.setdefault(stem.rstrip("-._:"), []).append((rank, at))
    return {name: np.squeeze(rows[:, [at for _, at in sorted(found)]], axis=1) if len(found) == 1
            else rows[:, [at for _, at in sorted(found)]] for name, found in groups.items()}  # fmt: skip


class Tables:
    """Rows by state and columns, from tables or listings with a node number per row."""

    def __init__(self) -> None:
        self.states: Dict[str, Tuple[List[Optional[float]], Dict[Tuple[str, ...], Dict[int, List[float]]]]] = {}

    def rows(self, state: str, time: Optional[float], columns: Sequence[str]) -> Dict[int, List[float]]:
        lower = [name.lower() for name in columns]
        twice = next((name for at, name in enumerate(lower) if name in lower[:at]), None)
        if twice is not None:
            raise Refused(f"{state}: expected every column once, found {twice} twice (several section points: report one)")
        times, tables = self.states.setdefault(state, ([], {}))
        times.append(time)
        return tables.setdefault(tuple(columns), {})

    def time(self, state: str) -> Optional[float]:
        return next((time for time in self.states[state][0] if time is not None), None)

    def at_nodes(self, labels: Sequence[int]) -> List[Tuple[Optional[float], Values]]:
        place = {label: at for at, label in enumerate(labels)}
        found = []
        for state, (_, tables) in self.states.items():
            values: Values = {}
            for columns, rows in tables.items():
                unknown = [label for label in rows if label not in place]
                if unknown:
                    raise Refused(f"{state}: expected nodes of the mesh, found {unknown[0]}")
                table = np.full((len(labels), len(columns)), np.nan)
                for label, row in rows.items():
                    table[place[label]] = row
                for name, array in quantities(columns, table).items():
                    known: np.ndarray = np.asarray(values.setdefault(name, array))
                    if known.shape != array.shape or not np.allclose(known, array, rtol=1e-6, atol=0, equal_nan=True):
                        raise Refused(f"{state}: expected {name} once, found two tables of it with other values")
            found.append((self.time(state), values))
        return found


def take(rows: Dict[int, List[float]], label: int, values: List[float], place: str) -> None:
    if label in rows and not np.allclose(rows[label], values, rtol=1e-6, atol=0):
        raise Refused(f"{place}: expected every node once (Ansys: /GRAPHICS,FULL; Abaqus: Unique Nodal, one part), found node {label} again")
    rows[label] = values


def numbers(line: str, columns: Sequence[str], place: str) -> Tuple[int, List[float]]:
    """Node and values of a line whose numbers may touch: `1-0.25E-01 0.5`."""
    try:
        label, *values = (float(word) for word in re.sub(r"(?<=[^\sEe])(?=[+-])", " ", line).split())
    except ValueError:
        values, label = [], np.nan
    if len(values) != len(columns) or label % 1 or not np.isfinite(values).all():
        raise Refused(f"{place}: expected a node and {len(columns)} numbers, found {line.strip()[:80]}")
    return int(label), values


def read_prnsol(path: pathlib.Path) -> Tables:
    """Listings of Ansys' PRNSOL: a line NODE with the names of the columns, then a line per node."""
    tables, state, time, rows, columns = Tables(), "step 1", None, None, []
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
        words, place = line.split(), f"{path}: line {number}"
        if not words:
            continue
        if "LOAD STEP=" in line:
            step = line.split("LOAD STEP=")[1].split()[0]
            substep = line.split("SUBSTEP=")[1].split()[0] if "SUBSTEP=" in line else "1"
            state, time, rows = f"step {step} substep {substep}", None, None
        elif words[0].startswith("TIME="):
            time = float(line.split("TIME=")[1].split()[0])
        elif words[0].startswith("FREQ="):
            raise Refused(f"{place}: expected states of a static or transient solution, found a mode of vibration")
        elif line.strip().startswith("THE FOLLOWING") and "GLOBAL" not in line:
            raise Refused(f"{place}: expected results in the global system (RSYS,0 before PRNSOL), found {line.strip()[:80]}")
        elif words[0].upper() == "NODE" and not any(re.fullmatch(r"[-+.\d]+", word) for word in words[1:]):
            columns = words[1:]
            rows = tables.rows(state, time, columns)
        elif words[0][0].isdigit():
            if re.search(r"[A-DF-Za-df-z]", line):
                rows = None  # a title
            elif rows is None:
                raise Refused(f"{place}: expected a line NODE with the names of the columns before the numbers")
            else:
                take(rows, *numbers(line, columns, place), f"{place}, {state}")
        else:
            rows = None
    if not tables.states:
        raise Refused(f"{path}: expected listings of PRNSOL, found no line NODE")
    return tables


def read_table(path: pathlib.Path) -> Tables:
    """A table with columns node, optionally step and time, and the values."""
    tables = Tables()
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        names = [name.lower() for name in reader.fieldnames or []]
        if len(set(names)) < len(names):
            raise Refused(f"{path}: line 1: expected every column once, found {', '.join(names)}")
        for number, row in enumerate(reader, 2):
            own = {name.lower(): name for name in row if isinstance(name, str)}
            columns = [name for key, name in own.items() if key not in ("node", "step", "time")]
            try:
                time = float(row[own["time"]]) if "time" in own else None
                state, label = f"step {row[own['step']] if 'step' in own else 1}", int(row[own["node"]])
                values = [float(row[name]) for name in columns]
            except (KeyError, TypeError, ValueError) as error:
                raise Refused(f"{path}: line {number}: expected a column node, a node and a number per column, found {error}") from None
            take(tables.rows(state, time, columns), label, values, f"{path}: line {number}")
    return tables


def convert_rpt(path: pathlib.Path, out: pathlib.Path) -> str:
    """Abaqus' field report of Unique Nodal values as a table with columns node, step, time and components."""
    tables, steps, step, state, time, rows, columns = Tables(), [], "", "1", None, None, []
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
        words, place = line.split(), f"{path}: line {number}"
        frame = re.match(r"\s*Frame:\s*Increment\s*(\d+):.*=\s*(\S+)\s*$", line)
        if line.strip().startswith("Step:"):
            step = line.split("Step:")[1].strip()
            steps += [step] if step not in steps else []
        elif frame:
            state, time, rows = f"{steps.index(step) + 1 if step else 1} substep {frame[1]}", float(frame[2]), None
        elif words[:1] == ["Node"] and len(words) > 1 and not any(re.fullmatch(r"[-+.\d]+", word) for word in words[1:]):
            columns = [name.rsplit(".", 1)[-1] for name in words[1:]]
            rows = tables.rows(state, time, columns)
        elif rows is not None and words and words[0][0].isdigit():
            take(rows, *numbers(line, columns, place), f"{place}, step {state}")
        elif words and words[0] in ("Minimum", "Maximum", "Total"):
            rows = None
    names = list(dict.fromkeys(name for _, all in tables.states.values() for columns in all for name in columns))
    if not names:
        raise Refused(f"{path}: expected a report of Unique Nodal values, found no line Node with the names of columns")
    with open(out, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["node", "step", "time", *names])
        for state, (_, all) in tables.states.items():
            for label in next(iter(all.values())):
                found = {name: v for columns, rows in all.items() for name, v in zip(columns, rows.get(label, []))}
                if len(found) == len(names):  # nodes without some value are left out: the state has no field there
                    writer.writerow([label, state, tables.time(state), *(repr(found[name]) for name in names)])
    return f"{len(tables.states)} states of {', '.join(names)}"
