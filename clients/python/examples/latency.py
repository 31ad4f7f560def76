"""Latency from publish to a numpy view (or of questions), woken by event, as one JSON object.

python latency.py field --seconds 60
"""

import argparse
import json
import time

import softtwin


def percentiles(durations_ns):
    durations_ns.sort()
    at = lambda share: durations_ns[min(int(share * len(durations_ns)), len(durations_ns) - 1)] / 1e3
    return {"count": len(durations_ns), "p50_us": at(0.5), "p99_us": at(0.99), "max_us": at(1.0)}


def listen(topic, seconds):
    samples = softtwin.subscribe(topic, timeout_s=5.0)
    samples.newest()  # discards samples sent before the start
    before, latencies, end = samples.lost, [], time.monotonic() + seconds
    while time.monotonic() < end:
        sample = samples.next()
        header = getattr(sample, "header", sample)
        if header is not sample:
            sample.values[-1, -1]  # the view is made and read
        latencies.append(softtwin.now_ns() - header.t_publish_ns)
        del sample
    return latencies, samples.lost - before


def ask(actuator, seconds):
    twin, latencies, end = softtwin.Client(actuator), [], time.monotonic() + seconds
    while time.monotonic() < end:
        begin = softtwin.now_ns()
        twin.whatif(0.005 + 0.001 * (len(latencies) % 80), 30.0)
        latencies.append(softtwin.now_ns() - begin)
        time.sleep(0.001)
    return latencies, 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["state", "field", "whatif"])
    parser.add_argument("--actuator", default="finger")
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    if args.what == "whatif":
        latencies, lost = ask(args.actuator, args.seconds)
    else:
        latencies, lost = listen(f"softtwin/{args.actuator}/{args.what}", args.seconds)
    print(json.dumps({"what": args.what, "lost": lost, "latency": percentiles(latencies)}))


if __name__ == "__main__":
    main()
