"""gallery.py KEPT MADE: ends with 1 if a picture that was made again shows something else than the one in the gallery.
gallery.py --prove CHART...: ends with 1 if the comparison would not notice a curve of these charts that is higher by a tenth (calibration: a quarter),
a missing one, or another number on an axis.

Bodies (PNG): the mean difference of their pixels. Charts (SVG): every curve has to lie on the kept one, and every label has to stand
where it stood with the same words and numbers. Both matter: an axis that follows its curve hides a change that its labels show.
Another processor rounds otherwise, and a twin that runs in real time estimates a little differently each time.
"""
import math
import re
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

from picture import Picture

# Of 255; a body that has moved by a hundredth of the picture differs by about 5.
MOST_PIXEL = 3.0
# Of a chart's width or height, whichever is smaller, between a curve and the kept one. The check prints what it found: 0.00 % for charts of
# a computation. A twin on a busy machine leaves out other readings each time, which moved its estimate by up to 2.5 %.
MOST_SHIFT = 0.004
MOST_SHIFT_OF = {"calibration": 0.05}
# Of a number in a label, unless its last digit differs by one: that is rounding.
MOST_NUMBER = 0.01
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e-?\d+)?")
SVG = "{http://www.w3.org/2000/svg}"


def pixels(data):
    picture = Picture(data)
    return (picture.width, picture.height, picture.channels), b"".join(picture.rows)


def numbers(text):
    return [float(found.replace("−", "-")) for found in NUMBER.findall(text)]


class Chart:
    """Curves of an SVG as lists of points, and its labels with their places; `marks` are the dots of a scatter plot."""

    def __init__(self, data):
        root = xml.fromstring(data)
        _, _, width, height = numbers(root.get("viewBox"))
        self.size = min(width, height)
        self.curves, self.marks, self.labels = [], [], []
        self._add(root)

    def _add(self, element):
        for part in element:
            kind = part.tag.removeprefix(SVG)
            if kind in ("polyline", "polygon", "path"):
                flat = numbers(part.get("points") or part.get("d") or "")
                self.curves.append(list(zip(flat[::2], flat[1::2])))
            elif kind == "line":
                self.curves.append([(float(part.get(f"x{end}")), float(part.get(f"y{end}"))) for end in (1, 2)])
            elif kind == "circle":
                self.marks.append((float(part.get("cx")), float(part.get("cy"))))
            elif kind == "text" and "".join(part.itertext()).strip():
                moved = re.search(r"translate\(([^)]*)\)", part.get("transform", ""))
                place = numbers(moved[1]) if moved else [float(part.get("x", 0)), float(part.get("y", 0))]
                self.labels.append(("".join(part.itertext()).strip(), tuple(place)))
            elif kind != "defs":  # shapes of ticks and clips
                self._add(part)


def to_curve(point, curve):
    """Distance of a point from a curve."""
    x, y = point
    best = math.dist(point, curve[0])
    for (ax, ay), (bx, by) in zip(curve, curve[1:]):
        dx, dy = bx - ax, by - ay
        along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy or 1.0)
        along = min(max(along, 0.0), 1.0)
        best = min(best, math.hypot(ax + along * dx - x, ay + along * dy - y))
    return best


def apart(one, other):
    """Largest distance between two curves, in both directions: a curve that is a part of the other one is not the same."""
    if not one or not other:
        return 0.0 if one == other else math.inf
    return max(max(to_curve(point, other) for point in one), max(to_curve(point, one) for point in other))


def same_text(old, new):
    if NUMBER.fullmatch(old):  # of an axis: no result, so nothing is rounded
        return old == new
    if NUMBER.sub("#", old) != NUMBER.sub("#", new):
        return False
    for a, b in zip(NUMBER.findall(old), NUMBER.findall(new)):
        digit = 10.0 ** -min(len(text.partition("e")[0].partition(".")[2]) for text in (a, b)) if "e" not in a + b else 0.0
        (first,), (second,) = numbers(a), numbers(b)
        if abs(first - second) > max(1.001 * digit if "." in a + b else 0.0, MOST_NUMBER * abs(first)):
            return False
    return True


def compared(old, new, most_shift):
    """What differs, or None; and the largest distance of a curve, as a share of the chart."""
    worst = 0.0
    if (len(old.curves), len(old.marks)) != (len(new.curves), len(new.marks)):
        return f"expected {len(old.curves)} lines and {len(old.marks)} dots, found {len(new.curves)} and {len(new.marks)}", worst
    for number, (kept, made) in enumerate(zip(old.curves, new.curves), 1):
        shift = apart(kept, made) / old.size
        worst = max(worst, shift)
        if shift > most_shift:
            return f"expected line {number} where it was, found it off by {100 * shift:.1f} % of the chart", worst
    for kept, made in zip(old.marks, new.marks):
        shift = math.dist(kept, made) / old.size
        worst = max(worst, shift)
        if shift > most_shift:
            return f"expected a dot at {kept}, found it at {made}", worst
    if len(old.labels) != len(new.labels):
        return f"expected {len(old.labels)} labels, found {len(new.labels)}", worst
    for (kept, at), (made, there) in zip(old.labels, new.labels):
        if not same_text(kept, made):
            return f"expected the label {kept!r}, found {made!r}", worst
        if math.dist(at, there) > most_shift * old.size:
            return f"expected the label {kept!r} at {at}, found it at {there}", worst
    return None, worst


def most_shift(kept):
    return MOST_SHIFT_OF.get(kept.parent.name, MOST_SHIFT)


def prove(kept):
    """Compares a chart with changed ones of itself, each of which has to be refused. A chart that may move more is changed by more."""
    data = kept.read_bytes()
    chart, most = Chart(data), most_shift(kept)
    by = max(0.1, 5.0 * most)
    height = lambda curve: max(y for _, y in curve) - min(y for _, y in curve)
    drawn = [k for k, curve in enumerate(chart.curves) if len(curve) > 2 and height(curve) > 0.1 * chart.size]
    assert compared(chart, Chart(data), most)[0] is None, f"{kept}: expected a chart to be the same as itself"
    changes = []
    for k in drawn:
        changed, without = Chart(data), Chart(data)
        low = max(y for _, y in changed.curves[k])  # y points down
        changed.curves[k] = [(x, low + (1.0 + by) * (y - low)) for x, y in changed.curves[k]]
        del without.curves[k]
        changes += [(changed, f"curve {k + 1} higher by {100 * by:.0f} %"), (without, f"without curve {k + 1}")]
    for k, (text, place) in enumerate(chart.labels):
        if NUMBER.fullmatch(text) and numbers(text)[0]:
            changed = Chart(data)
            changed.labels[k] = (str(1.1 * numbers(text)[0]), place)
            changes.append((changed, f"label {text} a tenth larger"))
    assert changes, f"{kept}: found nothing to change"
    for changed, how in changes:
        assert compared(chart, changed, most)[0], f"{kept}: {how} passes"
    print(f"{kept}: {len(changes)} changes refused, {len(drawn)} curves")


def main(kept, made):
    old, new = kept.read_bytes(), made.read_bytes()
    if kept.suffix == ".svg":
        wrong, worst = compared(Chart(old), Chart(new), most_shift(kept))
        print(f"{made}: lines within {100 * worst:.2f} % of the chart")
        return wrong
    (old_size, old_pixels), (new_size, new_pixels) = pixels(old), pixels(new)
    if old_size != new_size:
        return f"expected {old_size} pixels, found {new_size}"
    differs = sum(abs(a - b) for a, b in zip(old_pixels, new_pixels)) / len(old_pixels)
    return None if differs <= MOST_PIXEL else f"expected the same picture, found one that differs by {differs:.1f} of 255"


if __name__ == "__main__":
    if sys.argv[1] == "--prove":
        for chart in map(Path, sys.argv[2:]):
            prove(chart)
        sys.exit()
    kept, made = map(Path, sys.argv[1:])
    wrong = main(kept, made)
    if wrong:
        sys.exit(f"{made}: {wrong}; look at both, then `scripts/gallery.sh {kept.parent.name}` puts the new one in place")
