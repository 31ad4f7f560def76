"""The example programs that print a sensor's values as lines."""

import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import can_lines
import iio_lines


def test_iio_channels_are_read_in_millivolt(tmp_path: Path) -> None:
    device = tmp_path / "iio:device3"
    device.mkdir()
    for file, text in [
        ("name", "ads1115\n"),
        ("in_voltage0_raw", "2004\n"),
        ("in_voltage0_scale", "0.125\n"),
        ("in_voltage_offset", "-4\n"),
        ("in_voltage1_raw", "8\n"),
        ("in_voltage1_scale", "2\n"),
    ]:
        (device / file).write_text(text)
    found = iio_lines.folder("ads1115", tmp_path)
    assert found == device and iio_lines.folder("iio:device3", tmp_path) == device
    assert iio_lines.line(found, ["voltage0", "voltage1"]) == "250.0;8.0"


def test_frame_is_decoded_with_the_layout() -> None:
    assert can_lines.line("<hH", struct.pack("<hH", -5, 65535) + b"\0\0") == "-5;65535"
    assert can_lines.line(">f", struct.pack(">f", 0.5)) == "0.5"
