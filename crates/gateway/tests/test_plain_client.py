"""A plain Zenoh client from PyPI, which knows nothing of us, against a live twin behind a gateway."""

import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid

import numpy as np
import pytest
import zenoh

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
PROGRAMS = REPOSITORY / os.environ.get("CARGO_TARGET_DIR", "target") / "debug"
PATIENCE_S = 60.0


class Stage:
    """Our programs in an isolated shared-memory domain."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.root = tempfile.mkdtemp(prefix="iox")  # short: event sockets live there, and their paths may have 107 bytes
        self.domain = f"gwpy_{uuid.uuid4().hex[:12]}"
        self.environment = dict(os.environ, SOFTTWIN_DOMAIN=self.domain, SOFTTWIN_ROOT=self.root)
        self.programs: list = []
        with socket.socket() as held:
            held.bind(("127.0.0.1", 0))
            self.port = held.getsockname()[1]

    def write(self, name: str, text: str) -> str:
        (self.folder / name).write_text(text)
        return str(self.folder / name)

    def start(self, *command: str) -> subprocess.Popen:
        """Starts a program and waits until it says that it is ready."""
        path = self.folder / f"{len(self.programs)}.log"
        with open(path, "w") as log:
            program = [str(PROGRAMS / command[0]), *command[1:]]
            child = subprocess.Popen(program, stdout=log, stderr=log, env=self.environment)
        self.programs.append(child)
        self.wait_said("ready:")
        return child

    def run(self, *command: str) -> subprocess.CompletedProcess:
        """Runs a program to its end."""
        program = [str(PROGRAMS / command[0]), *command[1:]]
        return subprocess.run(program, capture_output=True, text=True, env=self.environment, timeout=PATIENCE_S)

    def wait_said(self, text: str) -> None:
        """Waits until the program that was started last says this."""
        path, end = self.folder / f"{len(self.programs) - 1}.log", time.monotonic() + PATIENCE_S
        while text not in path.read_text():
            if self.programs[-1].poll() is not None or time.monotonic() > end:
                pytest.fail(f"`{text}` was not said:\n" + path.read_text())
            time.sleep(0.02)

    def end_last(self) -> str:
        """Ends the program that was started last as the system would; what it said."""
        self.programs[-1].send_signal(signal.SIGTERM)
        self.programs[-1].wait(PATIENCE_S)
        return (self.folder / f"{len(self.programs) - 1}.log").read_text()

    def live(self, rate_hz: float, settings: str = "") -> None:
        """The committed finger with its surface, and a gateway."""
        scene = self.write(
            "scene.toml",
            f"""
            name = "gw"
            [[actuator]]
            name = "finger"
            model = "{REPOSITORY}/models/pneunet/pneunet.twin"
            queries = "fields"
            [actuator.source]
            kind = "simulate"
            rate_hz = {rate_hz}
            gap_mm = 30.0
            profile = {{ shape = "sine", mean_mpa = 0.045, amplitude_mpa = 0.03, frequency_hz = 0.5 }}
            [[actuator.output]]
            nodes = "all"
            [[actuator.output]]
            nodes = "surface"
            """,
        )
        self.start("softtwind", "twin", "--scene", scene)
        self.start("softtwind", "bridge", "--scene", scene)
        config = self.write("gateway.toml", f'listen = ["tcp/127.0.0.1:{self.port}"]\n{settings}')
        self.start("softtwin-gateway", "--config", config)

    def session(self, mode: str) -> zenoh.Session:
        config = zenoh.Config()
        config.insert_json5("mode", json.dumps(mode))
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{self.port}"]))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("scouting/multicast/enabled", "false")
        return zenoh.open(config)

    def close(self) -> None:
        for child in reversed(self.programs):
            child.kill()
            child.wait()
        for left in pathlib.Path("/dev/shm").glob(f"iox2_{self.domain}_*"):
            left.unlink(missing_ok=True)
        shutil.rmtree(self.root, ignore_errors=True)


@pytest.fixture
def stage(tmp_path):
    made = Stage(tmp_path)
    yield made
    made.close()


class Collected:
    """Samples of a key, counted as they come."""

    def __init__(self, session: zenoh.Session, key: str, read) -> None:
        self.read, self.found, self.changed = read, [], threading.Condition()
        self.subscriber = session.declare_subscriber(key, self.take)

    def take(self, sample: zenoh.Sample) -> None:
        with self.changed:
            self.found.append(self.read(sample))
            self.changed.notify()

    def wait(self, count: int) -> list:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.found) >= count, PATIENCE_S), f"{len(self.found)} of {count}"
            return self.found[:count]


def json_of(sample: zenoh.Sample) -> dict:
    assert str(sample.encoding) == "application/json"
    return json.loads(bytes(sample.payload))


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_states_and_fields_are_plain_json_and_plain_numbers(stage, mode):
    stage.live(200.0)
    with stage.session(mode) as session:
        states = Collected(session, "softtwin/finger/state", json_of)
        numbers = [state["seq"] for state in states.wait(300)]
        assert numbers == list(range(numbers[0], numbers[0] + 300))
        state = states.found[-1]
        assert state["actuator"] == "finger" and state["regime"] in ("free", "contact")
        fields = Collected(
            session,
            "softtwin/finger/field/surface",
            lambda sample: (str(sample.encoding), json.loads(bytes(sample.attachment)), bytes(sample.payload)),
        )
        encoding, about, payload = fields.wait(3)[-1]
        assert encoding == "application/octet-stream;f32le"
        values = np.frombuffer(payload, "<f4").reshape(len(about["fields"]), about["node_count"])
        field = dict(zip(about["fields"], values))
        assert list(field) == ["x", "y", "z", "displacement", "von_mises"]
        assert about["max_von_mises_mpa"] == pytest.approx(field["von_mises"].max(), rel=1e-6)
        assert about["node_set"] == "surface" and "values" not in about


def test_what_is_not_subscribed_to_can_be_asked_for(stage):
    stage.live(200.0)
    with stage.session("client") as session:
        ask = lambda selector: [reply.ok for reply in session.get(selector)]
        (state,) = ask("softtwin/finger/state")
        assert json_of(state)["contact_force_n"] >= 0.0
        (answer,) = ask("softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30;field=surface")
        about = json.loads(bytes(answer.attachment))
        field = np.frombuffer(bytes(answer.payload), "<f4").reshape(len(about["fields"]), about["node_count"])
        assert about["pressure_mpa"] == 0.05 and field.shape[1] == about["node_count"] > 1000
        assert field[4].max() == pytest.approx(about["max_von_mises_mpa"], rel=1e-6)


def test_the_program_of_the_page_runs_and_is_shown_there(stage):
    stage.live(200.0)
    program = REPOSITORY / "crates/gateway/python/plain.py"
    assert program.read_text().strip() in (REPOSITORY / "docs/gateway.md").read_text()
    done = subprocess.run(
        [sys.executable, str(program), f"tcp/127.0.0.1:{stage.port}"], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    for expected in ("softtwin/finger/alive", "largest stress", "0.3 N at 30 mm: 0.0", "#"):
        assert expected in done.stdout, done.stdout


READER = """
import json, sys, threading, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
heard = threading.Event()
subscriber = session.declare_subscriber("softtwin/**", lambda sample: heard.set())
heard.wait()
print("listening", flush=True)
sys.stdin.read()
"""


def test_a_reader_that_stands_still_costs_the_others_nothing(stage):
    """A stopped process takes nothing, so its connection fills up; the gateway cuts it off in time."""
    stage.live(1000.0)
    with stage.session("client") as session:
        states = Collected(session, "softtwin/finger/state", lambda sample: json.loads(bytes(sample.payload))["seq"])
        states.wait(100)
        stuck = subprocess.Popen(
            [sys.executable, "-c", READER, f"tcp/127.0.0.1:{stage.port}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        try:
            stuck.stdout.readline()
            stuck.send_signal(signal.SIGSTOP)
            stage.wait_said("Closing transport")
            numbers = states.wait(len(states.found) + 1000)
        finally:
            stuck.kill()
            stuck.wait()
        lost = [(a, b) for a, b in zip(numbers, numbers[1:]) if b != a + 1]
        assert not lost, lost


NUMBERS = """
import json, sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
tell = lambda sample: print(json.loads(bytes(sample.attachment))["gateway_seq"], flush=True)
subscriber = session.declare_subscriber("softtwin/finger/field/surface", tell)
sys.stdin.read()
"""


def test_fields_that_a_reader_did_not_take_are_seen_in_their_numbers(stage):
    """The network engine does not say what it skips for whom; the numbers do."""
    stage.live(200.0, "field_rate_hz = 100.0")
    with stage.session("client") as session:
        size = Collected(session, "softtwin/finger/field/surface", lambda sample: len(bytes(sample.payload)))
        slow = subprocess.Popen(
            [sys.executable, "-c", NUMBERS, f"tcp/127.0.0.1:{stage.port}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        try:
            first = int(slow.stdout.readline())
            slow.send_signal(signal.SIGSTOP)
            size.wait(1)
            # Far more than the sockets of both sides and the engine's queues hold.
            size.wait(len(size.found) + 100_000_000 // size.found[0])
            slow.send_signal(signal.SIGCONT)
            numbers, end = [first], time.monotonic() + PATIENCE_S
            while len(numbers) < 2 or numbers[-1] == numbers[-2] + 1:
                assert time.monotonic() < end, f"nothing was skipped: {numbers}"
                numbers.append(int(slow.stdout.readline()))
            assert numbers[-1] > numbers[-2], "numbers only rise"
        finally:
            slow.kill()
            slow.wait()
