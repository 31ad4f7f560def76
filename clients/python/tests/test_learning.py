"""The notebooks run; Gymnasium accepts the environment, and a controller improves its reward."""

import json
import os
import subprocess
import sys
import warnings

import gymnasium
import nbclient
import nbformat
import numpy as np
import pytest
import softtwin
import softtwin.environment
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
NOTEBOOKS = sorted((REPOSITORY / "clients/python/examples").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run_and_draw(monkeypatch, path):
    monkeypatch.setenv("SOFTTWIN_MODEL", str(MODEL))
    monkeypatch.setenv("SOFTTWIN_DATA", str(REPOSITORY / "benchmarks/data"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(REPOSITORY / "clients/python/src"), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "committed without results"
    done = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    pictures = [out for cell in done.cells for out in cell.get("outputs", []) if "image/png" in out.get("data", {})]
    assert len(pictures) == 2


@pytest.fixture
def environment():
    made = gymnasium.make("softtwin/HoldForce-v0", model=MODEL)
    yield made
    made.close()


def test_gymnasium_accepts_the_environment(environment):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(environment.unwrapped)
    found = [str(warning.message) for warning in said]
    # Readings have noise, so the observation space is unbounded.
    assert all("-infinity" in text or "infinity" in text for text in found), found


def test_the_same_seed_gives_the_same_episode(environment):
    def episode():
        seen = [environment.reset(seed=7)[0]]
        for action in np.linspace(-1.0, 1.0, 30):
            seen.append(environment.step(np.array([action], np.float32))[0])
        return np.array(seen)

    np.testing.assert_array_equal(episode(), episode())


def test_the_model_controls_its_plant(environment):
    """Pressure by the model's gradient: the force settles at the wanted force, with more reward than without control."""
    model = environment.unwrapped.model

    def total(law):
        observation, info = environment.reset(seed=3, options={"force_n": 0.3, "gap_mm": 30.0})
        rewards = []
        while True:
            observation, reward, ended, cut, info = environment.step(np.array([law(info)], np.float32))
            rewards.append(reward)
            if ended or cut:
                return sum(rewards), info

    def hold(info):
        found = model.predict(info["command_mpa"], info["gap_mm"], fields=False)
        slope = found.force_gradient["pressure_mpa"]
        goal = info["command_mpa"] + (0.3 - found.contact_force_n) / slope if slope > 0 else environment.unwrapped.supply_mpa
        return np.clip(2.0 * goal / environment.unwrapped.supply_mpa - 1.0, -1.0, 1.0)

    earned, info = total(hold)
    assert info["force_n"] == pytest.approx(0.3, abs=1e-3) and info["step"] == 250
    assert earned > 0.2 * total(lambda _: -1.0)[0]


def test_invalid_arguments_raise(environment):
    plain = environment.unwrapped
    with pytest.raises(ValueError, match="-1 to 1"):
        plain.reset()
        plain.step(np.array([2.0]))
    with pytest.raises(ValueError, match="speed"):
        plain.reset(options={"speed": 1.0})
    with pytest.raises(ValueError, match="gap_mm"):
        softtwin.environment.HoldForce(MODEL, gap_mm=(30.0, 1000.0))
    with pytest.raises(RuntimeError):
        softtwin.environment.HoldForce(MODEL).step(np.array([0.0]))



def test_many_fingers_are_single_ones_side_by_side():
    quiet = {"model": MODEL, "cell_noise_n": 0.0, "gauge_noise_mpa": 0.0, "steps": 20}
    many = gymnasium.make_vec("softtwin/HoldForce-v0", num_envs=64, vectorization_mode="vector_entry_point", **quiet)
    forces, gaps = np.linspace(0.1, 0.4, 64), np.linspace(27.0, 33.0, 64)
    seen, _ = many.reset(seed=1, options={"force_n": forces, "gap_mm": gaps})
    single = gymnasium.make("softtwin/HoldForce-v0", **quiet)
    alone, _ = single.reset(options={"force_n": forces[17], "gap_mm": gaps[17]})
    np.testing.assert_array_equal(seen[17], alone)
    for at in range(20):
        actions = np.full((64, 1), -1.0 + 0.09 * at, np.float32)
        seen, rewards, _, ended, _ = many.step(actions)
        alone, reward, _, cut, _ = single.step(actions[17])
        np.testing.assert_array_equal(seen[17], alone)
        assert rewards[17] == reward and ended[17] == cut == (at == 19)
    seen, rewards, _, ended, info = many.step(actions)
    assert not rewards.any() and not ended.any() and len(set(info["gap_mm"])) == 64, "the next episodes have begun"


def test_a_policy_is_trained_in_the_example():
    program = REPOSITORY / "clients/python/examples/train_policy.py"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "clients/python/src"), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run([sys.executable, program, "--seconds", "5", "--fingers", "256"], env=environment, capture_output=True, text=True, check=True)
    said = json.loads(done.stdout)
    assert said["reward"] > 0.5 * said["reward_untrained"], said
