"""The remote subscriber of `softtwin-studies measure gateway`: a plain Zenoh client that counts states and fields.

gateway_subscriber.py ENDPOINT SECONDS prints one JSON object.
"""
import json
import os
import sys
import time

import zenoh


def main():
    endpoint, seconds = sys.argv[1], float(sys.argv[2])
    # It stands for another machine: it gets the processor time that this one leaves.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    states, fields, numbers, delays_us = [], [], [], []

    def state(sample):
        found = json.loads(bytes(sample.payload))
        states.append((found["boot_id"], found["seq"]))
        # One machine, so its monotonic clock can be compared.
        delays_us.append((time.monotonic_ns() - found["t_publish_ns"]) / 1e3)

    def field(sample):
        fields.append((time.monotonic(), len(bytes(sample.payload))))
        numbers.append(json.loads(bytes(sample.attachment))["gateway_seq"])

    with zenoh.open(config) as session:
        kept = [session.declare_subscriber("softtwin/finger/state", state),
                session.declare_subscriber("softtwin/finger/field/surface", field)]
        while not (states and fields):
            time.sleep(0.01)
        time.sleep(seconds)
        del kept
    pairs = [(a, b) for a, b in zip(states, states[1:]) if a[0] == b[0]]
    delays_us.sort()
    print(json.dumps({
        "states": len(states),
        "states_lost": sum(b[1] - a[1] - 1 for a, b in pairs),
        "states_out_of_order": sum(b[1] <= a[1] for a, b in pairs),
        "twin_to_subscriber_us": {"p50": round(delays_us[len(delays_us) // 2]), "p99": round(delays_us[len(delays_us) * 99 // 100])},
        "fields_per_s": round((len(fields) - 1) / (fields[-1][0] - fields[0][0]), 2),
        "field_bytes": fields[-1][1],
        "fields_skipped_on_the_way": sum(b - a - 1 for a, b in zip(numbers, numbers[1:])),
    }))


if __name__ == "__main__":
    main()
