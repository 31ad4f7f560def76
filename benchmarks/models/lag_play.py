"""A lag that fills and empties at its own rates, play operators behind it (Prandtl-Ishlinskii), a slow lag, a ridge polynomial."""

import numpy as np
from benchmark import Peer, polynomial, ridge

PLAYS = np.array([0.16, 0.4, 0.8, 1.4])  # in deviations of the inputs


def lag(inputs, step_s, filling_s, emptying_s):
    share_up, share_down = (1 - np.exp(-step_s / max(time_s, 1e-9)) for time_s in (filling_s, emptying_s))
    state, states = inputs[0].copy(), np.empty_like(inputs)
    for k, wanted in enumerate(inputs):
        change = wanted - state
        state = state + np.where(change > 0, share_up, share_down) * change
        states[k] = state
    return states


def play(inputs, width):
    state, states = inputs[0].copy(), np.empty_like(inputs)
    for k, wanted in enumerate(inputs):
        state = np.clip(state, wanted - width, wanted + width)
        states[k] = state
    return states


class Model(Peer):
    def candidates(self, step_s, length_s):
        self.step = step_s
        times_s = [0.0] + [time_s for time_s in (0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 5.0) if time_s < length_s / 10]
        if not np.isfinite(length_s):
            return [(0.0, 0.0, degree, 0, 0.0) for degree in (1, 3)]
        slow_s = min(10.0, length_s / 8)
        return [
            (time_s * up, time_s * down, degree, plays, creep_s)
            for time_s in times_s
            for up, down in (((1, 1), (0.7, 1.4), (1.4, 0.7), (0.6, 0.9)) if time_s > 0 else ((1, 1),))
            for degree in (1, 3)
            for plays in (0, 2, 4)
            for creep_s in (0.0, slow_s)
        ]

    def features(self, inputs, constants):
        filling_s, emptying_s, degree, plays, creep_s = constants
        lagged = lag(inputs, self.step, filling_s, emptying_s) if filling_s > 0 else inputs
        columns = [polynomial(lagged, degree)] + [play(lagged, width) - lagged for width in PLAYS[:plays]]
        if creep_s > 0:
            columns.append(lag(lagged, self.step, creep_s, creep_s) - lagged)
        return np.concatenate(columns, 1)

    def fit(self, runs, constants):
        features = np.concatenate([self.features(inputs, constants) for inputs, _ in runs])
        return ridge(features, np.concatenate([outputs for _, outputs in runs]), 1e-4)

    def simulate(self, fitted, inputs, constants):
        return self.features(inputs, constants) @ fitted
