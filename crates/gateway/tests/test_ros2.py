"""The gateway as a node of ROS 2 over rmw_zenoh, seen by a peer in another process that knows nothing of us: keys and tokens by a plain
Zenoh client, messages and hashes by `rosbags`. No ROS 2 runs here."""

import queue
import struct
import time

import numpy as np
import pytest
import zenoh
from ros2_types import STORE, key
from test_plain_client import PATIENCE_S, REPOSITORY, Stage

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
TOPICS = {
    "softtwin/finger/wrench": "geometry_msgs/msg/WrenchStamped",
    "softtwin/finger/pressure": "sensor_msgs/msg/FluidPressure",
    "softtwin/finger/inputs": "sensor_msgs/msg/JointState",
    "softtwin/finger/observables": "sensor_msgs/msg/JointState",
    "softtwin/finger/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "softtwin/finger/all/points": "sensor_msgs/msg/PointCloud2",
    "softtwin/finger/surface/points": "sensor_msgs/msg/PointCloud2",
    "softtwin/finger/all/marker": "visualization_msgs/msg/Marker",
    "softtwin/finger/surface/marker": "visualization_msgs/msg/Marker",
}
WITHOUT_MODEL = '[ros2]\ndomain_id = 7\nnode = "twins"\n'
SETTINGS = WITHOUT_MODEL + f'models = ["{MODEL}"]\nmarker_full_scale_mpa = 0.2\n'


@pytest.fixture
def stage(tmp_path):
    made = Stage(tmp_path)
    yield made
    made.close()


def subscribe(session, name):
    got = queue.Queue()
    return session.declare_subscriber(name, got.put), got


def test_node_and_topics_stand_in_the_graph(stage):
    stage.live(200.0, SETTINGS)
    with stage.session("client") as session:
        zid = str(list(session.info.routers_zid() + session.info.peers_zid())[0])
        end = time.monotonic() + PATIENCE_S
        while True:
            found = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**")]
            tokens = [token for token in found if "/SS/" not in token]
            if len(tokens) == 1 + len(TOPICS) or time.monotonic() > end:
                break
            time.sleep(0.05)
        parts = sorted(token.split("/") for token in tokens)
        assert [part for part in parts if part[5] == "NN"] == [["@ros2_lv", "7", zid, "0", "0", "NN", "%", "%", "twins"]]
        publishers = [part for part in parts if part[5] == "MP"]
        assert len({part[4] for part in publishers}) == len(TOPICS), "each entity has its own number"
        for topic, kind in TOPICS.items():
            (found,) = [part for part in publishers if part[9] == "%" + topic.replace("/", "%")]
            assert found[:4] == ["@ros2_lv", "7", zid, "0"] and found[6:9] == ["%", "%", "twins"]
            assert found[10:12] == key(topic, kind).rsplit("/", 2)[1:] and found[12] == "::,10:,:,:,,"


def test_messages_are_those_of_ros(stage):
    stage.live(200.0, SETTINGS)
    with stage.session("client") as session:
        readers = {topic: subscribe(session, key(topic, kind)) for topic, kind in TOPICS.items()}
        got = {topic: reader[1].get(timeout=PATIENCE_S) for topic, reader in readers.items()}
        following = readers["softtwin/finger/wrench"][1].get(timeout=PATIENCE_S)
        found = {}
        for topic, kind in TOPICS.items():
            raw = bytes(got[topic].payload)
            found[topic] = STORE.deserialize_cdr(raw, kind)
            assert bytes(STORE.serialize_cdr(found[topic], kind)) == raw, f"{kind}: rosbags writes the same bytes"
        for message in found.values():
            stamp = message.header.stamp
            assert abs(stamp.sec + 1e-9 * stamp.nanosec - time.time()) < PATIENCE_S
        assert found["softtwin/finger/wrench"].header.frame_id == "finger_contact"
        wrench = found["softtwin/finger/wrench"].wrench
        assert wrench.force.y >= 0.0 and (wrench.force.x, wrench.torque.z) == (0.0, 0.0)
        assert 0.0 <= found["softtwin/finger/pressure"].fluid_pressure <= 90_000.0
        inputs = found["softtwin/finger/inputs"]
        inputs = dict(zip(inputs.name, inputs.position))
        assert list(inputs) == ["pressure_mpa", "gap_mm"] and 0.0 <= inputs["pressure_mpa"] <= 90_000.0 and inputs["gap_mm"] < 1.0, "SI units"
        joints = found["softtwin/finger/observables"]
        angles = dict(zip(joints.name, joints.position))
        assert list(angles) == ["bending_angle_deg", "chord_angle_deg", "tip_x_mm", "tip_y_mm"] and len(joints.effort) == 4
        assert 0.0 <= angles["chord_angle_deg"] <= angles["bending_angle_deg"] < 3.2 and 0.0 < angles["tip_x_mm"] < 0.12, "SI units"
        (status,) = found["softtwin/finger/diagnostics"].status
        values = {pair.key: pair.value for pair in status.values}
        assert status.hardware_id == "finger" and float(values["rate_hz"]) > 10.0
        cloud = found["softtwin/finger/all/points"]
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "displacement_mm", "von_mises_mpa"]
        assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 25022, 20, 500_440)
        points = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 5)
        assert 0.10 < np.abs(points[:, :3]).max() < 0.2 and points[:, 4].max() > 0.0, "metres"
        for sample, number in ((got["softtwin/finger/wrench"], None), (following, 1)):
            attachment = bytes(sample.attachment)
            seq, stamp, length = struct.unpack_from("<qqB", attachment)
            assert len(attachment) == 33 and length == 16 and abs(stamp * 1e-9 - time.time()) < PATIENCE_S
            assert number is None or seq == first + number
            first = seq


def array(of, *fields):
    return np.array([[getattr(one, field) for field in fields] for one in of])


def test_the_surface_is_a_list_of_triangles(stage):
    stage.live(5.0, SETTINGS)
    kind = "visualization_msgs/msg/Marker"
    with stage.session("client") as session:
        # The same field as points and, with the same stamp, as triangles.
        points_kind = "sensor_msgs/msg/PointCloud2"
        markers = subscribe(session, key("softtwin/finger/surface/marker", kind))
        clouds = subscribe(session, key("softtwin/finger/surface/points", points_kind))
        seen = {}
        end = time.monotonic() + PATIENCE_S
        while True:
            assert time.monotonic() < end, "no marker and points of one field"
            marker = STORE.deserialize_cdr(bytes(markers[1].get(timeout=PATIENCE_S).payload), kind)
            while not clouds[1].empty():
                cloud = STORE.deserialize_cdr(bytes(clouds[1].get().payload), points_kind)
                seen[cloud.header.stamp.sec, cloud.header.stamp.nanosec] = cloud
            cloud = seen.get((marker.header.stamp.sec, marker.header.stamp.nanosec))
            if cloud is not None:
                break
    assert marker.header.frame_id == "finger" and (marker.type, marker.action) == (11, 0)
    corners, colours = array(marker.points, "x", "y", "z"), array(marker.colors, "r", "g", "b", "a")
    assert len(corners) == len(colours) and len(corners) % 3 == 0 and len(corners) > 3 * 10_000
    nodes = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 5)
    stress = {tuple(node): value for node, value in zip(nodes[:, :3], nodes[:, 4])}
    rounded = [tuple(corner) for corner in (corners * 1e3).astype("<f4") * np.float32(1e-3)]  # as the points are
    found = np.array([stress[corner] for corner in rounded])
    assert len(set(rounded)) == len(stress), "every node of the surface is a corner"
    # A closed surface: its triangles' normals, weighted by their areas, cancel.
    sides = corners.reshape(-1, 3, 3)
    areas = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    assert np.abs(areas.sum(axis=0)).max() < 1e-4 * np.linalg.norm(areas, axis=1).sum()
    share = np.clip(found / 0.2, 0.0, 1.0)[:, None]
    low, middle, high = np.array([0.2, 0.1, 0.5]), np.array([0.1, 0.6, 0.6]), np.array([1.0, 0.9, 0.2])
    expected = np.where(share < 0.5, low + (middle - low) * 2 * share, middle + (high - middle) * (2 * share - 1))
    beyond = found > 0.2
    assert np.abs(colours[~beyond, :3] - expected[~beyond]).max() < 1e-5
    assert np.abs(colours[beyond, :3] - [0.9, 0.1, 0.1]).max(initial=0.0) < 1e-6
    assert (colours[:, 3] == 1.0).all() and found.max() > 0.01


def test_without_the_model_there_is_no_marker(stage):
    stage.live(200.0, WITHOUT_MODEL)
    with stage.session("client") as session:
        reader, got = subscribe(session, key("softtwin/finger/surface/points", "sensor_msgs/msg/PointCloud2"))
        got.get(timeout=PATIENCE_S)
        tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**")]
        assert any("%surface%points" in token for token in tokens) and not any("marker" in token for token in tokens)
        reader.undeclare()


def test_a_twin_of_another_model_has_no_marker_and_the_log_says_so(stage):
    other = REPOSITORY / "models/pneunet-design/pneunet-design.twin"
    stage.live(200.0, WITHOUT_MODEL + f'models = ["{other}"]\n')
    with stage.session("client") as session:
        marker, markers = subscribe(session, key("softtwin/finger/all/marker", "visualization_msgs/msg/Marker"))
        cloud, clouds = subscribe(session, key("softtwin/finger/all/points", "sensor_msgs/msg/PointCloud2"))
        stage.wait_said("finger: no marker: ros2.models has no file of its model")
        clouds.get(timeout=PATIENCE_S)
        assert markers.empty()
        marker.undeclare()
        cloud.undeclare()


def test_a_model_that_cannot_be_read_is_refused(stage):
    settings = '[ros2]\nmodels = ["nothing.twin"]\nmarker_full_scale_mpa = 0.0\n'
    ended = stage.run("softtwin-gateway", "--config", stage.write("wrong.toml", settings), "--check")
    assert ended.returncode == 78
    for said in ("ros2.models: ", "nothing.twin", "ros2.marker_full_scale_mpa: expected more than 0 MPa, found 0"):
        assert said in ended.stderr


def test_a_pressure_from_ros_reaches_the_twin(stage):
    scene = stage.write("scene.toml", f'name = "ros"\n[[actuator]]\nname = "finger"\nmodel = "{MODEL}"\ngap_mm = 30.0\n')
    stage.start("softtwind", "twin", "--scene", scene)
    listen = f'listen = ["tcp/127.0.0.1:{stage.port}"]\nreadings_from_network = ["finger"]\n'
    stage.start("softtwin-gateway", "--config", stage.write("gateway.toml", listen + SETTINGS))
    kind = "sensor_msgs/msg/FluidPressure"
    make = STORE.types
    with stage.session("client") as session:
        reader, got = subscribe(session, key("softtwin/finger/pressure", kind))
        end = time.monotonic() + PATIENCE_S
        number = 0

        def send(pressure_pa, name):
            nonlocal number
            number += 1
            now = time.time_ns()
            stamp = make["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
            header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="gauge")
            message = make[kind](header=header, fluid_pressure=pressure_pa, variance=0.0)
            attachment = struct.pack("<qqB", number, now, 16) + bytes(range(16))
            session.put(name, bytes(STORE.serialize_cdr(message, kind)), attachment=attachment)

        while time.monotonic() < end:
            send(41_000.0, key("softtwin/finger/pressure_measured", kind))
            try:
                found = STORE.deserialize_cdr(bytes(got.get(timeout=0.05).payload), kind).fluid_pressure
            except queue.Empty:
                continue
            if abs(found - 41_000.0) < 1e-6:
                break
        else:
            pytest.fail("the pressure did not come back as the twin's")
        other = key("softtwin/finger/pressure_measured", kind).rsplit("/", 1)[0] + "/RIHS01_" + "0" * 64
        send(41_000.0, other)
        stage.wait_said("expected type hash RIHS01_22dfb2b1")
        reader.undeclare()
