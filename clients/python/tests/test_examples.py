"""The example programs and those of docs/clients run."""

import importlib.util
import json
import pathlib
import re
import shutil
import subprocess
import sys

import pytest
import softtwin
from conftest import PATIENCE_S, REPOSITORY

EXAMPLES = pathlib.Path(__file__).resolve().parents[1] / "examples"


def run(stage, *arguments, timeout_s=PATIENCE_S, folder=None):
    environment = dict(stage.environment(), MPLBACKEND="agg", PYTHONPATH=str(pathlib.Path(softtwin.__file__).parents[1]))
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout_s, cwd=folder)
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


VALVE = """
    [actuator.valve]
    range_mpa = {range_mpa}
    rate_mpa_per_s = 0.5
    force_max_n = 0.6
    [actuator.valve.iio]
    device = "iio:device0"
    scale = 2e-5
    raw_max = 65535
"""


def force_scene(stage, range_mpa):
    """Scene with a valve beside a model given relative to the scene's folder."""
    shutil.copy(REPOSITORY / "models/pneunet/pneunet.twin", stage.folder / "pneunet.twin")
    valve = VALVE.format(range_mpa=range_mpa)
    return stage.scene(f'name = "force"\n[[actuator]]\nname = "finger"\nmodel = "pneunet.twin"\n{valve}')


def test_a_python_controller_holds_the_force(stage):
    scene = force_scene(stage, [0.0, 0.09])
    stage.twin(scene)
    plant = stage.start("softtwin-studies", "plant", "--scene", str(scene), "--seconds", "4", "--target-n", "0.3")
    said = json.loads(run(stage, EXAMPLES / "hold_force.py", "--scene", scene, "--target-n", "0.3", "--seconds", "30", "--json"))
    assert plant.wait(PATIENCE_S) == 0
    truth = json.loads((stage.folder / "1.log").read_text().splitlines()[-1])
    response = truth["response"]
    assert response["settling_s"] is not None, truth
    assert response["overshoot"] < 0.4 and abs(response["final_error"]) < 0.05, truth
    assert said["feed_forward_mpa"] > 0.01
    sys.stdout.write(json.dumps({"plant": truth, "controller": said}) + "\n")


@pytest.mark.parametrize("range_mpa, target_n", [([0.0, 0.03], 0.3), ([0.0, 0.09], 0.7)])
def test_a_force_beyond_the_limits_of_the_scene_is_refused(stage, range_mpa, target_n):
    scene = force_scene(stage, range_mpa)
    stage.twin(scene)
    plant = stage.start("softtwin-studies", "plant", "--scene", str(scene), "--seconds", "60")
    arguments = [sys.executable, EXAMPLES / "hold_force.py", "--scene", scene, "--target-n", str(target_n)]
    refused = subprocess.run(arguments, env=stage.environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert refused.returncode == 1 and "the scene" in refused.stderr, refused
    stage.stop(plant)
    setpoints = json.loads((stage.folder / "1.log").read_text().split("\n", 1)[1])["commands"]
    assert setpoints <= 1, "at most its release"


def test_the_controller_keeps_to_range_and_rate_of_the_scene(stage):
    specification = importlib.util.spec_from_file_location("hold_force", EXAMPLES / "hold_force.py")
    hold_force = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(hold_force)
    limits = hold_force.limits(force_scene(stage, [0.01, 0.05]))
    assert (limits.actuator, limits.range_mpa, limits.rate_mpa_per_s, limits.force_max_n) == ("finger", (0.01, 0.05), 0.5, 0.6)
    controller = hold_force.Controller(0.3, 0.04, limits)
    sent = [controller.update(0.0, 5.0, 0.0, 0.01) for _ in range(100)]
    assert sent[0] == 0.01 and max(sent) == 0.05
    assert max(after - before for before, after in zip(sent, sent[1:])) <= 0.5 * 0.01 + 1e-12
    # The integral did not grow behind the limit: the first force beyond the target lowers the pressure at once.
    assert controller.update(0.31, 5.0, 0.05, 0.01) < 0.05
    free = stage.scene('name = "force"\n[[actuator]]\nname = "finger"\nmodel = "pneunet.twin"\n')
    assert hold_force.limits(free, "finger").range_mpa[1] == pytest.approx(0.09, abs=0.02)
    with pytest.raises(SystemExit):
        hold_force.limits(free, "other")


def programs_of(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.S)


def test_programs_of_every_document_are_python():
    pages = [*REPOSITORY.glob("*.md"), *REPOSITORY.glob("docs/**/*.md"), *REPOSITORY.glob("examples/**/*.md")]
    programs = [(page, program) for page in pages for program in programs_of(page)]
    for page, program in programs:
        compile(program, str(page), "exec")
    assert len(programs) >= 12


@pytest.mark.parametrize("number", range(10))
def test_programs_of_the_documentation_run(live, number, tmp_path):
    python, readme, ideas = (programs_of(REPOSITORY / page) for page in ("docs/clients/python.md", "README.md", "docs/ideas.md"))
    programs = [*python, *readme, "\n".join(ideas)]  # those of the ideas go on from one to the next
    assert len(programs) == 10, "eight of the client's document, one of README.md, one of the ideas"
    for needed in ("matplotlib", "gmsh", "meshio"):
        if f"import {needed}" in programs[number] or (needed == "matplotlib" and ".plot()" in programs[number]):
            pytest.importorskip(needed, reason=f"{needed} is not installed; pip install {needed}")
    path = tmp_path / f"program{number}.py"
    path.write_text(programs[number])
    if "SensorPublisher" in programs[number]:
        live.stop(live.programs[1])  # the bridge: the program replaces it
    (tmp_path / "benchmarks").symlink_to(REPOSITORY / "benchmarks")
    assert run(live, path, timeout_s=300, folder=tmp_path).strip(), "it prints something"
