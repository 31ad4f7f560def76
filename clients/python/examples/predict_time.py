"""Times predictions in this process: the median of one state at a time, whole field, into reused memory; with `--batch`, the numbers of many
states in one call, with and without observables, and where jax is installed the same in jax with the gradient of the force, without its
compilation."""

import argparse
import importlib.util
import json
import time

import numpy as np
import softtwin


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("model")
    options.add_argument("--states", type=int, default=500)
    options.add_argument("--batch", type=int, help="also time so many states at once")
    given = options.parse_args()
    model = softtwin.Model(given.model)
    pressures = np.linspace(0.02, 0.08, given.states)
    out = np.empty((len(model.fields), model.node_count), np.float32)
    found = {}
    for name, memory in (("out_us", out), ("new_memory_us", None)):
        times = []
        for pressure_mpa in pressures:
            began = time.perf_counter_ns()
            model.predict(pressure_mpa, 30.0, out=memory)
            times.append(time.perf_counter_ns() - began)
        found[name] = float(np.median(times)) / 1e3
    print(json.dumps({**found, **(batch(model, given.batch) if given.batch else {})}))


def batch(model, count):
    states = {name: np.linspace(i.min, i.max, count) for name, i in model.inputs.items()}
    ways = {
        "predict_ms": lambda: model.predict(**states, fields=False),
        "no_observables_ms": lambda: model.predict(**states, fields=False, observables=False),
    }
    if importlib.util.find_spec("jax"):
        ways.update(ways_of_jax(model, states))
    found = {}
    for name, way in ways.items():
        way()
        times = []
        for _ in range(5):
            began = time.perf_counter_ns()
            way()
            times.append(time.perf_counter_ns() - began)
        found[name] = round(float(np.median(times)) / 1e6, 1)
    return found


def ways_of_jax(model, states):
    import jax

    jax.config.update("jax_enable_x64", True)
    finger = model.jax(fields=False)
    numbers = jax.jit(jax.vmap(finger))
    force = jax.jit(jax.vmap(jax.value_and_grad(lambda state: finger(state)["contact_force_n"])))
    return {
        "vmap_ms": lambda: jax.block_until_ready(numbers(states)),
        "vmap_grad_ms": lambda: jax.block_until_ready(force(states)),
    }


if __name__ == "__main__":
    main()
