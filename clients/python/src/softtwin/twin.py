"""A twin as a process of its own, started from Python: `with Twin(model) as twin: twin.send(pressure_mpa=0.03)`."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
from typing import Any, Optional

from .bus import Bus, default_bus
from .errors import SofttwinError
from .model import Model
from .publish import SensorPublisher
from .query import Client
from .subscribe import Subscription

_START_S = 60.0


def _program(name: str) -> str:
    """The program of this installation, of the path, or of the checkout that this package is in."""
    checkout = pathlib.Path(__file__).resolve().parents[4] / "target"
    for path in (pathlib.Path(sys.executable).with_name(name), checkout / "release" / name, checkout / "debug" / name):
        if path.is_file():
            return str(path)
    found = shutil.which(name)
    if found is None:
        raise SofttwinError(f"expected the program {name} beside {sys.executable} or in PATH, found none; pip install ./clients/python puts it there")
    return found


class Twin:
    """Starts `softtwind twin` with a model and ends it with the block. Every program of the domain can read it meanwhile.

    All inputs of the model other than pressure and gap are measured: `send` takes them by name. For other sources, limits, outputs and a service
    that stays, write a scene (docs/your-actuator.md).

    >>> from softtwin import shared_file
    >>> with Twin(shared_file("models/pneunet/pneunet.twin"), name="mine") as twin:
    ...     states = twin.subscribe("state", timeout_s=10.0)
    ...     sent = twin.send(0.05, 30.0)
    ...     print(next(state for state in states if state.sensor_seq == sent).regime_name)
    contact
    """

    def __init__(self, model: "Model | os.PathLike[str] | str", *, name: str = "actuator", bus: Optional[Bus] = None) -> None:
        #: Name of the actuator.
        self.name = name
        self._bus = bus or default_bus()
        program = _program("softtwind")
        self._folder = tempfile.TemporaryDirectory(prefix="softtwin-")
        folder = pathlib.Path(self._folder.name)
        known = model if isinstance(model, Model) else Model(model)
        file = folder / "model.twin"
        known.save(file)
        measured = [key for key in known.inputs if key not in ("pressure_mpa", "gap_mm")]
        lines = [f'name = "{name}"', "[[actuator]]", f'name = "{name}"', 'model = "model.twin"', 'queries = "fields"']
        lines += ["[actuator.inputs]", *(f'"{key}" = "measured"' for key in measured)] if measured else []
        lines += ["[[actuator.output]]", 'nodes = "all"']
        (folder / "scene.toml").write_text("\n".join(lines) + "\n")
        environment = {**os.environ, **self._bus.environment}
        with open(folder / "log", "w") as log:
            command = [program, "twin", "--scene", str(folder / "scene.toml")]
            self._process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        end = time.monotonic() + _START_S
        try:
            while "ready:" not in (folder / "log").read_text():
                if self._process.poll() is not None or time.monotonic() > end:
                    raise SofttwinError(f"the twin did not start:\n{(folder / 'log').read_text()}")
                time.sleep(0.02)
            self._sensor = SensorPublisher(name, bus=self._bus)
        except BaseException:
            self.close()
            raise

    def send(self, pressure_mpa: float = float("nan"), gap_mm: float = float("nan"), *, force_n: float = float("nan"), **inputs: float) -> int:
        """Sends a reading and returns its number."""
        return self._sensor.send(pressure_mpa, gap_mm, force_n, inputs=inputs)

    def subscribe(self, kind: str = "state", **options: Any) -> Subscription:
        """Reads one of the twin's topics: "state", "field", "health"."""
        return Subscription(f"softtwin/{self.name}/{kind}", bus=self._bus, **options)

    def client(self, **options: Any) -> Client:
        """Asks the twin."""
        return Client(self.name, bus=self._bus, **options)

    def close(self) -> None:
        """Ends the twin."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(10.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._folder.cleanup()

    def __enter__(self) -> "Twin":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
