"""The bytes of tests/golden are those that `rosbags` writes; the unit tests compare them with what the gateway writes and reads.
`BLESS=1` in front of the command writes them anew."""

import os
import pathlib

import numpy as np
import pytest
from ros2_types import STORE, make

GOLDEN = pathlib.Path(__file__).parent / "golden"
EMPTY = {kind: np.zeros(0, kind) for kind in ("uint8", "int64", "float64", "bool")}


def header(frame, sec=0, nanosec=0):
    return make("std_msgs/msg/Header", stamp=make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec), frame_id=frame)


def marker():
    """Two triangles over four nodes; stress 0, 0.25, 0.5 and 1 MPa at a full scale of 0.5 MPa."""
    place = [(0.0, 0.0, 0.0), (0.001, 0.0, 0.0), (0.0, 0.002, 0.0), (0.0, 0.0, -0.004)]
    colours = [(0.2, 0.1, 0.5, 1.0), (0.1, 0.6, 0.6, 1.0), (1.0, 0.9, 0.2, 1.0), (0.9, 0.1, 0.1, 1.0)]
    corners = [0, 1, 2, 0, 3, 1]
    vector = lambda x, y, z: make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
    colour = lambda r, g, b, a: make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a)
    point = lambda x, y, z: make("geometry_msgs/msg/Point", x=x, y=y, z=z)
    turn = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    return make(
        "visualization_msgs/msg/Marker",
        header=header("finger", 12, 345),
        ns="finger",
        id=0,
        type=11,
        action=0,
        pose=make("geometry_msgs/msg/Pose", position=point(0.0, 0.0, 0.0), orientation=turn),
        scale=vector(1.0, 1.0, 1.0),
        color=colour(1.0, 1.0, 1.0, 1.0),
        lifetime=make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=True,
        points=[point(*place[corner]) for corner in corners],
        colors=[colour(*colours[corner]) for corner in corners],
        texture_resource="",
        texture=make("sensor_msgs/msg/CompressedImage", header=header(""), format="", data=EMPTY["uint8"]),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", filename="", data=EMPTY["uint8"]),
        mesh_use_embedded_materials=False,
    )


MESSAGES = {"marker": ("visualization_msgs/msg/Marker", marker)}


@pytest.mark.parametrize("name", MESSAGES)
def test_golden_bytes_are_those_of_rosbags(name):
    kind, message = MESSAGES[name]
    path = GOLDEN / f"{name}.hex"
    found = bytes(STORE.serialize_cdr(message(), kind))
    if os.environ.get("BLESS"):
        text = found.hex()
        path.write_text("".join(text[at : at + 128] + "\n" for at in range(0, len(text), 128)))
    assert bytes.fromhex(path.read_text()) == found
