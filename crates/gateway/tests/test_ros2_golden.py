"""The bytes of tests/golden are those that `rosbags` writes; the unit tests compare them with what the gateway writes and reads.
`BLESS=1` rewrites them."""

import os
import pathlib
import re

import numpy as np
import pytest
from ros2_types import PACKAGE, STORE, make

GOLDEN = pathlib.Path(__file__).parent / "golden"


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
        texture=make("sensor_msgs/msg/CompressedImage", header=header(""), format="", data=np.zeros(0, "uint8")),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, "uint8")),
        mesh_use_embedded_materials=False,
    )


OWN = "softtwin_interfaces/srv/"
NO_PARAMETERS = dict(parameter_names=[], parameters=np.zeros(0), node_set="")


def answer(**given):
    """NaN for absent quantities."""
    numbers = "pressure_mpa gap_mm domain_distance contact_force_n force_halfwidth_n onset_pressure_mpa displacement_halfwidth_mm"
    numbers += " von_mises_halfwidth_mpa found_halfwidth found_low found_high max_von_mises_mpa"
    empty = dict(
        {name: float("nan") for name in numbers.split()},
        **dict(input_names=[], inputs=np.zeros(0), regime="unknown", domain_status=0, force_by_input=np.zeros(0)),
        **dict(field_names=[], node_count=0, field=np.zeros(0, "float32"), max_von_mises_node=2**32 - 1, flags=[], model_hash="00" * 16),
    )
    return make("softtwin_interfaces/msg/Answer", **{**empty, **given})


def answered():
    """Numbers that f32 holds, so that those of f32 and of f64 are the same."""
    found = answer(
        pressure_mpa=0.05,
        gap_mm=30.0,
        input_names=["pressure_mpa", "gap_mm", "elastomer.law.mu_mpa"],
        inputs=np.array([0.05, 30.0, 0.8]),
        regime="contact",
        domain_status=2,
        domain_distance=0.25,
        contact_force_n=0.3,
        force_halfwidth_n=0.5,
        force_by_input=np.array([10.0, -0.02, 0.1]),
        onset_pressure_mpa=float("inf"),
        displacement_halfwidth_mm=0.125,
        von_mises_halfwidth_mpa=0.0625,
        found_halfwidth=0.001,
        found_low=0.049,
        found_high=0.051,
        field_names=["x", "von_mises"],
        node_count=3,
        field=np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3], "float32"),
        max_von_mises_mpa=0.3,
        max_von_mises_node=17,
        flags=["outside-domain"],
        model_hash=bytes(range(16)).hex(),
    )
    return make(OWN + "WhatIf_Response", success=True, message="", answer=found)


MESSAGES = {
    "marker": ("visualization_msgs/msg/Marker", marker),
    "described": ("std_srvs/srv/Trigger_Response", lambda: make("std_srvs/srv/Trigger_Response", success=True, message="{}")),
    "what_if_request": (
        OWN + "WhatIf_Request",
        lambda: make(
            OWN + "WhatIf_Request",
            pressure_mpa=0.05,
            gap_mm=30.0,
            parameter_names=["a", "elastomer.law.mu_mpa"],
            parameters=np.array([1.5, 0.8]),
            node_set="tip",
        ),
    ),
    "find_pressure_request": (
        OWN + "FindPressure_Request",
        lambda: make(OWN + "FindPressure_Request", force_n=0.3, gap_mm=30.0, **NO_PARAMETERS),
    ),
    "find_gap_request": (
        OWN + "FindGap_Request",
        lambda: make(OWN + "FindGap_Request", pressure_mpa=0.06, force_n=0.3, force_halfwidth_n=0.01, **NO_PARAMETERS),
    ),
    "answered": (OWN + "WhatIf_Response", answered),
    "not_answered": (
        OWN + "FindGap_Response",
        lambda: make(OWN + "FindGap_Response", success=False, message="no twin", answer=answer()),
    ),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_golden_bytes_are_those_of_rosbags(name):
    kind, message = MESSAGES[name]
    path = GOLDEN / f"{name}.hex"
    found = bytes(STORE.serialize_cdr(message(), kind))
    if os.environ.get("BLESS"):
        text = found.hex()
        path.write_text("".join(text[at : at + 128] + "\n" for at in range(0, len(text), 128)))
    assert bytes.fromhex(path.read_text()) == found


def test_the_package_builds_every_definition():
    listed = re.findall(r'"(\w+/\w+\.\w+)"', (PACKAGE / "CMakeLists.txt").read_text())
    assert sorted(listed) == sorted(str(path.relative_to(PACKAGE)) for path in PACKAGE.glob("*/*"))
