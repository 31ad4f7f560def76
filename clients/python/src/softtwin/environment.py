"""Gymnasium environments: hold a contact force by commanding pressure, on a model and a simulated plant, one finger or many at once.

    import gymnasium, softtwin, softtwin.environment
    model = softtwin.shared_file("models/pneunet/pneunet.twin")
    env = gymnasium.make("softtwin/HoldForce-v0", model=model)
    many = gymnasium.make_vec("softtwin/HoldForce-v0", num_envs=1024, vectorization_mode="vector_entry_point", model=model)

The plant is that of docs/control.md: a delay, a first-order lag, the model's force at a gap that the learner does not know, gauge
and load cell with noise.
"""

import math
import os
from typing import Any, Dict, Optional, Tuple

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector.utils import batch_space

from .model import Model

Array = npt.NDArray[Any]


class _Plant:
    """`count` fingers with their valves: each quantity is an array over the fingers."""

    def __init__(
        self,
        count: int,
        model: "Model | os.PathLike[str] | str",
        *,
        gap_mm: Tuple[float, float] = (27.0, 33.0),
        step_s: float = 0.02,
        steps: int = 250,
        tau_s: float = 0.08,
        delay_s: float = 0.02,
        gauge_noise_mpa: float = 2e-4,
        cell_noise_n: float = 2e-3,
    ) -> None:
        self.model = model if isinstance(model, Model) else Model(model)
        absent = [name for name in ("pressure_mpa", "gap_mm") if not np.isfinite(self.model.inputs[name].max)]
        if absent:
            raise ValueError(f"this environment needs a model of pressure and gap; this one was not trained over {', '.join(absent)}")
        known = self.model.inputs["gap_mm"]
        if not known.min <= gap_mm[0] <= gap_mm[1] <= known.max:
            raise ValueError(f"gap_mm: expected two gaps from {known.min} to {known.max} mm, the smaller first, found {gap_mm}")
        if not (step_s > 0 and tau_s > 0 and delay_s >= 0 and steps > 0):
            raise ValueError("step_s, tau_s and steps must be positive, delay_s not negative")
        self.count, self.steps, self.step = count, steps, 0
        self.supply_mpa = self.model.inputs["pressure_mpa"].max
        self._gaps_mm = gap_mm
        self._keep = math.exp(-step_s / tau_s)
        self._delay = round(delay_s / step_s)
        self._noise = np.array([cell_noise_n, gauge_noise_mpa])
        self.largest_force_n = float(self._force(self.supply_mpa, gap_mm[1]))
        if not self.largest_force_n > 0:
            raise ValueError(f"the model has no contact at {gap_mm[1]} mm and {self.supply_mpa} MPa; choose smaller gaps")
        self.state: Optional[Dict[str, Array]] = None

    def reset(self, random: np.random.Generator, options: Optional[Dict[str, Any]]) -> None:
        """Fingers at rest; `options` may give `force_n` and `gap_mm`, one for all or one for each."""
        given = dict(options or {})
        drawn = {"force_n": random.uniform(0.1, 0.8, self.count) * self.largest_force_n, "gap_mm": random.uniform(*self._gaps_mm, self.count)}
        wanted_n, gap_mm = (np.broadcast_to(np.asarray(given.pop(name, drawn[name]), np.float64), (self.count,)) for name in drawn)
        if given:
            raise ValueError(f"options: expected force_n and gap_mm, found {', '.join(given)}")
        if not ((wanted_n > 0).all() and np.isfinite(wanted_n).all() and np.isfinite(gap_mm).all()):
            raise ValueError(f"options: expected a positive force_n and a finite gap_mm, found {wanted_n} and {gap_mm}")
        rest = np.zeros(self.count)
        self.step = 0
        self.state = {"wanted_n": wanted_n, "gap_mm": gap_mm, "pressure_mpa": rest, "command_mpa": rest, "force_n": self._force(rest, gap_mm)}
        self._under_way = [rest] * self._delay

    def advance(self, action: Any) -> Array:
        """Commands a pressure for one step; gives the rewards."""
        state = self.state
        if state is None:
            raise RuntimeError("call reset before step")
        share = np.asarray(action, np.float64)
        if share.shape != (self.count, 1) or not (np.abs(share) <= 1.0).all():
            raise ValueError(f"action: expected a number from -1 to 1 for each finger, found {action}")
        command_mpa = 0.5 * (share[:, 0] + 1.0) * self.supply_mpa
        self._under_way.append(command_mpa)
        wanted_mpa = self._under_way.pop(0)
        state["pressure_mpa"] = wanted_mpa + (state["pressure_mpa"] - wanted_mpa) * self._keep
        state["force_n"] = self._force(state["pressure_mpa"], state["gap_mm"])
        change = np.abs(command_mpa - state["command_mpa"]) / self.supply_mpa
        state["command_mpa"] = command_mpa
        self.step += 1
        reward: Array = -np.abs(state["force_n"] - state["wanted_n"]) / state["wanted_n"] - 0.01 * change
        return reward

    def observe(self, random: np.random.Generator) -> Array:
        """Wanted force, load cell, gauge and command of each finger."""
        state = self.state
        assert state is not None
        cell, gauge = random.normal(0.0, 1.0, (self.count, 2)).T * self._noise[:, None]
        forces = np.array([state["wanted_n"], state["force_n"] + cell]) / self.largest_force_n
        pressures = np.array([state["pressure_mpa"] + gauge, state["command_mpa"]]) / self.supply_mpa
        return np.concatenate([forces, pressures]).T.astype(np.float32)

    def _force(self, pressure_mpa: Any, gap_mm: Any) -> Any:
        return self.model.predict(pressure_mpa, gap_mm, fields=False, observables=False).contact_force_n


_ACTIONS = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
_OBSERVATIONS = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)


class HoldForce(gymnasium.Env):  # type: ignore[type-arg]
    """Observed: wanted force, load cell (N), gauge, command (MPa), as fractions of the largest force and of the supply.

    The action, -1 .. 1, is the commanded pressure from 0 to the supply. The reward is minus the force's error as a fraction of the wanted
    force, minus 0.01 times the command's change. An episode has `steps` steps of `step_s`; wanted force and gap are drawn for each,
    or given by `reset(options={"force_n": 0.3, "gap_mm": 30.0})`. The truth is in the info.
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(self, model: "Model | os.PathLike[str] | str", **plant: Any) -> None:
        self._plant = _Plant(1, model, **plant)
        self.model, self.supply_mpa = self._plant.model, self._plant.supply_mpa
        #: The largest force that the widest gap allows, N.
        self.largest_force_n = self._plant.largest_force_n
        self.action_space, self.observation_space = _ACTIONS, _OBSERVATIONS

    def reset(self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None) -> "Tuple[Array, Dict[str, float]]":
        """A finger at rest."""
        super().reset(seed=seed)
        self._plant.reset(self.np_random, options)
        return self._plant.observe(self.np_random)[0], self._info()

    def step(self, action: Any) -> "Tuple[Array, float, bool, bool, Dict[str, float]]":
        """Commands a pressure for one step."""
        reward = self._plant.advance(np.reshape(action, (1, -1)))
        return self._plant.observe(self.np_random)[0], float(reward[0]), False, self._plant.step >= self._plant.steps, self._info()

    def _info(self) -> Dict[str, float]:
        return {**{name: float(values[0]) for name, values in (self._plant.state or {}).items()}, "step": self._plant.step}


class HoldForces(gymnasium.vector.VectorEnv):  # type: ignore[type-arg]
    """`num_envs` fingers as `HoldForce`, each with its own wanted force and gap, in one call per step.

    All episodes end at the same step; the next one begins them again.
    """

    metadata: Dict[str, Any] = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(self, model: "Model | os.PathLike[str] | str", num_envs: int = 1024, **plant: Any) -> None:
        self.num_envs = num_envs
        self._plant = _Plant(num_envs, model, **plant)
        self.single_action_space, self.single_observation_space = _ACTIONS, _OBSERVATIONS
        self.action_space, self.observation_space = batch_space(_ACTIONS, num_envs), batch_space(_OBSERVATIONS, num_envs)

    def reset(self, *, seed: Any = None, options: Optional[Dict[str, Any]] = None) -> "Tuple[Array, Dict[str, Any]]":
        """Fingers at rest."""
        super().reset(seed=seed)
        self._plant.reset(self.np_random, options)
        return self._plant.observe(self.np_random), dict(self._plant.state or {})

    def step(self, actions: Any) -> "Tuple[Array, Array, Array, Array, Dict[str, Any]]":
        """Commands pressures for one step, or begins the next episodes."""
        plant, never = self._plant, np.zeros(self.num_envs, bool)
        if plant.state is not None and plant.step >= plant.steps:
            plant.reset(self.np_random, None)
            return plant.observe(self.np_random), np.zeros(self.num_envs), never, never, dict(plant.state)
        reward = plant.advance(actions)
        ended = np.full(self.num_envs, plant.step >= plant.steps)
        return plant.observe(self.np_random), reward, never, ended, dict(plant.state or {})


gymnasium.register(
    id="softtwin/HoldForce-v0",
    entry_point="softtwin.environment:HoldForce",
    vector_entry_point="softtwin.environment:HoldForces",
)
