"""Calls that take long: Ctrl-C ends them, and they say what they do."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import softtwin
from conftest import REPOSITORY

#: A call that would take far longer than the test waits.
TRAINING = f"""
import softtwin
database = softtwin.Database.read({str(REPOSITORY / "models/pneunet/database")!r})
print("begins", flush=True)
while True:
    softtwin.train(database)
"""
LEARNING = """
import numpy, softtwin
t = numpy.arange(0.0, 300.0, 0.02)
p = numpy.cumsum(numpy.random.default_rng(1).normal(size=t.size))
channels = dict(time="t", inputs={"pressure_mpa": "p", "load_n": "q"}, outputs={"angle_deg": "a"})
print("begins", flush=True)
while True:
    softtwin.learn({"t": t, "p": p, "q": numpy.sin(t), "a": p + 0.1 * numpy.sin(t)}, **channels)
"""
BUILDING = """
import softtwin, sys
finger = softtwin.Actuator.new(sys.argv[1], chambers=6, length_mm=60.0)
print("begins", flush=True)
finger.build()
"""


@pytest.mark.parametrize("program", [TRAINING, LEARNING, BUILDING], ids=["train", "learn", "build"])
def test_an_interrupt_ends_a_computation(program, tmp_path):
    child = subprocess.Popen(
        [sys.executable, "-c", program, tmp_path / "finger"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    )
    assert child.stdout.readline() == "begins\n"
    time.sleep(1.0)
    began = time.monotonic()
    child.send_signal(signal.SIGINT)
    _, error = child.communicate(timeout=60)
    assert "KeyboardInterrupt" in error and "panicked" not in error, error
    assert time.monotonic() - began < 5.0


def bar():
    points = np.array([[x, y, z] for x in range(11) for y in (0, 1) for z in (0, 1)], float)
    pressure = np.linspace(0.0, 0.08, 6)
    moved = -np.einsum("i,j,k", pressure, points[:, 0] ** 2, [0.0, 1.0, 0.0])
    return softtwin.Database(points, inputs={"pressure_mpa": pressure}, displacement_mm=moved)


def test_an_exception_of_the_callback_ends_the_call():
    seen = []

    def stop(step):
        seen.append(step)
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        softtwin.train(bar(), progress=stop)
    assert len(seen) == 1
    assert softtwin.train(bar()).errors, "the database is unharmed"


def test_other_threads_run_meanwhile():
    database = softtwin.Database.read(REPOSITORY / "models/pneunet/database")
    ticks = []
    over = threading.Event()

    def tick():
        while not over.wait(0.01):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.monotonic()
    softtwin.train(database)
    took = time.monotonic() - began
    over.set()
    thread.join()
    assert len(ticks) > 10 * took, "the interpreter's lock is free while training"


def test_a_build_says_what_it_does_and_goes_on_where_it_was(tmp_path):
    actuator = softtwin.Actuator.new(tmp_path / "block", chambers=2, length_mm=30.0, width_mm=10.0, shear_modulus_mpa=0.2)
    steps = []
    model = actuator.build(quick=True, progress=steps.append)
    assert any("nodes" in step for step in steps) and any(" of " in step and step.endswith("states") for step in steps)
    assert model.report["failed"] == 0 and model.report["states"] > 8
    assert (tmp_path / "block/scene.toml").is_file() and set(model.errors) >= {"free"}
    middle = 0.5 * model.inputs["pressure_mpa"].max
    simulated = actuator.simulate(middle).displacement_mm
    np.testing.assert_allclose(model.predict(middle).displacement, simulated, atol=0.05 * simulated.max())
    again = actuator.build(quick=True)
    assert again.report["reused"] == again.report["states"]
    with pytest.raises(ValueError, match="size_mm"):
        actuator.build(size_mm=1e4)
