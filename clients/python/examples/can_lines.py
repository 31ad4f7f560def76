"""Prints the values of frames on a CAN bus as lines, for a sensor of kind "lines" (`pip install python-can`):

    command = ["python3", "can_lines.py", "can0", "0x181", "<hH"]

Arguments: the interface, the frame's identifier, and its layout as a format of Python's `struct`.
"""

import struct
import sys


def line(layout: str, data: bytes) -> str:
    """The values of one frame."""
    return ";".join(repr(value) for value in struct.unpack_from(layout, data))


if __name__ == "__main__":
    import can

    interface, identifier, layout = sys.argv[1:4]
    frames = [{"can_id": int(identifier, 0), "can_mask": 0x1FFFFFFF}]
    with can.Bus(interface="socketcan", channel=interface, can_filters=frames) as bus:
        for message in bus:
            print(line(layout, bytes(message.data)), flush=True)
