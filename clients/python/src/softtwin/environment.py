"""A Gymnasium environment: hold a contact force by commanding pressure, on a model and a simulated plant.

    import gymnasium, softtwin.environment
    env = gymnasium.make("softtwin/HoldForce-v0", model="models/pneunet/pneunet.twin")

The plant is that of docs/control.md: a delay, a first-order lag, the model's force at a gap that the learner does not know, gauge
and load cell with noise.
"""

import math
import os
from collections import deque
from typing import Any, Deque, Dict, Optional, Tuple

import gymnasium
import numpy as np

from .model import Model



class HoldForce(gymnasium.Env):  # type: ignore[type-arg]
    """Observed: wanted force, load cell (N), gauge, command (MPa), as fractions of the largest force and of the supply.

    The action, -1 .. 1, is the commanded pressure from 0 to the supply. The reward is minus the force's error as a fraction of the wanted
    force, minus 0.01 times the command's change. An episode has `steps` steps of `step_s`; wanted force and gap are drawn for each,
    or given by `reset(options={"force_n": 0.3, "gap_mm": 30.0})`.
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
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
        self.supply_mpa = self.model.inputs["pressure_mpa"].max
        self._gaps_mm, self._step_s, self._steps = gap_mm, step_s, steps
        self._keep = math.exp(-step_s / tau_s)
        self._delay = round(delay_s / step_s)
        self._noise = (cell_noise_n, gauge_noise_mpa)
        #: The largest force that the widest gap allows, N.
        self.largest_force_n = self._force(self.supply_mpa, gap_mm[1])
        if not self.largest_force_n > 0:
            raise ValueError(f"the model has no contact at {gap_mm[1]} mm and {self.supply_mpa} MPa; choose smaller gaps")
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
        self._state: Optional[Dict[str, float]] = None
        self._under_way: Deque[float] = deque()

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None
    ) -> "Tuple[np.ndarray[Any, Any], Dict[str, float]]":
        """A plant at rest; `options` may give `force_n` and `gap_mm`."""
        super().reset(seed=seed)
        given = dict(options or {})
        wanted_n = float(given.pop("force_n", self.np_random.uniform(0.1, 0.8) * self.largest_force_n))
        gap_mm = float(given.pop("gap_mm", self.np_random.uniform(*self._gaps_mm)))
        if given:
            raise ValueError(f"options: expected force_n and gap_mm, found {', '.join(given)}")
        if not (wanted_n > 0 and math.isfinite(wanted_n) and math.isfinite(gap_mm)):
            raise ValueError(f"options: expected a positive force_n and a finite gap_mm, found {wanted_n} and {gap_mm}")
        self._state = {"wanted_n": wanted_n, "gap_mm": gap_mm, "pressure_mpa": 0.0, "command_mpa": 0.0, "force_n": 0.0, "step": 0}
        self._under_way = deque([0.0] * self._delay)
        self._state["force_n"] = self._force(0.0, gap_mm)
        return self._observe(self._state), dict(self._state)

    def step(self, action: Any) -> "Tuple[np.ndarray[Any, Any], float, bool, bool, Dict[str, float]]":
        """Commands a pressure for one step; the truth is in the info."""
        if self._state is None:
            raise RuntimeError("call reset before step")
        state = self._state
        share = np.asarray(action, np.float64).reshape(-1)
        if share.shape != (1,) or not -1.0 <= share[0] <= 1.0:
            raise ValueError(f"action: expected one number from -1 to 1, found {action}")
        command_mpa = 0.5 * (float(share[0]) + 1.0) * self.supply_mpa
        self._under_way.append(command_mpa)
        wanted_mpa = self._under_way.popleft()
        state["pressure_mpa"] = wanted_mpa + (state["pressure_mpa"] - wanted_mpa) * self._keep
        state["force_n"] = self._force(state["pressure_mpa"], state["gap_mm"])
        change = abs(command_mpa - state["command_mpa"]) / self.supply_mpa
        state["command_mpa"] = command_mpa
        state["step"] += 1
        reward = -abs(state["force_n"] - state["wanted_n"]) / state["wanted_n"] - 0.01 * change
        return self._observe(state), reward, False, state["step"] >= self._steps, dict(state)

    def _force(self, pressure_mpa: float, gap_mm: float) -> float:
        return float(self.model.predict(pressure_mpa, gap_mm, fields=False).contact_force_n)

    def _observe(self, state: Dict[str, float]) -> "np.ndarray[Any, Any]":
        cell, gauge = self.np_random.normal(0.0, 1.0, 2) * self._noise
        forces = np.array([state["wanted_n"], state["force_n"] + cell]) / self.largest_force_n
        pressures = np.array([state["pressure_mpa"] + gauge, state["command_mpa"]]) / self.supply_mpa
        return np.concatenate([forces, pressures]).astype(np.float32)


gymnasium.register(id="softtwin/HoldForce-v0", entry_point="softtwin.environment:HoldForce")
