"""Extended dynamic mode decomposition with control and delays: a linear step of lifted outputs, free in the lifted space."""

import numpy as np
from benchmark import Peer, at_rest, polynomial, rest_map, ridge

BOUND = 50.0  # of a lifted value: a free run that leaves is held there


class Model(Peer):
    def candidates(self, step_s, length_s):
        return [
            (delays, degree, smoothing, input_degree)
            for delays in (1, 2, 4)
            for degree in (1, 2)
            for smoothing in (1e-6, 1e-3)
            for input_degree in (1, 3)
        ]

    def lifted(self, inputs, outputs, constants):
        """Outputs of now and before, inputs before, 1, and products of outputs; a row per instant after the delays."""
        delays, degree = constants[:2]
        rows = len(inputs) - delays
        past = [outputs[delays - k : delays - k + rows] for k in range(delays + 1)]
        past += [inputs[delays - k : delays - k + rows] for k in range(1, delays + 1)]
        now = past[0]
        products = [now[:, i : i + 1] * now[:, i:] for i in range(now.shape[1])] if degree >= 2 else []
        return np.concatenate([*past, np.ones((rows, 1)), *products], 1)

    def fit(self, runs, constants):
        delays, _, smoothing, input_degree = constants
        before, after = [], []
        for inputs, outputs in runs:
            lifted = self.lifted(inputs, outputs, constants)
            drive = polynomial(inputs[delays:], input_degree)[:, 1:]
            before.append(np.concatenate([lifted[:-1], drive[:-1]], 1))
            after.append(lifted[1:])
        return ridge(np.concatenate(before), np.concatenate(after), smoothing), rest_map(runs)

    def simulate(self, fitted, inputs, constants):
        step, rest = fitted
        delays, _, _, input_degree = constants
        still = at_rest(rest, inputs)
        lifted = self.lifted(np.repeat(inputs[:1], delays + 1, 0), np.repeat(still, delays + 1, 0), constants)[0]
        drive = polynomial(inputs, input_degree)[:, 1:]
        outputs = [still[0]]
        for k in range(len(inputs) - 1):
            lifted = np.clip(np.concatenate([lifted, drive[k]]) @ step, -BOUND, BOUND)
            outputs.append(lifted[: still.shape[1]])
        return np.array(outputs)
