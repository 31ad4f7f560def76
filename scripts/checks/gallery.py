"""gallery.py KEPT MADE: ends with 1 if a picture that was made again shows something else than the one in the gallery.

Bodies (PNG): the mean difference of their pixels. Charts (SVG): their words and about the number of their lines, because times and
noise differ from run to run. Another processor rounds otherwise, which is far below both bounds.
"""
import re
import sys
from pathlib import Path

from picture import Picture

# Of 255; a body that has moved by a hundredth of the picture differs by about 5.
MOST_PIXEL = 3.0
# Of the numbers in a chart's labels.
NUMBERS = re.compile(r"[-+]?\d+(\.\d+)?(e-?\d+)?")


def pixels(data):
    picture = Picture(data)
    return (picture.width, picture.height, picture.channels), b"".join(picture.rows)


def words(data):
    """Labels of a chart without their numbers and without repetitions."""
    found = re.findall(r"<text[^>]*>([^<]*)</text>", data.decode())
    return sorted({NUMBERS.sub("", text).strip() for text in found} - {""})


def main(kept, made):
    old, new = kept.read_bytes(), made.read_bytes()
    if kept.suffix == ".svg":
        if words(old) != words(new):
            return f"expected the words {words(old)}, found {words(new)}"
        lines = [data.count(b"<polyline") + data.count(b"<path") for data in (old, new)]
        return None if lines[1] > 0.5 * lines[0] else f"expected about {lines[0]} lines, found {lines[1]}"
    (old_size, old_pixels), (new_size, new_pixels) = pixels(old), pixels(new)
    if old_size != new_size:
        return f"expected {old_size} pixels, found {new_size}"
    differs = sum(abs(a - b) for a, b in zip(old_pixels, new_pixels)) / len(old_pixels)
    return None if differs <= MOST_PIXEL else f"expected the same picture, found one that differs by {differs:.1f} of 255"


if __name__ == "__main__":
    kept, made = map(Path, sys.argv[1:])
    wrong = main(kept, made)
    if wrong:
        sys.exit(f"{made}: {wrong}; look at both, then `scripts/gallery.sh {kept.parent.name}` puts the new one in place")
