"""Writes `data` from the folders that the recordings were published in (README.md names them and their licences).

    python benchmarks/prepare.py SOURCE

SOURCE holds the published files under the names below. Columns that no task uses are left out, units become those of the heading, long
recordings keep every n-th row; nothing else is changed.
"""

import csv
import gzip
import math
import sys
from pathlib import Path

DATA = Path(__file__).parent / "data"
MPA_PER_PSI = 0.00689476

# Columns of the arm, counted from 1: measured pressures of both segments, position of the tip. A wanted pressure would be another input.
ARM = [(1, "time_s", 1.0)]
ARM += [(c, f"segment{1 + (c > 7)}_{'abc'[(c - 5) % 6]}_mpa", MPA_PER_PSI) for c in (5, 6, 7, 11, 12, 13)]
ARM += [(32, "tip_x_mm", 1e3), (33, "tip_y_mm", 1e3), (34, "tip_z_mm", 1e3)]
CYLINDER = [(1, "time_s", 1e-3), (5, "stroke_mm", 1.0), (6, "pressure_mpa", 0.1), (7, "force_n", 1.0)]
MEMBRANE = [(1, "pressure_mpa", 1e-6), (2, "load_n", 1.0), (3, "height_mm", 1.0)]
FINGERTIP = [(1, "place_mm", 1.0), (2, "left_mpa", 1e-3), (3, "right_mpa", 1e-3), (4, "force_n", 1.0)]
BLOCK = [(1, "pressure_mpa", 1.0), (2, "angle_deg", 1.0)]

# Name here, published file, columns, every n-th row.
FILES = [
    ("arm_10-2_1", "asu_Jan10-2_1.txt", ARM, 1),
    ("arm_10-2_2", "asu_Jan10-2_2.txt", ARM, 1),
    ("arm_10-3_1", "arm_10-3_1.txt", ARM, 1),
    ("arm_10-3_2", "arm_10-3_2.txt", ARM, 1),
    ("arm_23-1_1", "asu_Jan23-1_1.txt", ARM, 1),
    ("arm_23-1_2", "asu_Jan23-1_2.txt", ARM, 1),
    ("cylinder_1", "rerun1_3bar.csv", CYLINDER, 4),
    ("cylinder_2", "rerun2_3bar.csv", CYLINDER, 4),
    *[(f"membrane_{n}", f"spa_{n}.csv", MEMBRANE, 1) for n in range(1, 7)],
    *[(f"fingertip_{fluid}_{half}", f"tact_{fluid}_{half}.csv", FINGERTIP, 1) for fluid in ("air", "water") for half in "ab"],
    ("block", "c5_w7_angle.csv", BLOCK, 1),
]


def rows(path: Path):
    """Rows of numbers; headings and comments are passed over."""
    text = gzip.open(path, "rt").read() if path.suffix == ".gz" else path.read_text()
    delimiter = "\t" if "\t" in text.splitlines()[-1] else ","
    for row in csv.reader(text.splitlines(), delimiter=delimiter):
        try:
            yield [float(cell) for cell in row if cell.strip()]
        except ValueError:
            continue


def find(source: Path, name: str) -> Path:
    found = sorted(path for path in source.rglob("*") if path.name in (name, name + ".gz"))
    if not found:
        sys.exit(f"{name}: expected in {source} or a folder in it, found none")
    return found[0]


def main(source: Path):
    DATA.mkdir(exist_ok=True)
    for name, published, columns, step in FILES:
        with open(DATA / f"{name}.csv", "w", newline="") as out:
            table = csv.writer(out, lineterminator="\n")
            table.writerow([heading for _, heading, _ in columns])
            last = -math.inf
            for number, row in enumerate(rows(find(source, published))):
                values = [row[column - 1] * factor for column, _, factor in columns]
                if columns[0][1] == "time_s":
                    if values[0] <= last:  # the logger of the arm wrote some instants twice
                        continue
                    last = values[0]
                if number % step == 0:
                    table.writerow([f"{value:.6g}" for value in values])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
