"""The client against a live twin."""

import asyncio
import gc
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY

STRANGER = 54321
WAIT_S = 60.0


def test_fields_are_read_only_views_that_keep_their_sample(live):
    held = None
    for field in softtwin.subscribe("softtwin/finger/field", timeout_s=WAIT_S, bus=live.bus):
        assert field.names == ["x", "y", "z", "displacement", "von_mises"]
        assert field.values.shape == (5, field.header.node_count)
        assert field.x.base is not None and not field.x.flags.writeable and not field.x.flags.owndata
        with pytest.raises(ValueError):
            field.x[0] = 1.0
        assert float(field.von_mises.max()) == pytest.approx(field.header.max_von_mises_mpa, rel=1e-6)
        assert int(field.von_mises.argmax()) == field.header.max_von_mises_node
        if held is None:
            # One row remains: it must keep the shared memory unchanged.
            held, copied, first_seq = field.y, field.y.copy(), field.header.seq
            del field
            gc.collect()
            continue
        if field.header.seq > first_seq + 40:
            break
    np.testing.assert_array_equal(held, copied)


def test_holding_too_many_samples_raises(live):
    fields = softtwin.subscribe("softtwin/finger/field/tip", timeout_s=WAIT_S, bus=live.bus)
    held = [fields.next() for _ in range(4)]
    with pytest.raises(softtwin.SofttwinError) as refused:
        for _ in range(3):
            held.append(fields.next())
    assert refused.type is softtwin.SofttwinError
    held.clear()
    gc.collect()
    assert fields.next().names == ["x", "y", "z"]


def test_states_and_health_are_read(live):
    states = softtwin.subscribe("softtwin/finger/state", timeout_s=WAIT_S, bus=live.bus)
    seen = [states.next() for _ in range(50)]
    assert [b.seq - a.seq for a, b in zip(seen, seen[1:])] == [1] * 49
    assert states.lost == 0
    state = seen[-1]
    assert state.regime_name in ("free", "contact") and state.contact_force_n >= 0
    assert state.to_dict()["actuator"] == "finger"
    assert state.input_values["pressure_mpa"] == (state.pressure_mpa, "measured")
    health = softtwin.newest("softtwin/finger/health", WAIT_S, bus=live.bus)
    assert health.received == sum(health.outcomes)


def test_a_subscription_is_an_async_iterator(live):
    async def read(topic, count):
        seen = []
        async for sample in softtwin.subscribe(topic, timeout_s=WAIT_S, bus=live.bus):
            seen.append(sample)
            if len(seen) == count:
                return seen

    async def both():
        return await asyncio.gather(read("softtwin/finger/state", 50), read("softtwin/finger/health", 1))

    states, health = asyncio.run(both())
    assert [b.seq - a.seq for a, b in zip(states, states[1:])] == [1] * 49 and health[0].received > 0

    async def silent():
        async for _ in softtwin.subscribe("softtwin/finger/health", timeout_s=0.05, bus=live.bus):
            pass

    with pytest.raises(softtwin.TwinSilent):
        asyncio.run(silent())


def test_questions_are_answered(live):
    twin = softtwin.Client("finger", timeout_s=WAIT_S, bus=live.bus)
    there = twin.whatif(0.06, 30.0)
    assert there.regime_name == "contact" and there.contact_force_n > 0.1
    back = twin.pressure(there.contact_force_n, 30.0)
    assert back.pressure_mpa == pytest.approx(0.06, abs=1e-6) and 0 < back.uncertainty < 0.01
    gap = twin.gap(0.06, there.contact_force_n, 0.005)
    assert gap.gap_mm == pytest.approx(30.0, abs=1e-3) and gap.low < 30.0 < gap.high
    field = twin.whatif(0.06, 30.0, field="all")
    assert field.x.shape == (25022,) and not field.x.flags.writeable
    assert field.header.contact_force_n == there.contact_force_n
    assert there.text_list("input_names") == ["pressure_mpa", "gap_mm"] and list(there.inputs[:2]) == [0.06, 30.0]
    assert there.input_values["gap_mm"] == (30.0, "unknown")
    exact = softtwin.Model(REPOSITORY / "models/pneunet/pneunet.twin").predict(0.06, 30.0, fields=False)
    assert list(there.observable_values) == list(exact.observables)
    for name, (value, halfwidth) in there.observable_values.items():
        assert value == pytest.approx(exact.observables[name], rel=1e-12) and value != 0.0
        assert halfwidth == pytest.approx(exact.observable_halfwidths[name], rel=1e-12)
    assert there.force_by_input[0] == there.force_by_pressure_n_per_mpa
    with pytest.raises(softtwin.Refused):
        twin.whatif(0.06, 30.0, inputs={"elastomer.law.mu_mpa": 0.7})
    outside = twin.whatif(0.1, 30.0)
    assert outside.domain_status == 2 and np.isnan(outside.displacement_halfwidth_mm) and np.isnan(outside.force_halfwidth_n)
    assert all(np.isnan(halfwidth) and not np.isnan(value) for value, halfwidth in outside.observable_values.values())
    with pytest.raises(softtwin.Refused) as refused:
        twin.whatif(0.2, 30.0)
    assert refused.value.answer.limit > 0.25 and np.isnan(refused.value.answer.contact_force_n)
    with pytest.raises(softtwin.Refused) as refused:
        twin.pressure(50.0, 30.0)
    assert refused.value.answer.limit == pytest.approx(twin.whatif(0.09, 30.0).contact_force_n, rel=0.01)


def test_readings_from_python_are_answered(stage):
    stage.twin(stage.finger(source=False))
    states = softtwin.subscribe("softtwin/finger/state", timeout_s=WAIT_S, bus=stage.bus)
    sensor = softtwin.SensorPublisher("finger", bus=stage.bus)
    with pytest.raises(softtwin.AlreadyPublished):
        softtwin.SensorPublisher("finger", bus=stage.bus)
    seq = sensor.send(0.05, 30.0, 0.2)
    for state in states:
        if state.sensor_seq == seq and not state.flag_names.count("no-data"):
            break
    assert state.pressure_mpa == 0.05 and state.measured_force_n == 0.2
    assert "force-measured" in state.flag_names
    bad = sensor.send(math.nan, 30.0)
    for state in states:
        if "held" in state.flag_names:
            break
    assert state.sensor_seq == seq != bad, "the last good reading stands"


def test_named_inputs_from_python_are_measured_inputs(stage):
    stage.twin(
        stage.scene(
            f"""
            name = "py"
            [[actuator]]
            name = "finger"
            model = "{REPOSITORY / "models/pneunet-design/pneunet-design.twin"}"
            [actuator.inputs]
            "elastomer.law.mu_mpa" = "measured"
            """
        )
    )
    states = softtwin.subscribe("softtwin/finger/state", timeout_s=WAIT_S, bus=stage.bus)
    sensor = softtwin.SensorPublisher("finger", bus=stage.bus)
    seq = sensor.send(0.05, 30.0, inputs={"room_1": 3.0, "elastomer.law.mu_mpa": 0.9})
    for state in states:
        if state.sensor_seq == seq and not state.flag_names.count("no-data"):
            break
    assert state.input_values["elastomer.law.mu_mpa"] == (0.9, "measured")
    sensor.send(0.05, 30.0)
    for state in states:
        if "held" in state.flag_names:
            break
    assert state.name_of("outcome") == "held: not finite" and state.sensor_seq == seq
    with pytest.raises(ValueError, match="7"):
        sensor.send(0.05, 30.0, inputs={f"x{at}_1": 0.0 for at in range(7)})


@pytest.fixture
def converter(stage):
    """Valve behind a converter (a file), driven by a bridge; the first owner is another program."""
    device = stage.folder / "iio:device0"
    device.mkdir()
    raw = device / "out_voltage0_raw"
    raw.write_text("0\n")
    valve = f"""
            [actuator.valve]
            range_mpa = [0.0, 0.08]
            state_max_age_ms = 60000
            stop_outside_domain = false
            [actuator.valve.iio]
            root = "{stage.folder}"
            device = "iio:device0"
            scale = 2e-5
            raw_max = 4095
            """
    scene = stage.finger()
    scene.write_text(scene.read_text() + valve)
    stage.twin(scene)
    stage.bridge(scene)
    return raw


def written(raw, wanted):
    end = time.monotonic() + WAIT_S
    while raw.read_text().strip() != wanted:
        assert time.monotonic() < end, f"{wanted} does not come, found {raw.read_text()}"
        time.sleep(0.001)


@pytest.mark.parametrize("with_control", [False, True])
def test_a_valve_has_one_owner(stage, converter, with_control):
    if with_control:  # drivers are a separate group
        os.mkdir(f"{stage.root}/control")
    valve = softtwin.SetpointPublisher("finger", owner="driver", bus=stage.bus)
    writes = softtwin.subscribe("softtwin/finger/valve", timeout_s=WAIT_S, bus=stage.bus)
    sent = valve.send(0.02, valid_for_s=10 * WAIT_S, t_sensor_ns=7)
    write = next(write for write in writes if write.name_of("valve_reason") == "following")
    assert (write.setpoint_seq, write.t_sensor_ns, write.to_dict()["owner"]) == (sent, 7, "driver")
    written(converter, "1000")
    holder = rf"\(`driver`, process {os.getpid()}\)"
    with pytest.raises(softtwin.AlreadyPublished, match=holder):
        softtwin.SetpointPublisher("finger", owner="second", bus=stage.bus)
    second = [str(PROGRAMS / "softtwin"), "setpoint", "finger", "--pressure", "0.05"]
    said = subprocess.run(second, env=stage.environment(), capture_output=True, text=True)
    assert said.returncode != 0 and re.search(holder, said.stderr), said
    valve.send(0.03, valid_for_s=0.05)  # not renewed
    write = next(write for write in writes if write.name_of("valve_reason") == "timeout")
    assert write.pressure_mpa == 0.0
    valve.send(0.03, valid_for_s=10 * WAIT_S)
    written(converter, "1500")
    valve.send(math.nan)
    written(converter, "0")
    left = softtwin.SetpointPublisher("finger", owner="driver", bus=stage.bus, cavity="left")
    found = softtwin.subscribe("softtwin/finger/setpoint/left", timeout_s=WAIT_S, bus=stage.bus)
    left.send(0.01, valid_for_s=0.05)
    assert next(iter(found)).pressure_mpa == 0.01


def test_the_owner_of_another_language_is_named(stage, converter):
    example = pathlib.Path(__file__).resolve().parents[1] / "examples" / "set_pressure.py"
    arguments = [sys.executable, str(example), "--pressure-mpa", "0.04", "--seconds", "600"]
    owner = subprocess.Popen(arguments, env=stage.environment(), stdout=subprocess.PIPE, text=True)
    stage.programs.append(owner)
    assert any("following: 0.0400 MPa" in line for line in owner.stdout)
    written(converter, "2000")
    with pytest.raises(softtwin.AlreadyPublished, match=rf"\(`set_pressure.py`, process {owner.pid}\)"):
        softtwin.SetpointPublisher("finger", owner="driver", bus=stage.bus)
    owner.kill()
    written(converter, "0")


@pytest.mark.parametrize("owner, valid_for_s", [("", 0.1), ("a\nb", 0.1), ("x" * 32, 0.1), ("driver", 0.0), ("driver", math.nan)])
def test_invalid_owner_or_validity_raises(stage, owner, valid_for_s):
    with pytest.raises(ValueError):
        softtwin.SetpointPublisher("finger", owner=owner, bus=stage.bus).send(0.01, valid_for_s)


def test_absent_twin_raises(stage):
    for refused in (
        lambda: softtwin.subscribe("softtwin/finger/field", bus=stage.bus),
        lambda: softtwin.Client("finger", bus=stage.bus),
    ):
        with pytest.raises(softtwin.TwinAbsent):
            refused()
    with pytest.raises(ValueError):
        softtwin.subscribe("softtwin/*/field", bus=stage.bus)


def test_silent_topic_raises(stage):
    stage.twin(stage.finger(source=False))
    fields = softtwin.subscribe("softtwin/finger/field", bus=stage.bus)
    with pytest.raises(softtwin.TwinSilent):
        fields.next(0.05)


@pytest.mark.parametrize("on_restart", ["raise", "continue"])
def test_restart_raises_or_continues(stage, on_restart):
    scene = stage.finger()
    twin = stage.twin(scene)
    stage.bridge(scene)
    states = softtwin.subscribe("softtwin/finger/state", timeout_s=WAIT_S, on_restart=on_restart, bus=stage.bus)
    before = states.next()
    stage.stop(twin)
    stage.twin(scene)
    if on_restart == "raise":
        with pytest.raises(softtwin.TwinRestarted) as restarted:
            while True:
                states.next()
        assert restarted.value.sample.boot_id != before.boot_id
    else:
        while states.next().boot_id == before.boot_id:
            pass
        assert states.restarts == 1


CHILD = """
import os, signal, sys, softtwin
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGALRM, lambda *_: print("handled", flush=True))
readings = softtwin.subscribe("softtwin/finger/command", wait_for_twin=True, timeout_s=float(sys.argv[1]))
try:
    print("waiting", flush=True)
    readings.next()
except (KeyboardInterrupt, softtwin.TwinSilent) as end:
    print(type(end).__name__, flush=True)
"""


@pytest.mark.parametrize("number, timeout_s, expected", [(signal.SIGINT, 60, ["KeyboardInterrupt"]), (signal.SIGALRM, 2, ["handled", "TwinSilent"])])
def test_signals_reach_their_handlers_while_a_reader_waits(stage, number, timeout_s, expected):
    places = {"SOFTTWIN_DOMAIN": stage.domain, "SOFTTWIN_ROOT": stage.root}
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(timeout_s)], stdout=subprocess.PIPE, text=True, env={**os.environ, **places})
    assert child.stdout.readline() == "waiting\n"
    child.send_signal(number)
    assert child.communicate(timeout=60)[0].split() == expected


@pytest.fixture
def apart(stage):
    """Name and folder of a domain in which nothing has happened yet."""
    domain, root = f"t{stage.domain[3:]}", pathlib.Path(tempfile.mkdtemp(prefix="iox"))
    yield domain, root
    shutil.rmtree(root)
    for path in pathlib.Path("/dev/shm").glob(f"iox2_{domain}_*"):
        path.unlink()


def test_another_user_s_folder_and_one_open_to_others_are_refused(apart):
    domain, root = apart
    root.chmod(0o770)
    with pytest.raises(softtwin.SofttwinError, match="chmod 700"):
        softtwin.Bus(domain, str(root))
    if os.geteuid() == 0:
        root.chmod(0o700)
        os.chown(root, STRANGER, -1)
        with pytest.raises(softtwin.SofttwinError, match=f"belongs to user {STRANGER}"):
            softtwin.Bus(domain, str(root))
    assert not list(root.iterdir())


def test_files_are_the_user_s_alone(apart):
    domain, root = apart
    bus = softtwin.Bus(domain, str(root))
    readings = softtwin.subscribe("softtwin/finger/sensor", wait_for_twin=True, bus=bus)
    publisher = softtwin.SensorPublisher("finger", bus=bus)
    files = [root, *pathlib.Path("/dev/shm").glob(f"iox2_{domain}_*")]
    modes = {path.name: oct(path.lstat().st_mode) for path in files if path.lstat().st_mode & 0o077}
    assert len(files) > 5 and not modes, modes
    del readings, publisher, bus


FORK = """
import gc, os, sys, softtwin
readings = softtwin.subscribe("softtwin/finger/state", timeout_s=20)
field = softtwin.newest("softtwin/finger/field", timeout_s=20)
readings.next()
child = os.fork()
if child == 0:  # what a library's worker does: it touches the reader, collects garbage and ends as usual
    try:
        readings.next()
        sys.exit(1)
    except softtwin.SofttwinError:
        pass
    del readings, field
    gc.collect()
    own = softtwin.newest("softtwin/finger/state", timeout_s=20)
    sys.exit(0 if own.seq > 0 else 2)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
before = readings.newest().seq
print(readings.next().seq > before, float(field.x[0]) == float(field.x[0]))
"""


def test_a_forked_process_leaves_the_readers_of_its_parent(live):
    places = {"SOFTTWIN_DOMAIN": live.domain, "SOFTTWIN_ROOT": live.root}
    done = subprocess.run([sys.executable, "-c", FORK], capture_output=True, text=True, timeout=120, env={**os.environ, **places})
    assert done.stdout.split() == ["0", "True", "True"], done.stderr
