"""Live twin for tests: the programs of this repository in a separate shared-memory domain."""

import os
import pathlib
import shutil
import subprocess
import tempfile
import time
import uuid

import pytest
import softtwin

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
PROGRAMS = REPOSITORY / os.environ.get("CARGO_TARGET_DIR", "target") / os.environ.get("SOFTTWIN_PROFILE", "debug")
PATIENCE_S = 60.0


class Stage:
    """Shared-memory domain with programs in it."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.domain = f"py_{uuid.uuid4().hex[:12]}"
        self.root = tempfile.mkdtemp(prefix="iox")  # short: event sockets live there, and their paths may have 107 bytes
        self.programs: list = []
        self.bus = softtwin.Bus(self.domain, self.root)

    def scene(self, text: str) -> pathlib.Path:
        path = self.folder / "scene.toml"
        path.write_text(text)
        return path

    def finger(self, rate_hz: float = 500.0, source: bool = True) -> pathlib.Path:
        """The committed finger: whole field, tip, questions with fields."""
        model = REPOSITORY / "models/pneunet/pneunet.twin"
        reads = f"""
            [actuator.source]
            kind = "simulate"
            rate_hz = {rate_hz}
            gap_mm = 30.0
            [actuator.source.profile]
            shape = "sine"
            mean_mpa = 0.045
            amplitude_mpa = 0.03
            frequency_hz = 0.5
        """
        return self.scene(
            f"""
            name = "py"
            [[actuator]]
            name = "finger"
            model = "{model}"
            queries = "fields"
            {reads if source else ""}
            [[actuator.output]]
            nodes = "all"
            [[actuator.output]]
            name = "tip"
            nodes = {{ box = {{ min = [114.9, 1.9, 15.9], max = [115.1, 2.1, 16.1] }} }}
            fields = ["x", "y", "z"]
            """
        )

    def environment(self) -> dict:
        """Environment of programs in this shared-memory domain."""
        return dict(os.environ, SOFTTWIN_DOMAIN=self.domain, SOFTTWIN_ROOT=self.root)

    def start(self, *arguments: str) -> subprocess.Popen:
        """Starts a program and waits until it is ready."""
        program = PROGRAMS / arguments[0]
        if not program.exists():
            pytest.fail(f"{program} is not built; run scripts/check.sh clients")
        log = open(self.folder / f"{len(self.programs)}.log", "w+")
        child = subprocess.Popen(
            [str(program), *arguments[1:]], stdout=log, stderr=subprocess.STDOUT, env=self.environment()
        )
        self.programs.append(child)
        end = time.monotonic() + PATIENCE_S
        while "ready:" not in (self.folder / f"{len(self.programs) - 1}.log").read_text():
            if child.poll() is not None or time.monotonic() > end:
                pytest.fail(f"{arguments} did not get ready:\n" + pathlib.Path(log.name).read_text())
            time.sleep(0.02)
        return child

    def twin(self, scene: pathlib.Path) -> subprocess.Popen:
        return self.start("softtwind", "twin", "--scene", str(scene))

    def bridge(self, scene: pathlib.Path) -> subprocess.Popen:
        return self.start("softtwind", "bridge", "--scene", str(scene))

    def stop(self, child: subprocess.Popen) -> None:
        child.terminate()
        child.wait(PATIENCE_S)

    def close(self) -> None:
        for child in self.programs:
            if child.poll() is None:
                child.kill()
            child.wait()
        del self.bus
        for left in pathlib.Path("/dev/shm").glob(f"iox2_{self.domain}_*"):
            left.unlink(missing_ok=True)
        shutil.rmtree(self.root, ignore_errors=True)


@pytest.fixture
def stage(tmp_path):
    made = Stage(tmp_path)
    yield made
    made.close()


@pytest.fixture
def live(stage):
    """A running twin and bridge of the committed finger."""
    scene = stage.finger()
    stage.twin(scene)
    stage.bridge(scene)
    return stage
