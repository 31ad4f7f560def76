"""A ridge polynomial of the last outputs and inputs (NARX), fed with its own outputs when it predicts."""

import numpy as np
from benchmark import Peer, at_rest, rest_map, ridge

BOUND = 6.0  # in deviations: a free run that leaves is held there


class Model(Peer):
    def candidates(self, step_s, length_s):
        lags = ((1, 1), (1, 3), (2, 2), (2, 5), (4, 4))
        return [(*lag, degree, smoothing) for lag in lags for degree in (1, 2, 3) for smoothing in (1e-6, 1e-3)]

    def fit(self, runs, constants):
        past_outputs, past_inputs, degree, smoothing = constants
        first = max(past_outputs, past_inputs)
        features, targets = [], []
        for inputs, outputs in runs:
            rows = range(first, len(inputs))
            features.append(np.stack([self.features(outputs[:k], inputs[: k + 1], constants) for k in rows]))
            targets.append(outputs[first:])
        weights = ridge(np.concatenate(features), np.concatenate(targets), smoothing)
        return weights, rest_map(runs)

    def features(self, outputs, inputs, constants):
        past_outputs, past_inputs, degree, _ = constants
        past = np.concatenate([outputs[: -past_outputs - 1 : -1].ravel(), inputs[: -past_inputs - 1 : -1].ravel()])
        newest = np.concatenate([outputs[-1], inputs[-1]])
        products = [newest[i] * newest[i:] for i in range(len(newest))] if degree >= 2 else []
        return np.concatenate([[1.0], past, *products, newest**3 if degree >= 3 else []])

    def simulate(self, fitted, inputs, constants):
        weights, rest = fitted
        first = max(constants[:2])
        inputs = np.concatenate([np.repeat(inputs[:1], first, 0), inputs])
        outputs = np.zeros((len(inputs), weights.shape[1]))
        outputs[:first] = at_rest(rest, inputs)
        for k in range(first, len(inputs)):
            outputs[k] = np.clip(self.features(outputs[:k], inputs[: k + 1], constants) @ weights, -BOUND, BOUND)
        return outputs[first:]
