"""Recordings as Foxglove and rerun draw them, and fields as VTK and ParaView read them, with the packages of those programs."""

import base64
import importlib.util
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
import softtwin
from conftest import PATIENCE_S, PROGRAMS, REPOSITORY
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from softtwin.convert import main
from vtkmodules.vtkCommonDataModel import vtkPolyData

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
RERUN = pathlib.Path(sys.executable).with_name("rerun")
TYPES = {"points": "PointCloud", "surface": "SceneUpdate", "frame": "FrameTransforms"}


@pytest.fixture
def recording(stage, tmp_path):
    """A recording with fields, its scene, and the converted file."""
    scene = stage.finger(rate_hz=50.0)
    scene.write_text(scene.read_text().replace('queries = "fields"', 'queries = "fields"\n            place = { offset_mm = [0.0, 100.0, 5.0] }'))
    stage.twin(scene)
    stage.bridge(scene)
    path = tmp_path / "run.mcap"
    command = [PROGRAMS / "softtwin", "record", "softtwin/finger/field", "softtwin/finger/state", "--fields", "--seconds", "1.5"]
    done = subprocess.run([*command, "--out", path, "--json"], env=stage.environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0 and json.loads(done.stdout)["dropped"] == 0, done.stderr
    assert main([str(path), "--scene", str(scene), "--frames", "20"]) == 0
    return path, scene, path.with_suffix(".foxglove.mcap")


def messages(path, topic):
    with open(path, "rb") as file:
        return [(message, json.loads(message.data)) for _, _, message in make_reader(file).iter_messages(topics=[topic])]


def test_pictures_of_a_recording_agree_with_its_fields(recording):
    source, _, path = recording
    found = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages(topics=[f"viewer/finger/all/{what}" for what in TYPES]):
            assert schema.name == f"foxglove.{TYPES[channel.topic.rsplit('/', 1)[1]]}" and message.log_time == message.publish_time
            found.setdefault(channel.topic.rsplit("/", 1)[1], []).append((message.log_time, decoded))
    fields = {message.publish_time: header for message, header in messages(source, "softtwin/finger/field")}
    times = [time for time, _ in found["points"]]
    assert times == [time for time, _ in found["surface"]] and 2 <= len(times) <= len(fields)
    assert (len(times) - 1) * 50_000_000 <= times[-1] - times[0], "at most 20 per second"

    for time, cloud in found["points"]:
        columns = np.frombuffer(base64.b64decode(fields[time]["values"]), "<f4").reshape(5, -1)
        kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("displacement_mm", "<f4"), ("von_mises_mpa", "<f4"), ("rgba", "u1", 4)])
        assert cloud.point_stride == kind.itemsize and cloud.frame_id == "finger"
        assert [field.name for field in cloud.fields] == [*list(kind.names)[:5], "red", "green", "blue", "alpha"]
        points = np.frombuffer(cloud.data, kind)
        for axis, column in zip("xyz", columns):
            np.testing.assert_allclose(points[axis], column * 1e-3, rtol=1e-6)
        np.testing.assert_array_equal(points["von_mises_mpa"], columns[4])
        assert (points["rgba"][:, 3] == 255).all() and len(np.unique(points["rgba"], axis=0)) > 50
        assert cloud.timestamp.seconds * 1_000_000_000 + cloud.timestamp.nanos == time

    model = softtwin.Model(MODEL)
    for time, update in found["surface"]:
        (entity,) = update.entities
        (body,) = entity.triangles
        corners = np.array(body.indices).reshape(-1, 3)
        assert len(body.points) == len(body.colors) > 5000 and corners.max() < len(body.points) and len(corners) == len(model.triangles)
        points = np.array([(p.x, p.y, p.z) for p in body.points])
        a, b, c = (points[corners[:, k]] for k in range(3))
        assert np.einsum("ij,ij", a, np.cross(b, c)) > 0, "facets face outwards"
        assert len(entity.arrows) == int(fields[time]["contact_force_n"] > 0)
    (transform,) = found["frame"][0][1].transforms
    assert (transform.parent_frame_id, transform.child_frame_id) == ("scene", "finger")
    assert (transform.translation.y, transform.translation.z, transform.rotation.w) == (0.1, 0.005, 1.0)
    states = [state for _, state in messages(source, "softtwin/finger/state")]
    assert [state for _, state in messages(path, "softtwin/finger/state")] == states and len(states) > 5


def test_a_recording_without_its_end_is_converted(recording, tmp_path):
    source, _, _ = recording
    killed, out = tmp_path / "killed.mcap", tmp_path / "killed.foxglove.mcap"
    killed.write_bytes(source.read_bytes()[: source.stat().st_size * 3 // 4])
    assert main([str(killed), "--out", str(out), "--model", str(MODEL)]) == 0
    with open(out, "rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {f"viewer/finger/all/{what}" for what in TYPES} | {"softtwin/finger/state"} <= topics


def test_rerun_loads_the_converted_recording(recording, tmp_path):
    """rerun's loader of MCAP files makes points and transforms of the messages."""
    out = tmp_path / "run.rrd"
    done = subprocess.run([RERUN, "mcap", "convert", str(recording[2]), "-o", str(out)], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    printed = subprocess.run([RERUN, "rrd", "print", "-v", str(out)], capture_output=True, text=True, timeout=PATIENCE_S).stdout
    for column in ("points@Points3D:positions", "points@Points3D:colors", "frame@Transform3D:translation"):
        assert f"/viewer/finger/all/{column}" in printed, column


def test_the_source_for_paraview_fills_vtk_s_data(live):
    """Without ParaView, with the type of object of its programmable source."""
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
    with pytest.raises(ValueError):
        show(output, "softtwin/finger/field/tip", MODEL, bus=live.bus)


def test_the_colour_scale_for_paraview_spans_all_states(tmp_path):
    spec = importlib.util.spec_from_file_location("open_series", REPOSITORY / "clients/paraview/open_series.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    series = tmp_path / "sweep.pvd"
    command = [PROGRAMS / "softtwin", "export", MODEL, "--pressure", "0.02,0.06,0.04", "--gap", "30", "--out", series]
    assert subprocess.run(command, capture_output=True).returncode == 0
    low, high = script.colour_range(series, "von_mises [MPa]")
    stress = softtwin.Model(MODEL).predict([0.02, 0.06, 0.04], 30.0).von_mises
    assert (np.float32(low), np.float32(high)) == (stress.min(), stress.max())
    with pytest.raises(SystemExit, match="heat"):
        script.colour_range(series, "heat")
