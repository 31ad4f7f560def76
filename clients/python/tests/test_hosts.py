"""The client where people run it: signals during a query, threads, a notebook."""

import os
import signal
import subprocess
import sys
import threading

import nbclient
import nbformat
import pytest
import softtwin
from conftest import REPOSITORY

WAIT_S = 60.0

ASKS = """
import signal, sys, softtwin
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGALRM, lambda *_: print("handled", flush=True))
twin = softtwin.Client("finger", timeout_s=60)
twin.whatif(0.02, 30.0)
print("asking", flush=True)
sys.stdin.readline()  # the twin is stopped now
try:
    print("asks", flush=True)
    print(twin.whatif(0.05, 30.0).pressure_mpa, flush=True)
except KeyboardInterrupt as end:
    print(type(end).__name__, flush=True)
"""


@pytest.mark.parametrize("number, expected", [(signal.SIGINT, ["KeyboardInterrupt"]), (signal.SIGALRM, ["handled", "0.05"])])
def test_signals_reach_their_handlers_during_a_query(stage, number, expected):
    twin = stage.twin(stage.finger(source=False))
    child = subprocess.Popen([sys.executable, "-c", ASKS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=stage.environment())
    assert child.stdout.readline() == "asking\n"
    twin.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, twin.pid, os.WSTOPPED)  # all threads
    child.stdin.write("\n")
    child.stdin.flush()
    assert child.stdout.readline() == "asks\n"
    child.send_signal(number)
    assert child.stdout.readline() == f"{expected[0]}\n"
    twin.send_signal(signal.SIGCONT)
    assert child.communicate(timeout=WAIT_S)[0].split() == expected[1:]
    assert child.returncode == 0


def test_threads_read_and_ask_at_the_same_time(live):
    failures, seen = [], []

    def read(topic):
        try:
            readings = softtwin.subscribe(topic, timeout_s=WAIT_S, bus=live.bus)
            numbers = [getattr(sample, "header", sample).seq for sample in (readings.next() for _ in range(40))]
            assert numbers == sorted(set(numbers)), numbers
            seen.append(topic)
        except Exception as error:  # noqa: BLE001
            failures.append(error)

    def ask(pressure_mpa):
        try:
            twin = softtwin.Client("finger", timeout_s=WAIT_S, bus=live.bus)
            found = [twin.whatif(pressure_mpa, 30.0).pressure_mpa for _ in range(20)]
            assert found == [pressure_mpa] * 20
            seen.append(pressure_mpa)
        except Exception as error:  # noqa: BLE001
            failures.append(error)

    topics = ["softtwin/finger/state", "softtwin/finger/field", "softtwin/finger/field/tip", "softtwin/finger/state"]
    threads = [threading.Thread(target=read, args=(topic,)) for topic in topics]
    threads += [threading.Thread(target=ask, args=(pressure,)) for pressure in (0.02, 0.04, 0.06)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(2 * WAIT_S)
    assert not failures and len(seen) == len(threads), failures


CELLS = [
    "import softtwin\nstate = softtwin.newest('softtwin/finger/state', timeout_s=60)",
    "async for later in softtwin.subscribe('softtwin/finger/state', timeout_s=60):\n    if later.seq > state.seq + 3:\n        break",
    "field = softtwin.newest('softtwin/finger/field', timeout_s=60)\n"
    "found = softtwin.Client('finger', timeout_s=60).whatif(0.05, 30.0)\n"
    "print(later.seq > state.seq, field.x.size > 0, found.pressure_mpa)",
]


def test_a_notebook_reads_and_asks_a_running_twin(live, monkeypatch):
    for name, value in live.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(REPOSITORY / "clients/python/src"), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
    done = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    assert done.cells[-1].outputs[0]["text"].split() == ["True", "True", "0.05"]
