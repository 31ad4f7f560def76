"""An echo state network: 150 leaky neurons with random connections, a ridge of their states and the inputs."""

import numpy as np
from benchmark import Peer, ridge

NEURONS = 150


class Model(Peer):
    def candidates(self, step_s, length_s):
        leaks = sorted({min(1.0, rate * step_s) for rate in (0.3, 1.5, 6.0)})
        return [
            (radius, leak, scale, smoothing)
            for radius in (0.5, 0.95)
            for leak in leaks
            for scale in (0.2, 0.6)
            for smoothing in (1e-6, 1e-3)
        ]

    def states(self, inputs, constants):
        radius, leak, scale, _ = constants
        random = np.random.default_rng(0)
        drive_weights = random.uniform(-1, 1, (NEURONS, inputs.shape[1] + 1)) * scale
        weights = random.normal(size=(NEURONS, NEURONS)) * (random.random((NEURONS, NEURONS)) < 0.05)
        weights *= radius / np.abs(np.linalg.eigvals(weights)).max()
        with_one = np.concatenate([np.ones((len(inputs), 1)), inputs], 1)
        drive = with_one @ drive_weights.T
        state, states = np.zeros(NEURONS), np.empty((len(inputs), NEURONS))
        for _ in range(int(4 / leak)):  # to rest under the first inputs
            state = (1 - leak) * state + leak * np.tanh(drive[0] + weights @ state)
        for k in range(len(inputs)):
            state = (1 - leak) * state + leak * np.tanh(drive[k] + weights @ state)
            states[k] = state
        return np.concatenate([with_one, states], 1)

    def fit(self, runs, constants):
        features = np.concatenate([self.states(inputs, constants) for inputs, _ in runs])
        return ridge(features, np.concatenate([outputs for _, outputs in runs]), constants[3])

    def simulate(self, fitted, inputs, constants):
        return self.states(inputs, constants) @ fitted
