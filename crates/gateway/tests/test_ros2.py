"""The gateway as a node of ROS 2 over rmw_zenoh, seen by a peer in another process that knows nothing of us: keys and tokens by a plain
Zenoh client, messages and hashes by `rosbags`. No ROS 2 runs here."""

import queue
import struct
import time

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from test_plain_client import PATIENCE_S, REPOSITORY, Stage

STORE = get_typestore(Stores.ROS2_JAZZY)
TOPICS = {
    "softtwin/finger/wrench": "geometry_msgs/msg/WrenchStamped",
    "softtwin/finger/pressure": "sensor_msgs/msg/FluidPressure",
    "softtwin/finger/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "softtwin/finger/all/points": "sensor_msgs/msg/PointCloud2",
    "softtwin/finger/surface/points": "sensor_msgs/msg/PointCloud2",
}
SETTINGS = '[ros2]\ndomain_id = 7\nnode = "twins"'


def key(topic, kind, domain=7):
    package, _, name = kind.split("/")
    return f"{domain}/{topic}/{package}::msg::dds_::{name}_/{STORE.hash_rihs01(kind)}"


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
            tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**")]
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


def test_a_pressure_from_ros_reaches_the_twin(stage):
    model = REPOSITORY / "models/pneunet/pneunet.twin"
    scene = stage.write("scene.toml", f'name = "ros"\n[[actuator]]\nname = "finger"\nmodel = "{model}"\ngap_mm = 30.0\n')
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
