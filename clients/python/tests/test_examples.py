"""The example programs and those of docs/clients run."""

import json
import pathlib
import re
import subprocess
import sys

import pytest
from conftest import PATIENCE_S, REPOSITORY

EXAMPLES = pathlib.Path(__file__).resolve().parents[1] / "examples"


def run(stage, *arguments, timeout_s=PATIENCE_S):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)], env=stage.environment(), capture_output=True, text=True, timeout=timeout_s
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_latency_reads_everything(live):
    report = json.loads(run(live, EXAMPLES / "latency.py", "field", "--seconds", "1"))
    assert report["latency"]["count"] > 100
    report = json.loads(run(live, EXAMPLES / "latency.py", "whatif", "--seconds", "1"))
    assert report["latency"]["count"] > 100


def test_the_force_plot_draws(live, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed; pip install softtwin[plot]")
    picture = tmp_path / "force.png"
    run(live, EXAMPLES / "live_force.py", "--seconds", "1", "--save", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_python_controller_holds_the_force(stage):
    model = REPOSITORY / "models/pneunet/pneunet.twin"
    scene = stage.scene(f'name = "force"\n[[actuator]]\nname = "finger"\nmodel = "{model}"\n')
    stage.twin(scene)
    plant = stage.start("softtwin-studies", "plant", "--scene", str(scene), "--seconds", "4", "--target-n", "0.3")
    said = json.loads(run(stage, EXAMPLES / "hold_force.py", "--target-n", "0.3", "--seconds", "30", "--json"))
    assert plant.wait(PATIENCE_S) == 0
    truth = json.loads((stage.folder / "1.log").read_text().splitlines()[-1])
    response = truth["response"]
    assert response["settling_s"] is not None, truth
    assert response["overshoot"] < 0.4 and abs(response["final_error"]) < 0.05, truth
    assert said["feed_forward_mpa"] > 0.01
    sys.stdout.write(json.dumps({"plant": truth, "controller": said}) + "\n")


@pytest.mark.parametrize("number", range(5))
def test_programs_of_the_documentation_run(live, number, tmp_path):
    pages = [(REPOSITORY / page).read_text() for page in ("docs/clients/python.md", "README.md")]
    programs = [program for page in pages for program in re.findall(r"```python\n(.*?)```", page, re.S)]
    assert len(programs) == 5, "four of the client's document, one of README.md"
    path = tmp_path / f"program{number}.py"
    path.write_text(programs[number])
    if "SensorPublisher" in programs[number]:
        live.stop(live.programs[1])  # the bridge: the program replaces it
    assert run(live, path).strip(), "it prints something"
