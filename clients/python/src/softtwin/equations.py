"""The equations of a model over any namespace of arrays: `jax.numpy`, or the builder of an ONNX graph.

They are those of the crate `rom`, in the same order: scaled inputs, onset and regime, interpolants of the coefficients, force, fields,
observables; in front of them, for a session, line, play and creep. The parameters come from the native module, which alone knows the file.

States have any shape. Inside, every array has one more axis, the last, over which centres, coefficients and nodes run. Both regimes are
evaluated and one is taken by `where`. What is not taken is kept finite, because a gradient multiplies it by zero.
"""

import json
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

Array = Any
Values = List[Array]
PRESSURE, GAP = 0, 1
_OPEN_MM = 1e9  # a gap from which on there is no obstacle
_INSIDE, _ANSWERED = 1e-9, 1.0  # distances from the training range: inside it, and the last one with an answer
_SMOOTHING = 0.05  # of the half-widths: scaled distance within which neighbours count alike
_REST = 1e-3  # fraction of the largest pressure over which the slope of the depth at rest is taken
_GRID, _SEARCH_STEPS = 24, 10  # pressures at which the onset is looked for, and steps between two of them
_SETTLING_STEPS = 300
_BASE_ALONE = 3.0  # of a learned map: distance, in reaches, from which on its base alone answers


def root(xp: Any, square: Array) -> Array:
    """The square root, with the slope 0 at 0."""
    is_positive = square > 0.0
    return xp.where(is_positive, xp.sqrt(xp.where(is_positive, square, 1.0)), 0.0)


def _log(xp: Any, value: Array) -> Array:
    return xp.log(xp.where(value > 0.0, value, 1.0))


def _matern72(xp: Any, r2: Array, length: float) -> Tuple[Array, Array]:
    s = root(xp, 7.0 * r2) / length
    e = xp.exp(-s)
    return (1.0 + s + s * s * (0.4 + s / 15.0)) * e, -1.4 / length**2 * (1.0 + s + s * s / 3.0) * e


def _gaussian(xp: Any, r2: Array, shape: float) -> Tuple[Array, Array]:
    e = xp.exp(-(shape**2) * r2)
    return e, -2.0 * shape**2 * e


def _cubic_quintic(xp: Any, r2: Array, crossover: float) -> Tuple[Array, Array]:
    r, far = root(xp, r2), r2 / crossover**2
    return r2 * r * (1.0 - far), r * (3.0 - 5.0 * far)


#: `g(r)` and `g'(r) / r` of a squared distance and the kernel's parameter.
KERNELS: Dict[str, Callable[[Any, Array, Any], Tuple[Array, Array]]] = {
    "linear": lambda xp, r2, _: (-root(xp, r2), 0.0 * r2),
    "thin_plate": lambda xp, r2, _: (0.5 * r2 * _log(xp, r2), _log(xp, r2) + 1.0),
    "cubic": lambda xp, r2, _: (r2 * root(xp, r2), 3.0 * root(xp, r2)),
    "quintic": lambda xp, r2, _: (-r2 * r2 * root(xp, r2), -5.0 * r2 * root(xp, r2)),
    "cubic_quintic": _cubic_quintic,
    "gaussian": _gaussian,
    "matern72": _matern72,
}
TAIL_ORDERS = {"none": -1, "constant": 0, "linear": 1, "quadratic": 2}


def wendland(xp: Any, r: Array) -> Array:
    """`(1 - r)^4 (4 r + 1)`, 0 from 1 on."""
    square = xp.maximum(1.0 - r, 0.0) ** 2
    return square * square * (4.0 * r + 1.0)


def _square_distances(x: Values, points: np.ndarray) -> Array:
    """From scaled inputs to each point, over the last axis."""
    return sum((own - points[:, at]) ** 2 for at, own in enumerate(x))


def interpolant(xp: Any, of: Dict[str, Any]) -> Callable[[Values], Array]:
    """A kernel sum with its tail, over scaled inputs."""
    dimensions, outputs, shear = of["dimensions"], of["outputs"], of["metric"]["shear"]
    scale = [*of["metric"]["scale"], *[1.0] * dimensions][:dimensions]
    centres = np.reshape(of["centres"], (-1, dimensions))
    weights = np.reshape(of["weights"], (-1, outputs))
    tail = np.reshape(of["tail_weights"], (-1, outputs))
    kernel, order = of["kernel"], TAIL_ORDERS[of["tail"]]
    name, parameter = (kernel, None) if isinstance(kernel, str) else (next(iter(kernel)), *next(iter(kernel.values())).values())
    slopes = np.reshape([(slope["centre"], slope["axis"]) for slope in of["slopes"]], (-1, 2)).astype(np.int64)

    def evaluate(x: Values) -> Array:
        u = [(own + shear * x[1] if at == 0 and dimensions > 1 else own) * scale[at] for at, own in enumerate(x)]
        apart = [own - centres[:, at] for at, own in enumerate(u)]
        value, over_r = KERNELS[name](xp, sum(d * d for d in apart), parameter)
        total = value @ xp.asarray(weights[: len(centres)])
        pulled = [d * s for d, s in zip(apart, scale)]  # by the transposed metric
        if dimensions > 1:
            pulled[1] = pulled[1] + shear * pulled[0]
        for axis in np.unique(slopes[:, 1]):
            rows = np.flatnonzero(slopes[:, 1] == axis)
            total = total - xp.take(over_r * pulled[axis], slopes[rows, 0], axis=-1) @ xp.asarray(weights[len(centres) + rows])
        terms = [1.0] * (order >= 0) + u * (order >= 1)
        terms += [u[i] * u[j] for i in range(dimensions) for j in range(i, dimensions)] * (order >= 2)
        return total + sum((term * row for term, row in zip(terms, tail)), 0.0)

    return evaluate


def _table(xp: Any, at: Array, knots: np.ndarray) -> Tuple[Array, Array]:
    """Interval of a table that a value lies in, and the place in it, 0 to 1 within the table."""
    interval = xp.sum(xp.where(at >= knots[1:-1], 1, 0), axis=-1)
    low, high = (xp.take(xp.asarray(ends), interval, axis=0)[..., None] for ends in (knots[:-1], knots[1:]))
    return interval, (at - low) / (high - low)


def difference_terms(xp: Any, x: Values, of: Dict[str, Any]) -> Array:
    """Of a measured difference, by centre."""
    return wendland(xp, root(xp, _square_distances(x, np.asarray(of["centres"]))) / of["reach"])


def scale(inputs: Dict[str, Any], values: Values) -> Values:
    """To 0 .. 1 over the training range."""
    return [(values[axis["input"]] - axis["min"]) / (axis["max"] - axis["min"]) for axis in inputs["axes"]]


class Regime:
    """One regime: its inputs, coefficients, force, half-widths and training range."""

    def __init__(self, xp: Any, of: Dict[str, Any], difference: Optional[Dict[str, Any]]) -> None:
        self.xp, self.of, self.difference = xp, of, difference
        self.axes, self.constants = of["inputs"]["axes"], of["inputs"]["constants"]
        self.groups = [interpolant(xp, group["surrogate"]) for group in of["groups"] if group["surrogate"]["outputs"]]
        self.count = max((group["coefficients"]["end"] for group in of["groups"]), default=0)
        self.force = interpolant(xp, of["force"]["surrogate"]) if of["force"] else None

    def coefficients(self, x: Values, values: Values) -> Array:
        xp, far = self.xp, self.of["far_onset"]
        found = xp.concatenate([group(x) for group in self.groups], axis=-1)
        if self.difference:
            weights = np.zeros((len(self.difference["centres"]), self.count))
            weights[:, self.difference["coefficients"]] = np.reshape(self.difference["weights"], (len(weights), -1))
            found = found + difference_terms(xp, x, self.difference) @ xp.asarray(weights)
        if far:
            gaps, rows = np.asarray(far["gap_mm"]), np.reshape(far["corrections"], (-1, self.count))
            interval, share = _table(xp, xp.minimum(xp.maximum(values[GAP], gaps[0]), gaps[-1]), gaps)
            low, rise = (xp.take(xp.asarray(of), interval, axis=0) for of in (rows[:-1], np.diff(rows, axis=0)))
            found = found + low + share * rise
        return found

    def half_widths(self, x: Values) -> List[Array]:
        """Of displacement, stress and force, inside the training range."""
        xp, local, names = self.xp, self.of["local_halfwidths"], ("displacement_mm", "stress_mpa", "force_n")
        widths = [_number(self.of["halfwidths"][name]) + 0.0 * x[0] for name in names]
        if local:
            weights = (_square_distances(x, np.reshape(local["inputs"], (len(x), -1)).T) + _SMOOTHING**2) ** -2
            means = weights @ xp.asarray(np.transpose(local["errors"])) / xp.sum(weights, axis=-1)[..., None]
            least, factors = ([_number(local[part][name]) for name in names] for part in ("least", "factors"))
            widths = [factors[k] * xp.maximum(means[..., k : k + 1], least[k]) for k in range(3)]
        if self.difference:
            share = xp.max(difference_terms(xp, x, self.difference), axis=-1)[..., None]
            own = share * self.difference["residual_mm"] + (1.0 - share) * self.difference["difference_mm"]
            widths[0] = xp.sqrt(widths[0] ** 2 + own**2)
        return widths

    def distance(self, x: Values, values: Values) -> Array:
        """From the training range, over scaled inputs; 0 inside."""
        xp, (kind, domain) = self.xp, next(iter(self.of["domain"].items()))
        if kind == "Interval":
            found = xp.maximum(xp.maximum(domain[0] - x[0], x[0] - domain[1]), 0.0)
        elif kind == "Hull":
            found = self._outside_polygon(np.asarray(domain), x[0], x[1])
        else:
            operating = domain["operating"]
            found = self._outside_polygon(np.asarray(domain["corners"]), x[0], x[1] if operating > 1 else 0.0 * x[0])
            ranges = sum(xp.maximum(xp.maximum(-own, own - 1.0), 0.0) ** 2 for own in x[operating:])
            nearest = xp.min(_square_distances(x, np.reshape(domain["samples"], (-1, len(x)))), axis=-1)[..., None]
            found = xp.maximum(root(xp, found * found + ranges), root(xp, nearest) - domain["reach"])
        for of in self.constants:
            found = xp.maximum(found, xp.abs(values[of["input"]] - of["value"]) / max(abs(of["value"]), 1.0))
        return found

    def _outside_polygon(self, corners: np.ndarray, x: Array, y: Array) -> Array:
        xp, along = self.xp, np.roll(corners, -1, axis=0) - corners
        square = np.maximum((along**2).sum(axis=1), 1e-300)
        u, v = x - corners[:, 0], y - corners[:, 1]
        share = xp.minimum(xp.maximum((u * along[:, 0] + v * along[:, 1]) / square, 0.0), 1.0)
        squares = xp.min((u - share * along[:, 0]) ** 2 + (v - share * along[:, 1]) ** 2, axis=-1)
        left = xp.min(along[:, 0] * v - along[:, 1] * u, axis=-1)
        return xp.where(left >= 0.0, 0.0, root(xp, squares))[..., None] if len(corners) > 2 else root(xp, squares)[..., None]


def bracketed(xp: Any, residual: Callable[[Array, Values], Array], low: Array, high: Array, given: Values) -> Array:
    """A zero of a function of its first value between two values, by the false position of Anderson and Bjorck, which needs no slope."""

    def step(_: Any, ends: Tuple[Array, Array, Array, Array]) -> Tuple[Array, Array, Array, Array]:
        a, b, fa, fb = ends
        is_found = fb == fa
        c = xp.where(is_found, b, (a * fb - b * fa) / xp.where(is_found, 1.0, fb - fa))
        fc = residual(c, given)
        is_same_side, left = fc * fb > 0.0, 1.0 - fc / xp.where(fb == 0.0, 1.0, fb)
        return xp.where(is_same_side, a, b), c, xp.where(is_same_side, fa * xp.where(left > 0.0, left, 0.5), fb), fc

    return xp.repeat(_SEARCH_STEPS, step, (low, high, residual(low, given), residual(high, given)))[1]


class Onset:
    """The pressure at which the free body reaches the obstacle: a table over the gap, or with parameters the solution of `depth = gap`."""

    def __init__(self, xp: Any, header: Dict[str, Any], free: Optional[Regime]) -> None:
        self.xp, self.table, self.clearance, self.free = xp, header["onset"], header["clearance"], free
        if self.clearance:
            self.height = interpolant(xp, free.of["groups"][self.clearance["group"]]["surrogate"])  # type: ignore[union-attr]
            self.modes = np.reshape(self.clearance["modes"], (len(self.clearance["mean_mm"]), -1)).T

    def _depth(self, pressure: Array, values: Values) -> Array:
        """Of the lowest node of the free body, mm."""
        xp = self.xp
        heights = self.height(scale(self.free.of["inputs"], [pressure, *values[1:]])) @ xp.asarray(self.modes)  # type: ignore[union-attr]
        return -xp.min(heights + xp.asarray(self.clearance["mean_mm"]), axis=-1)[..., None]

    def _ends(self, values: Values, sag: Array) -> Tuple[Array, Array, Array]:
        """Pressures between which the body first reaches the obstacle, and the deepest that it comes: a body that curls up rises again."""
        xp, end_mpa, gap = self.xp, self.clearance["max_pressure_mpa"], values[GAP]
        h, zero = end_mpa / _GRID, 0.0 * sag

        def step(k: Any, known: Tuple[Array, Array, Array]) -> Tuple[Array, Array, Array]:
            low, top, deepest = known
            p = zero + (k + 1.0) * h
            depth = self._depth(p, values)
            is_deeper = depth > deepest
            deepest = xp.where(is_deeper, depth, deepest)
            return xp.where(deepest < gap, p, low), xp.where(is_deeper, p, top), deepest

        low, top, deepest = xp.repeat(_GRID, step, (zero, zero, sag))
        middle = xp.minimum(xp.maximum(top, h), end_mpa - h)
        before, at, behind = (self._depth(middle + step, values) for step in (-h, 0.0, h))
        bend = before - 2.0 * at + behind
        vertex = middle + 0.5 * h * (before - behind) / xp.where(bend < 0.0, bend, -1.0)
        vertex = xp.where(bend < 0.0, xp.minimum(xp.maximum(vertex, 0.0), end_mpa), top)
        depth = self._depth(vertex, values)
        is_deeper, is_between = depth > deepest, deepest >= gap
        end, reach = xp.where(is_deeper, vertex, top), xp.where(is_deeper, depth, deepest)
        return xp.where(is_between, low, xp.maximum(top - h, 0.0)), xp.where(is_between, low + h, end), reach

    def _below_sag(self, slope: Array, bend: float, gap_above_sag: Array) -> Array:
        x = self.xp.minimum(gap_above_sag, 0.0)
        return slope * (self.xp.expm1(bend * x) / bend if bend else x)

    def pressure(self, values: Values) -> Tuple[Array, Array, Array]:
        """Onset pressure, continued below the sag; whether the weight alone closes the gap; whether the gap is within reach."""
        xp, gap = self.xp, values[GAP]
        if self.clearance:
            zero, end_mpa = 0.0 * gap, self.clearance["max_pressure_mpa"]
            sag = self._depth(zero, values)
            slope = _REST * end_mpa / (self._depth(zero + _REST * end_mpa, values) - sag)
            low, high, reach = self._ends(values, sag)
            wanted = xp.minimum(xp.maximum(gap, sag), reach)
            found = xp.solve(lambda p, given: self._depth(p, given[1:]) - given[0], low, high, [wanted, *values])
            low = self._below_sag(slope, self.clearance["bend_per_mm"], gap - sag)
        else:
            gaps, pressures, slopes = (np.asarray(self.table[name]) for name in ("gap_mm", "pressure_mpa", "slope"))
            sag, reach = gaps[0], gaps[-1]
            interval, t = _table(xp, xp.minimum(xp.maximum(gap, sag), reach), gaps)
            widths = np.diff(gaps)
            m0, m1, rise = slopes[:-1] * widths, slopes[1:] * widths, np.diff(pressures)
            a, b, m0, p0 = (xp.take(xp.asarray(of), interval, axis=0)[..., None] for of in (m0 + m1 - 2.0 * rise, 3.0 * rise - 2.0 * m0 - m1, m0, pressures[:-1]))
            found = ((a * t + b) * t + m0) * t + p0
            low = pressures[0] + self._below_sag(slopes[0], self.table["bend_per_mm"], gap - sag)
        return xp.where(gap <= sag, low, found), gap <= sag, gap <= reach


class LearnedMap:
    """A model of measurements: members over lagged inputs, faded into a linear base where training has not been."""

    def __init__(self, xp: Any, of: Dict[str, Any]) -> None:
        self.xp, self.of, self.outputs = xp, of, len(of["widths"])
        self.sources = np.asarray([lag["input"] for lag in of["lags"]], np.int64)

    def scale(self, values: Values) -> Array:
        return self.xp.concatenate([(values[of["input"]] - of["mean"]) / of["deviation"] for of in self.of["inputs"]], axis=-1)

    def settled(self, values: Values) -> Tuple[Array, Array, List[Array]]:
        """Standardised inputs, lags and neurons under inputs that have been there for long."""
        xp, inputs = self.xp, self.scale(values)
        neurons = []
        for of in self.of["reservoirs"]:
            target = self.target(of, inputs)
            rest = inputs @ xp.asarray(np.zeros((len(self.of["inputs"]), len(of["times_s"]))))
            neurons.append(xp.repeat(_SETTLING_STEPS, lambda _, x, target=target: x + 0.5 * (target(x) - x), rest))
        return inputs, xp.take(inputs, self.sources, axis=-1), neurons

    def target(self, of: Dict[str, Any], inputs: Array) -> Callable[[Array], Array]:
        """What the neurons of a reservoir tend to under inputs."""
        count = len(of["times_s"])
        drive, starts = np.reshape(of["drive"], (count, -1)), np.asarray(of["starts"])
        feeds = np.zeros((count, count))
        np.add.at(feeds, (np.asarray(of["sources"], np.int64), np.repeat(np.arange(count), np.diff(starts))), of["strengths"])
        driven = inputs @ self.xp.asarray(drive[:, 1:].T) + self.xp.asarray(drive[:, 0])
        return lambda x: self.xp.tanh(driven + x @ self.xp.asarray(feeds))

    def _weights(self, of: Dict[str, Any]) -> Array:
        return self.xp.asarray(np.reshape(of["weights"], (-1, self.outputs)))

    def _linear(self, lags: Array, of: Sequence[int], weights: np.ndarray) -> Array:
        xp = self.xp
        return xp.take(lags, np.asarray(of, np.int64), axis=-1) @ xp.asarray(weights[1:]) + xp.asarray(weights[0])

    def _members(self, inputs: Array, lags: Array, neurons: List[Array]) -> List[Tuple[float, Array]]:
        xp, members = self.xp, []
        for of in self.of["polynomials"]:
            own, (i, j) = np.asarray(of["lags"], np.int64), np.triu_indices(len(of["lags"]))
            v, weights = xp.take(lags, own, axis=-1), np.reshape(of["weights"], (-1, self.outputs))
            parts = [v, xp.take(v, i, axis=-1) * xp.take(v, j, axis=-1), v * v * v][: of["degree"]]
            value, at = xp.asarray(weights[0]), 1
            for part, terms in zip(parts, (len(own), len(i), len(own))):
                value, at = value + part @ xp.asarray(weights[at : at + terms]), at + terms
            members.append((of["share"], value))
        for of in self.of["kernels"]:
            width = len(of["lags"])
            places = [lags[..., lag : lag + 1] for lag in of["lags"]]
            r = root(xp, _square_distances(places, np.reshape(of["centres"], (-1, width))))
            for kernel in of["maps"]:
                weights = np.reshape(kernel["weights"], (-1, self.outputs))
                value = wendland(xp, r / (kernel["radius"] * np.sqrt(width))) @ xp.asarray(weights[1 + width :])
                members.append((kernel["share"], value + self._linear(lags, of["lags"], weights[: 1 + width])))
        for of, x in zip(self.of["reservoirs"], neurons):
            weights = np.reshape(of["weights"], (-1, self.outputs))
            value = xp.concatenate([inputs, x], axis=-1) @ xp.asarray(weights[1:]) + xp.asarray(weights[0])
            members.append((of["share"], value))
        return members

    def answer(self, inputs: Array, lags: Array, neurons: List[Array]) -> Tuple[Array, Array, Array]:
        """Outputs, distance beyond the training, and the half-width of the widest marker."""
        xp, support = self.xp, self.of["support"]
        rows = np.reshape(support["rows"], (-1, len(support["lags"])))
        distance = root(xp, xp.min(_square_distances([lags[..., lag : lag + 1] for lag in support["lags"]], rows), axis=-1))[..., None]
        beyond = xp.maximum(distance - support["reach"], 0.0)
        x = xp.minimum(beyond / ((_BASE_ALONE - 1.0) * support["reach"]), 1.0)
        gate = 1.0 - x * x * (3.0 - 2.0 * x)
        base = self._linear(lags, self.of["base"]["lags"], np.reshape(self.of["base"]["weights"], (-1, self.outputs)))
        members = self._members(inputs, lags, neurons)
        mean = sum((share * value for share, value in members), 0.0 * base)
        variance = sum((share * (value - mean) ** 2 for share, value in members), 0.0 * base)
        far = xp.minimum(distance, _BASE_ALONE * support["reach"])
        noise, spread, by_distance, allowance, of_base, growth, limit = (
            xp.asarray(np.asarray([width[name] for width in self.of["widths"]], float))
            for name in ("noise", "spread", "distance", "allowance", "base", "growth", "range")
        )
        squares = noise + spread * variance * gate * gate + by_distance * far * far + allowance
        width = root(xp, squares) + (1.0 - gate) * of_base + growth * beyond
        squares = xp.where(width < limit, width * width, np.nan)
        widest = np.nan * distance
        for at, marker in enumerate(self.of["markers"]):
            own = xp.sqrt(xp.sum(xp.take(squares, np.asarray(marker, np.int64), axis=-1), axis=-1)[..., None])
            widest = xp.maximum(widest, own) if at else own
        return base + gate * (mean - base), beyond / support["extent"], widest


def _number(value: Optional[float]) -> float:
    """JSON has no NaN."""
    return np.nan if value is None else value


class Observables:
    """Quantities of the deformed shape."""

    def __init__(self, xp: Any, of: Dict[str, Any], counts: Dict[str, int]) -> None:
        self.xp, self.items, self.corrections = xp, of["items"], of["corrections"]
        self.rows = {own["kind"]: self._rows(own["rows"], counts[own["kind"]]) for own in of["regimes"]}
        self.volumes = {own["kind"]: own["volumes"] for own in of["regimes"]}

    @staticmethod
    def _rows(rows: List[Dict[str, Any]], count: int) -> Tuple[np.ndarray, np.ndarray]:
        weights = np.zeros((count, len(rows)))
        for at, row in enumerate(rows):
            weights[row["first"] : row["first"] + len(row["weights"]), at] = row["weights"]
        return weights, np.asarray([row["mean"] for row in rows])

    def points(self, kind: str, coefficients: Array) -> Array:
        """Coordinates of the points, one after the other."""
        weights, mean = self.rows[kind]
        return coefficients @ self.xp.asarray(weights) + self.xp.asarray(mean)

    def volume(self, kind: str, coefficients: Array, at: int) -> Array:
        """`sum_ijk t_ijk a_i b_j c_k` of the coefficients of x, y and z after a leading 1."""
        xp, form = self.xp, self.volumes[kind][at]
        one = 0.0 * coefficients[..., :1] + 1.0
        a, b, c = (xp.concatenate([one, coefficients[..., first : first + own]], axis=-1) for first, own in form["axes"])
        sizes = [own + 1 for _, own in form["axes"]]
        j, k = (index.ravel() for index in np.indices(sizes[1:]))
        products = xp.take(b, j, axis=-1) * xp.take(c, k, axis=-1)
        return xp.sum((a @ xp.asarray(np.reshape(form["numbers"], (sizes[0], -1)))) * products, axis=-1)[..., None]

    def measure(self, item: Dict[str, Any], points: Array) -> Array:
        xp, (first, count), (t1, t2, n) = self.xp, item["points"], item["frame"]
        p = [[points[..., 3 * at + axis : 3 * at + axis + 1] for axis in range(3)] for at in range(first, first + count)]

        def between(a: int, b: int) -> Values:
            return [to - start for to, start in zip(p[b], p[a])]

        def length(v: Values) -> Array:
            return root(xp, _dot(v, v))

        def angle(v: Values) -> Array:
            return xp.arctan2(_dot(v, t2), _dot(v, t1)) * (180.0 / np.pi)

        def wrapped(degrees: Array) -> Array:
            return degrees - 360.0 * xp.floor((degrees + 180.0) / 360.0)

        if item["kind"] == "section_angle":
            angles = [angle(between(at, at + 1)) for at in range(0, count, 2)]
            return sum(wrapped(b - a) for a, b in zip(angles, angles[1:])) - item["rest"]
        if item["kind"] == "chord_angle":
            return wrapped(angle(between(0, 1)) - item["rest"])
        if item["kind"] == "curvature":
            a, b, c = between(0, 1), between(1, 2), between(0, 2)
            cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
            return 2.0 * _dot(cross, n) / (length(a) * length(b) * length(c))
        if item["kind"] == "length":
            return sum(length(between(at - 1, at)) for at in range(1, count))
        if item["kind"] == "position":
            return _dot(p[0], n)
        raise NotImplementedError(f"an observable of kind {item['kind']}")


def _dot(a: Sequence[Array], b: Sequence[Array]) -> Array:
    return sum(x * y for x, y in zip(a, b))


class Equations:
    """A model's answer to a state."""

    def __init__(self, xp: Any, model: Any, with_fields: bool) -> None:
        text, fields, self.shifts = model._native.parameters(with_fields)
        self.xp, self.small = xp, json.loads(text)
        small, self.header = self.small, self.small["header"]
        self.published = list(model.fields) if with_fields else []
        self.model = model
        self.regimes = {of["kind"]: Regime(xp, of, difference) for of, difference in zip(self.header["regimes"], small["differences"])}
        has_onset = self.header["onset"] or self.header["clearance"]
        self.onset = Onset(xp, self.header, self.regimes.get("Free")) if has_onset else None
        self.learned = LearnedMap(xp, small["learned"]) if small["learned"] else None
        self.observables = Observables(xp, small["observables"], {kind: of.count for kind, of in self.regimes.items()})
        self.columns = {(kind.title(), field): (slice(first, first + modes.shape[1]), mean, modes.T) for kind, field, first, mean, modes in fields}

    def answer(self, values: Values, learned: Optional[Tuple[Array, Array, List[Array]]] = None) -> Dict[str, Array]:
        """Numbers and fields by name; `values` by position of the input, with a last axis of one; `learned`: the past of a learned map."""
        xp, small, zero = self.xp, self.small, 0.0 * values[PRESSURE]
        out: Dict[str, Array] = {}
        gap = values[GAP]
        is_open = gap >= _OPEN_MM
        # Nothing is taken from contact where there is no obstacle, but it is evaluated.
        values = [values[PRESSURE], xp.where(is_open, self.header["inputs"][GAP]["range"][1] or 0.0, gap), *values[2:]]
        if self.onset:
            onset_mpa, always, within = self.onset.pressure(values)
            always, within = always & ~is_open, within & ~is_open
            in_contact = always | (within & (values[PRESSURE] >= onset_mpa))
            out["onset_pressure_mpa"] = xp.where(always, 0.0, xp.where(within, onset_mpa, np.inf))
        else:
            onset_mpa, in_contact = zero, zero >= (0.0 if self.header["regimes"][0]["kind"] == "Contact" else 1.0)
            out["onset_pressure_mpa"] = np.nan + zero

        def pick(by_regime: Dict[str, Array]) -> Array:
            return xp.where(in_contact, by_regime.get("Contact", np.nan), by_regime.get("Free", np.nan))

        parts: Dict[str, Dict[str, Any]] = {}
        for kind, regime in self.regimes.items():
            x = scale(regime.of["inputs"], values)
            part: Dict[str, Any] = {"force": zero if small["has_forces"] else np.nan + zero}
            if regime.force:
                excess = values[PRESSURE] - onset_mpa if regime.of["force"]["times_excess_pressure"] else 1.0
                part["force"] = xp.maximum(excess * regime.force(x), 0.0)
            if self.learned:
                outputs, part["distance"], widest = self.learned.answer(*(learned or self.learned.settled(values)))
                part["coefficients"], part["widths"] = outputs, [widest, np.nan * zero, np.nan * zero]
            else:
                part["coefficients"], part["widths"] = regime.coefficients(x, values), regime.half_widths(x)
                takes_gap = any(of["input"] == GAP for of in [*regime.axes, *regime.constants])
                distance = regime.distance(x, values)
                part["distance"] = xp.where(is_open, np.inf, distance) if takes_gap else distance
            parts[kind] = part
        distance = pick({kind: part["distance"] for kind, part in parts.items()})
        is_answered = distance <= _ANSWERED
        inside = distance <= (_ANSWERED if self.learned else _INSIDE)
        known = [True, small["has_stress"], small["has_forces"]]
        for at, name in enumerate(("displacement_halfwidth_mm", "von_mises_halfwidth_mpa", "force_halfwidth_n")):
            width = pick({kind: part["widths"][at] for kind, part in parts.items()})
            out[name] = xp.where(inside, width, np.nan) if known[at] else np.nan + zero
        out["domain_distance"] = distance
        out["regime"] = xp.where(in_contact, 2.0, 1.0) + zero
        answered = {"contact_force_n": pick({kind: part["force"] for kind, part in parts.items()})}
        coefficients = {kind: part["coefficients"] for kind, part in parts.items()}
        answered.update(self._observables(values, coefficients, pick))
        answered.update(self._fields(values, coefficients, pick))
        out.update({name: xp.where(is_answered, value, np.nan) for name, value in answered.items()})
        return out

    def _observables(self, values: Values, coefficients: Dict[str, Array], pick: Callable[[Dict[str, Array]], Array]) -> Dict[str, Array]:
        own, found = self.observables, {}
        points = pick({kind: own.points(kind, of) for kind, of in coefficients.items()}) if own.items else None
        for at, item in enumerate(own.items):
            if item["kind"] == "volume":
                value = pick({kind: own.volume(kind, of, item["points"][0]) for kind, of in coefficients.items()})
            else:
                value = own.measure(item, points)
            offsets = {}
            for corrected, correction in own.corrections:
                if corrected == at:
                    x = scale(correction["inputs"], values)
                    weights = np.asarray(correction["weights"])[:, None]
                    offsets[correction["regime"]] = difference_terms(self.xp, x, correction) @ self.xp.asarray(weights)
            found[item["name"]] = value + pick({kind: offsets.get(kind, 0.0) for kind in coefficients}) if offsets else value
        return found

    def _fields(self, values: Values, coefficients: Dict[str, Array], pick: Callable[[Dict[str, Array]], Array]) -> Dict[str, Array]:
        xp, found, by_field = self.xp, {}, {}
        for field in dict.fromkeys(field for _, field in self.columns):
            by_regime = {}
            for kind, of in coefficients.items():
                own, mean, modes = self.columns[kind, field]
                change = of[..., own] @ xp.asarray(modes) if len(modes) else 0.0 * of[..., :1]
                by_regime[kind] = xp.asarray(mean) + change
            by_field[field] = pick(by_regime)
        for name in self.published:
            at = next(at for at, field in enumerate(self.header["fields"]) if field["spec"]["name"] == name)
            axes, kind = self.header["fields"][at]["magnitude_of"], self.header["fields"][at]["spec"]["kind"]
            if axes is None:
                found[name] = xp.maximum(by_field[at], 0.0) if kind in ("Stress", "Magnitude") else by_field[at]
                continue
            rest_mm = self.model.undeformed_mm if self.model.nodes is None else self.model.undeformed_mm[self.model.nodes]
            moved = [by_field[field] - xp.asarray(rest_mm[:, axis].astype(float)) for axis, field in enumerate(axes)]
            for position, start, axis, by in self.shifts:
                moved[axis] = moved[axis] - (values[position] - start) * xp.asarray(by)
            found[name] = root(xp, _dot(moved, moved))
        return found
