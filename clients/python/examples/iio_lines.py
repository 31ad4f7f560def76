"""Prints channels of a Linux IIO converter as lines of mV, for a sensor of kind "lines":

    command = ["python3", "iio_lines.py", "ads1115", "voltage0,voltage1", "100"]

Arguments: the device (its folder in /sys/bus/iio/devices, or the content of its file `name`), channels, readings per second.
"""

import sys
import time
from pathlib import Path
from typing import List

ROOT = Path("/sys/bus/iio/devices")


def folder(device: str, root: Path = ROOT) -> Path:
    """The device's folder, by the folder's name or by the device's name, which is independent of the order of plugging in."""
    if (root / device).is_dir():
        return root / device
    found = [path for path in root.iterdir() if (path / "name").read_text().strip() == device]
    if len(found) != 1:
        raise SystemExit(f"{root}: expected one device called {device}, found {len(found)}")
    return found[0]


def millivolt(device: Path, channel: str) -> float:
    """(raw + offset) x scale; scale and offset of the channel, of its kind, or 1 and 0."""
    kind = channel.rstrip("0123456789")

    def number(what: str, default: float) -> float:
        files = [device / f"in_{channel}_{what}", device / f"in_{kind}_{what}"]
        found = [path for path in files if path.exists()]
        return float(found[0].read_text()) if found else default

    raw = float((device / f"in_{channel}_raw").read_text())
    return (raw + number("offset", 0.0)) * number("scale", 1.0)


def line(device: Path, channels: List[str]) -> str:
    """One reading."""
    return ";".join(repr(millivolt(device, channel)) for channel in channels)


if __name__ == "__main__":
    name, names, rate_hz = sys.argv[1:4]
    while True:  # an error ends the program; the bridge starts it again
        print(line(folder(name), names.split(",")), flush=True)
        time.sleep(1.0 / float(rate_hz))
