"""A model as a pure function of jax arrays: `softtwin.Model("finger.twin").jax()`.

The function can be differentiated, compiled and mapped over states. A session's step is a function of the past and the reading, and can be
scanned along a run. Without jax: `Model.predict` and `Model.session`, which are faster for single states.
"""

from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, Tuple

import numpy as np

from .equations import GAP, PRESSURE, Array, Equations, LearnedMap, Values, bracketed, root

if TYPE_CHECKING:
    from .model import Model

State = Dict[str, Any]
_ATMOSPHERE_MPA, _LAMINAR = 0.101325, 0.99
_MAX_STEPS = 1000  # of neurons between two readings
_INNER, _FLOW, _MAX_INNER = 0.25, 0.2, 64  # inner steps: share of the shortest creep and of an orifice's time, most of them


class _Jax:
    """`jax.numpy`, with the two loops that the equations need."""

    def __init__(self) -> None:
        try:
            import jax
        except ImportError as error:
            raise ImportError("Model.jax needs jax, which is not installed: pip install softtwin[jax]") from error
        if jax.numpy.asarray(0.0).dtype != np.float64:
            raise ValueError('a model\'s sums need 64 bits; first call jax.config.update("jax_enable_x64", True)')
        self.jax, self.jnp = jax, jax.numpy

    def __getattr__(self, name: str) -> Any:
        return getattr(self.jnp, name)

    def repeat(self, count: int, body: Callable[[Any, Any], Any], start: Any) -> Any:
        return self.jax.lax.fori_loop(0, count, body, start)

    def solve(self, residual: Callable[[Array, Values], Array], low: Array, high: Array, given: Values) -> Array:
        """A zero between two values. Its derivatives are those of one step of Newton's method from there."""
        fixed = self.jax.lax.stop_gradient((low, high, given))
        found = bracketed(self, residual, *fixed)
        slope = self.jax.jvp(lambda p: residual(p, fixed[2]), (found,), (self.jnp.ones_like(found),))[1]
        return found - residual(found, given) / self.jnp.where(slope == 0.0, 1.0, slope)


class Differentiable:
    """A model's equations in jax. Arguments and results are dicts by name, of numbers or of arrays with the shape of the states."""

    def __init__(self, model: "Model", fields: bool = True, play_width: float = 0.0) -> None:
        self.model, self.play_width = model, play_width
        self._xp = _Jax()
        self._equations = Equations(self._xp, model, fields)
        self._compiled = self._xp.jax.jit(self._answer)
        self._memory = {of["input"]: of for of in (self._equations.small["memory"] or {"inputs": []})["inputs"]}

    def __call__(self, inputs: Mapping[str, Any]) -> Dict[str, Any]:
        """The answer at rest: numbers with the names of `Model.columns`, observables and fields by name, these with one more axis, the nodes.

        Inputs are those of `Model.predict`; one that is left out has the model's value. As there, the numbers follow the trained states a
        little beyond their range without half-widths (NaN), and are NaN farther out. Unlike there, a shape that the body cannot have is not found out.
        """
        return dict(self._compiled(self._values(inputs)))

    def _values(self, inputs: Mapping[str, Any]) -> Values:
        """All inputs by position, of one shape; infinite gap where none is given."""
        given = {self.model._position[self.model._name(name)]: value for name, value in inputs.items()}
        if "pressure_mpa" in self.model.inputs and PRESSURE not in given:
            raise TypeError("pressure_mpa: expected a pressure, since the model was trained over pressures; found none")
        defaults = [spec["value"] for spec in self._equations.header["inputs"]]
        defaults[PRESSURE], defaults[GAP] = 0.0, np.inf
        return [*self._xp.broadcast_arrays(*(self._xp.asarray(given.get(at, default), float) for at, default in enumerate(defaults)))]

    def _answer(self, values: Values, learned: Any = None) -> Dict[str, Any]:
        found = self._equations.answer([value[..., None] for value in values], learned)
        return {name: value if name in self._equations.published else value[..., 0] for name, value in found.items()}

    def _check(self) -> None:
        if self._equations.small["has_inertia"]:
            raise ValueError("a body with inertia moves by time steps of its own, which this function does not have; use Model.session")

    def rest(self, inputs: Mapping[str, Any]) -> State:
        """The past of a model that has been under these inputs for long: where a session begins."""
        self._check()
        values = self._values(inputs)
        if self._equations.learned:
            scaled, lags, neurons = self._equations.learned.settled([value[..., None] for value in values])
            return {"inputs": scaled, "lags": lags, "neurons": neurons, "since_ns": self._xp.zeros((), int)}
        names = {at: name for name, at in self.model._position.items()}
        return {names[at]: self._channel_at_rest(of, values[at]) for at, of in self._memory.items()}

    def step(self, past: State, inputs: Mapping[str, Any], dt_s: Any) -> Tuple[State, Dict[str, Any]]:
        """The past and the answer `dt_s` seconds (above 0) later, the inputs having gone straight to these.

        A `dt_s` that is a plain number saves inner steps of creep. Half-widths are those of a known past.
        """
        self._check()
        values = self._values(inputs)
        if self._equations.learned:
            return self._learned_step(self._equations.learned, past, values, dt_s)
        spec, now = self._equations.small["memory"], {}
        names = {at: name for name, at in self.model._position.items()}
        for at, of in self._memory.items():
            now[names[at]] = self._channel_step(of, past[names[at]], values[at], dt_s, spec["max_gap_s"])
            values[at] = self._output(of, now[names[at]])
        return now, self._answer(values)

    def _learned_step(self, learned: LearnedMap, past: State, values: Values, dt_s: Any) -> Tuple[State, Dict[str, Any]]:
        xp, inputs = self._xp, learned.scale([value[..., None] for value in values])
        start, end = past["inputs"], xp.where(dt_s > (learned.of["max_gap_s"] or np.inf), past["inputs"], inputs)
        lags = []
        for at, lag in enumerate(learned.of["lags"]):
            k, line = lag["input"], lag["line"]
            lags.append(self._line(line["fill_s"], line["empty_s"], past["lags"][..., at], start[..., k], end[..., k], dt_s)[0] if line else inputs[..., k])
        now = {"inputs": inputs, "lags": xp.stack(lags, axis=-1), "neurons": past["neurons"], "since_ns": past["since_ns"]}
        if not past["neurons"]:
            return now, self._answer(values, (inputs, now["lags"], []))
        if not isinstance(dt_s, (int, float)):
            raise TypeError("dt_s: expected a plain number, since the neurons of this model step by a clock of their own")
        # Steps of the neurons since the first reading; what is left of the time brings them forward for the answer alone.
        passed_ns, step_ns, since_ns = round(1e9 * dt_s), learned.of["step_ns"], past["since_ns"]
        due = (since_ns + passed_ns) // step_ns
        count = xp.minimum(due, _MAX_STEPS)
        length_ns = due * step_ns / xp.maximum(count, 1)
        now["since_ns"] = (since_ns + passed_ns) % step_ns
        forward = []
        for at, of in enumerate(learned.of["reservoirs"]):
            times_s = xp.asarray(of["times_s"])

            def moved(x: Array, inputs: Array, ns: Array, of: Any = of, times_s: Array = times_s) -> Array:
                return x - xp.expm1(-1e-9 * ns / times_s) * (learned.target(of, inputs)(x) - x)

            def step(k: Any, x: Array, moved: Any = moved) -> Array:
                share = ((k + 1) * length_ns - since_ns) / passed_ns
                return xp.where(k < count, moved(x, start + share * (end - start), length_ns), x)

            stepped = xp.repeat(min(passed_ns // step_ns + 1, _MAX_STEPS), step, past["neurons"][at])
            now["neurons"] = [*now["neurons"][:at], stepped, *now["neurons"][at + 1 :]]
            forward.append(moved(stepped, inputs, now["since_ns"]))
        return now, self._answer(values, (inputs, now["lags"], forward))

    def _line(self, fill_s: Any, empty_s: Any, output: Array, start: Array, to: Array, dt_s: Any) -> Tuple[Array, Array, Array]:
        """Output of a lag after a step, and time and value of its turn within it; the turn is at the end where there is none."""
        xp = self._xp
        slope, excess = (to - start) / dt_s, output - start
        empties = (excess > 0.0) | ((excess == 0.0) & (slope < 0.0))
        first_s, second_s = xp.where(empties, empty_s, fill_s), xp.where(empties, fill_s, empty_s)
        end = excess * xp.exp(-dt_s / first_s) + slope * first_s * xp.expm1(-dt_s / first_s)
        turns = (excess != 0.0) & (end * excess < 0.0)
        ratio = excess / xp.where(turns, slope * first_s, 1.0)
        after_s = xp.where(turns, xp.clip(first_s * xp.log1p(xp.where(turns, ratio, 0.0)), 0.0, dt_s), dt_s)
        turned = slope * second_s * xp.expm1(-(dt_s - after_s) / second_s)
        return to + xp.where(turns, turned, end), after_s, xp.where(turns, start + slope * after_s, to + end)

    def _orifice_lag_s(self, of: Dict[str, float], cavity: Array, given: Array) -> Array:
        xp, time_s, critical = self._xp, of["time_s"], of["critical_ratio"]

        def flow(ratio: Any) -> Any:
            return root(xp, 1.0 - (xp.maximum(ratio - critical, 0.0) / (1.0 - critical)) ** 2)

        up, down = xp.maximum(cavity, given) + _ATMOSPHERE_MPA, xp.minimum(cavity, given) + _ATMOSPHERE_MPA
        is_laminar = (up <= 0.0) | (down >= _LAMINAR * up)
        ratio = xp.where(is_laminar, 0.5, down / xp.where(is_laminar, 1.0, up))
        return xp.where(is_laminar, time_s * (1.0 - _LAMINAR) / flow(_LAMINAR), time_s * (1.0 - ratio) / flow(ratio))

    def _channel_at_rest(self, of: Dict[str, Any], value: Array) -> State:
        return {"input": value, "line": value, "plays": [value] * len(of["play"]), "after_play": value, "creeps": [value] * len(of["creep"])}

    def _output(self, of: Dict[str, Any], state: State) -> Array:
        late = zip(of["creep"], state["creeps"])
        return state["after_play"] + sum(creep["weight"] * (z - state["after_play"]) for creep, z in late)

    def _above(self, a: Array, b: Array) -> Array:
        """The larger of two; within the width of the play rounded off, by at most a quarter of it."""
        larger = self._xp.maximum(a, b)
        if not self.play_width:
            return larger
        return larger + self._xp.maximum(self.play_width - self._xp.abs(a - b), 0.0) ** 2 / (4.0 * self.play_width)

    def _drive(self, of: Dict[str, Any], state: State, line: Array, dt_s: Array) -> State:
        """Play and creep follow the line, which has not turned for `dt_s`."""
        xp, before = self._xp, state["after_play"]
        plays = [self._above(line - play["threshold"], -self._above(-line - play["threshold"], -y)) for play, y in zip(of["play"], state["plays"])]
        after = line + sum(play["weight"] * (y - line) for play, y in zip(of["play"], plays))
        creeps = []
        for creep, z in zip(of["creep"], state["creeps"]):
            x = dt_s / creep["time_s"]
            lost = xp.where(x > 0.0, xp.expm1(-x) / xp.where(x > 0.0, x, 1.0), -1.0)
            creeps.append(after + (z - before) * xp.exp(-x) + (after - before) * lost)
        return {**state, "line": line, "plays": plays, "after_play": after, "creeps": creeps}

    def _channel_step(self, of: Dict[str, Any], past: State, value: Array, dt_s: Any, max_gap_s: float) -> State:
        xp, jax = self._xp, self._xp.jax
        is_gap = dt_s > max_gap_s
        to = xp.where(is_gap, past["input"], value)
        shortest = min([creep["time_s"] for creep in of["creep"]] + ([_FLOW * of["orifice"]["time_s"]] if of["orifice"] else []), default=np.inf)
        is_plain = isinstance(dt_s, (int, float))
        count = (np if is_plain else xp).clip((np if is_plain else xp).ceil(dt_s / (_INNER * shortest)), 1, _MAX_INNER)
        steps = int(count) if is_plain else _MAX_INNER if np.isfinite(shortest) else 1
        inner_s = dt_s / count

        def chosen(condition: Array, a: State, b: State) -> State:
            return jax.tree.map(lambda x, y: xp.where(condition, x, y), a, b)

        def inner(k: Any, state: State) -> State:
            now = past["input"] + (to - past["input"]) * xp.minimum((k + 1.0) / count, 1.0)
            line, start = of["line"], state["input"]
            if of["orifice"]:
                middle = 0.5 * (start + now)
                first_s = self._orifice_lag_s(of["orifice"], state["line"], start)
                half = self._line(first_s, first_s, state["line"], start, middle, 0.5 * inner_s)[0]
                lag_s = self._orifice_lag_s(of["orifice"], half, middle)
                line = {"fill_s": lag_s, "empty_s": lag_s}
            if line:
                end, after_s, turn = self._line(line["fill_s"], line["empty_s"], state["line"], start, now, inner_s)
                moved = self._drive(of, state, turn, after_s)
                moved = chosen(after_s < inner_s, self._drive(of, moved, end, inner_s - after_s), moved)
            else:
                moved = self._drive(of, state, now, inner_s)
            return chosen(k < count, {**moved, "input": now}, state)

        state = xp.repeat(steps, inner, past)
        jumped = self._drive(of, state, state["line"] if of["line"] or of["orifice"] else value, 0.0 * inner_s)
        return chosen(is_gap, {**jumped, "input": value}, state)
