"""What viewers get, read by their own packages: Foxglove's and rerun's, the MCAP reference, VTK."""

import asyncio
import base64
import importlib.util
import json
import pathlib
import struct
import subprocess
import sys
import time

import foxglove
import foxglove.channels
import foxglove.messages as reference
import numpy as np
import pytest
import softtwin
import websockets
from conftest import PATIENCE_S, PROGRAMS, REPOSITORY
from mcap.reader import make_reader
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap_protobuf.decoder import DecoderFactory
from vtkmodules.vtkCommonDataModel import vtkPolyData

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
RERUN = pathlib.Path(sys.executable).with_name("rerun")
TYPES = {"points": "PointCloud", "surface": "SceneUpdate", "frame": "FrameTransforms"}


def pool(data):
    made = DescriptorPool()
    waiting = list(FileDescriptorSet.FromString(data).file)
    while waiting:  # a file comes after those that it imports
        ready = [file for file in waiting if not set(file.dependency) & {other.name for other in waiting}]
        assert ready, "the files of the set import each other"
        [made.Add(file) for file in ready]
        waiting = [file for file in waiting if file not in ready]
    return made


def decoder(schema):
    return GetMessageClass(pool(schema.data).FindMessageTypeByName(schema.name)).FromString


def described(data, name):
    """Every field that a message can hold, with those of the messages in it."""

    def of(message):
        return [
            (
                field.name, field.number, field.type, field.is_repeated,
                of(field.message_type) if field.message_type else None,
                [(value.name, value.number) for value in field.enum_type.values] if field.enum_type else None,
            )
            for field in message.fields
        ]

    return of(pool(data).FindMessageTypeByName(name))


@pytest.fixture
def scene(stage):
    """The finger of the other tests, standing aside."""
    path = stage.finger(rate_hz=50.0)  # recorded whole fields of an everyday build take 10 ms each
    path.write_text(path.read_text().replace('queries = "fields"', 'queries = "fields"\n            place = { offset_mm = [0.0, 100.0, 5.0] }'))
    stage.twin(path)
    stage.bridge(path)
    return path


@pytest.fixture
def recording(stage, scene, tmp_path):
    path = tmp_path / "run.mcap"
    command = [PROGRAMS / "softtwin", "record", "softtwin/finger/field", "softtwin/finger/state", "--viewer", "--scene", scene]
    done = subprocess.run(
        [*command, "--frames", "20", "--fields", "--seconds", "1.5", "--out", path, "--json"],
        env=stage.environment(), capture_output=True, text=True, timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["dropped"] == 0
    return path


def test_the_recording_is_what_foxglove_expects(recording):
    found, fields = {}, {}
    with open(recording, "rb") as file:
        for schema, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=[f"viewer/finger/all/{what}" for what in TYPES] + ["viewer/finger/numbers"]
        ):
            found.setdefault(channel.topic, []).append((message, decoded))
            if channel.topic != "viewer/finger/numbers":
                name = TYPES[channel.topic.rsplit("/", 1)[1]]
                assert (schema.name, schema.encoding, channel.message_encoding) == (f"foxglove.{name}", "protobuf", "protobuf")
                theirs = getattr(reference, name).get_schema()
                assert described(schema.data, schema.name) == described(theirs.data, theirs.name)
                again = decoder(theirs)(message.data)
                assert again.SerializeToString() == message.data, "their schema reads and writes the recorded bytes"
    with open(recording, "rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["softtwin/finger/field"]):
            fields[message.publish_time] = json.loads(message.data)

    pictures = [message.publish_time for message, _ in found["viewer/finger/all/points"]]
    # The twin may go on for a while after 1.5 s: what must hold is the rate.
    assert 10 <= len(pictures) < len(fields)
    assert (len(pictures) - 1) * 50_000_000 <= pictures[-1] - pictures[0], "20 a second, not the twin's 50"
    model = softtwin.Model(MODEL)
    for message, cloud in found["viewer/finger/all/points"]:
        said = fields[message.publish_time]
        columns = np.frombuffer(base64.b64decode(said["values"]), "<f4").reshape(5, -1)
        kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("displacement_mm", "<f4"), ("von_mises_mpa", "<f4"), ("rgba", "u1", 4)])
        assert cloud.point_stride == kind.itemsize and cloud.frame_id == "finger"
        assert [field.name for field in cloud.fields] == [*list(kind.names)[:5], "red", "green", "blue", "alpha"]
        points = np.frombuffer(cloud.data, kind)
        for axis, column in zip("xyz", columns):
            np.testing.assert_allclose(points[axis], column * 1e-3, rtol=1e-6)
        np.testing.assert_array_equal(points["von_mises_mpa"], columns[4])
        assert (points["rgba"][:, 3] == 255).all() and len(np.unique(points["rgba"], axis=0)) > 50
        stamp = cloud.timestamp.seconds * 1_000_000_000 + cloud.timestamp.nanos
        assert stamp == message.publish_time

    for (_, update), (_, cloud) in zip(found["viewer/finger/all/surface"], found["viewer/finger/all/points"]):
        (entity,) = update.entities
        (body,) = entity.triangles
        corners = np.array(body.indices).reshape(-1, 3)
        assert len(body.points) == len(body.colors) > 5000 and corners.max() < len(body.points) and entity.id == "finger"
        points = np.array([(p.x, p.y, p.z) for p in body.points])
        a, b, c = (points[corners[:, k]] for k in range(3))
        assert np.einsum("ij,ij", a, np.cross(b, c)) > 0, "facets look outwards"
    assert len(model.triangles) >= len(corners)
    (transform,) = found["viewer/finger/all/frame"][0][1].transforms
    assert (transform.parent_frame_id, transform.child_frame_id) == ("scene", "finger")
    assert (transform.translation.y, transform.translation.z, transform.rotation.w) == (0.1, 0.005, 1.0)
    with open(recording, "rb") as file:
        states = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages(topics=["softtwin/finger/state"])]
    numbers = [decoded for _, decoded in found["viewer/finger/numbers"]]
    assert [n.contact_force_n for n in numbers] == [s["contact_force_n"] for s in states] and len(numbers) > 40
    arrows = [update.entities[0].arrows for _, update in found["viewer/finger/all/surface"]]
    forces = [fields[message.publish_time]["contact_force_n"] for message, _ in found["viewer/finger/all/surface"]]
    assert [len(arrow) for arrow in arrows] == [int(force > 0) for force in forces]


def test_rerun_loads_the_recording(recording, tmp_path):
    """rerun's loader of MCAP files makes points and transforms of the messages by itself."""
    out = tmp_path / "run.rrd"
    done = subprocess.run(
        [RERUN, "mcap", "convert", str(recording), "-o", str(out)], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    said = subprocess.run([RERUN, "rrd", "print", "-v", str(out)], capture_output=True, text=True, timeout=PATIENCE_S).stdout
    for column in ("points@Points3D:positions", "points@Points3D:colors", "frame@Transform3D:translation"):
        assert f"/viewer/finger/all/{column}" in said, (column, said[:3000])
    assert "/viewer/finger/numbers@softtwin.Numbers:message" in said


async def watch(address, count, waiting=lambda: None):
    """What a client of the app's protocol gets: greeting, channels by topic, the first messages of `count` topics with their time."""
    hello, channels, got = None, {}, {}
    async with websockets.connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        assert socket.subprotocol == "foxglove.sdk.v1"
        wanted = []
        while len(got) < count:
            waiting()
            try:
                message = await asyncio.wait_for(socket.recv(), 0.1)
            except asyncio.TimeoutError:
                continue
            if not isinstance(message, str):
                operation, number, time_ns = struct.unpack_from("<BIQ", message)
                assert operation == 1
                got[wanted[number]] = (time_ns, message[13:])
                continue
            said = json.loads(message)
            if said["op"] == "serverInfo":
                hello = said
            for channel in said["channels"] if said["op"] == "advertise" else []:
                channels[channel["topic"]] = channel
                wanted.append(channel["topic"])
                subscription = {"id": len(wanted) - 1, "channelId": channel["id"]}
                await socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
    return hello, channels, got


@pytest.fixture
def foxglove_server(stage, scene):
    """`softtwin foxglove` on a free port, and its address."""
    log = open(stage.folder / "foxglove.log", "w+")
    server = subprocess.Popen(
        [PROGRAMS / "softtwin", "foxglove", "--scene", scene, "--port", "0"], stdout=log, stderr=subprocess.STDOUT, env=stage.environment()
    )
    stage.programs.append(server)
    while "ws://" not in (said := (stage.folder / "foxglove.log").read_text()):
        assert server.poll() is None, said
        time.sleep(0.02)
    yield said[said.index("ws://") :].split()[0]
    stage.stop(server)
    assert server.returncode == 0


def test_foxglove_live(foxglove_server):
    """The protocol as the app speaks it: it subscribes and gets binary messages."""
    _, channels, got = asyncio.run(asyncio.wait_for(watch(foxglove_server, 6), PATIENCE_S))
    assert channels["viewer/finger/all/points"]["schemaName"] == "foxglove.PointCloud" and set(channels) == set(got)
    assert len(got["viewer/finger/all/points"][1]) > 25022 * 24


def test_foxglove_live_is_what_its_own_server_says(foxglove_server):
    """Beside the server of Foxglove's package: one client reads both, and both describe the same message in the same words."""
    hello, channels, got = asyncio.run(asyncio.wait_for(watch(foxglove_server, 6), PATIENCE_S))
    reference_server = foxglove.start_server(name="reference", host="127.0.0.1", port=0)
    points = foxglove.channels.PointCloudChannel("points")
    log = lambda: points.log(reference.PointCloud(frame_id="scene"), log_time=123)
    address = f"ws://127.0.0.1:{reference_server.port}"
    its_hello, its_channels, its_messages = asyncio.run(asyncio.wait_for(watch(address, 1, log), PATIENCE_S))
    reference_server.stop()
    for key in ("op", "name", "capabilities", "metadata"):
        assert type(hello[key]) is type(its_hello[key]), key
    ours, its = channels["viewer/finger/all/points"], its_channels["points"]
    assert set(ours) == set(its)
    for key in ("encoding", "schemaName", "schemaEncoding"):
        assert ours[key] == its[key], key
    of = lambda channel: described(base64.b64decode(channel["schema"]), channel["schemaName"])
    assert of(ours) == of(its)
    assert its_messages["points"][0] == 123
    wall_ns = time.time_ns()
    assert abs(got["viewer/finger/all/points"][0] - wall_ns) < PATIENCE_S * 1e9


def test_a_port_in_use_is_named(stage):
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run(
            [PROGRAMS / "softtwin", "foxglove", "--port", str(port)], env=stage.environment(), capture_output=True, text=True, timeout=PATIENCE_S
        )
    assert done.returncode == 1 and f"cannot listen on 127.0.0.1 port {port}" in done.stderr


def test_the_source_for_paraview_fills_vtk_s_data(live):
    """Without ParaView: its programmable source hands over the same kind of object."""
    from softtwin.paraview import show

    output = vtkPolyData()
    show(output, "softtwin/finger/field", MODEL, bus=live.bus)
    model = softtwin.Model(MODEL)
    assert output.GetNumberOfPoints() == 25022 and output.GetNumberOfCells() == len(model.triangles)
    assert output.GetPointData().GetScalars().GetName() == "von_mises"
    low, high = output.GetPointData().GetArray("displacement").GetRange()
    assert 0.0 <= low < high
    cell = output.GetCell(17)
    assert [cell.GetPointId(k) for k in range(3)] == model.triangles[17].tolist()
    with pytest.raises(ValueError, match="do not hold the model's surface|has no node set"):
        show(output, "softtwin/finger/field/tip", MODEL, bus=live.bus)


def test_the_colour_scale_for_paraview_spans_all_states(tmp_path):
    spec = importlib.util.spec_from_file_location("open_series", REPOSITORY / "clients/paraview/open_series.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    series = tmp_path / "sweep.pvd"
    command = [PROGRAMS / "softtwin", "export", MODEL, "--pressure-mpa", "0.02,0.06,0.04", "--gap-mm", "30", "--out", series]
    assert subprocess.run(command, capture_output=True).returncode == 0
    low, high = script.colour_range(series, "von_mises [MPa]")
    stress = softtwin.Model(MODEL).predict([0.02, 0.06, 0.04], 30.0).von_mises
    assert (np.float32(low), np.float32(high)) == (stress.min(), stress.max())
    with pytest.raises(SystemExit, match="expected the point array 'heat', found"):
        script.colour_range(series, "heat")
