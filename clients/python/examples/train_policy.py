"""Trains a policy that holds a force without knowing the gap, on many simulated fingers at once, by evolution of its weights.

    python clients/python/examples/train_policy.py --seconds 60

The policy sees wanted force, load cell, gauge and command, and integrates the error of the force: a command changes by what four weights make of it.
"""

import argparse
import json
import time

import gymnasium
import numpy as np
import softtwin
import softtwin.environment

STEPS = 60


def episode(env, weights, seed):
    """Mean reward of each finger over the second half of an episode, where the force should be there. `weights`: one row for each finger."""
    seen, _ = env.reset(seed=seed)
    command, earned = np.full(env.num_envs, -1.0), np.zeros(env.num_envs)
    for step in range(STEPS):
        wanted, cell, gauge, last = seen.T
        features = np.stack([wanted - cell, wanted, last - gauge, np.ones(env.num_envs)])
        command = np.clip(command + (weights.T * features).sum(axis=0), -1.0, 1.0)
        seen, reward, _, _, _ = env.step(command[:, None].astype(np.float32))
        earned += reward * (step >= STEPS // 2) / (STEPS - STEPS // 2)
    return earned


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--fingers", type=int, default=1024)
    args = parser.parse_args()
    model = softtwin.shared_file("models/pneunet/pneunet.twin")
    env = gymnasium.make_vec("softtwin/HoldForce-v0", num_envs=args.fingers, vectorization_mode="vector_entry_point", model=model)
    random = np.random.default_rng(1)
    each = 16  # fingers that try the same weights, each with its own force and gap
    tried = args.fingers // each
    mean, spread = np.zeros(4), np.full(4, 0.3)
    before = episode(env, np.zeros((args.fingers, 4)), 0).mean()
    end, rounds = time.monotonic() + args.seconds, 0
    while time.monotonic() < end:
        rounds += 1
        candidates = mean + spread * random.normal(size=(tried, 4))
        earned = episode(env, np.repeat(candidates, each, axis=0), rounds).reshape(tried, each).mean(axis=1)
        best = candidates[np.argsort(earned)[-tried // 8 :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.01
    after = episode(env, np.tile(mean, (args.fingers, 1)), 0).mean()
    print(json.dumps({"rounds": rounds, "weights": mean.round(3).tolist(), "reward_untrained": round(before, 4), "reward": round(after, 4)}))


if __name__ == "__main__":
    main()
