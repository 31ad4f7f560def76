"""Times predictions in this process: the median of one state at a time, whole field, into reused memory."""

import argparse
import json
import time

import numpy as np
import softtwin


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("model")
    options.add_argument("--states", type=int, default=500)
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
    print(json.dumps(found))


if __name__ == "__main__":
    main()
