"""What the network gateway carries and costs. See measure_gateway.sh."""

import argparse
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import uuid

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent
ENDPOINT = "tcp/127.0.0.1:17447"
SCENE = f"""
name = "khz"
[[actuator]]
name = "finger"
model = "{REPOSITORY}/models/pneunet/pneunet.twin"
[actuator.source]
kind = "simulate"
rate_hz = 1000.0
gap_mm = 30.0
profile = {{ shape = "sine", mean_mpa = 0.045, amplitude_mpa = 0.03, frequency_hz = 0.5 }}
[[actuator.output]]
nodes = "surface"
"""


def subscribe(seconds):
    """The remote subscriber: counts states and fields for so long, beginning with the first of both."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
    states, fields, delays_us = [], [], []

    def state(sample):
        found = json.loads(bytes(sample.payload))
        states.append((found["boot_id"], found["seq"]))
        # One machine, so its monotonic clock can be compared.
        delays_us.append((time.monotonic_ns() - found["t_publish_ns"]) / 1e3)

    def field(sample):
        fields.append((time.monotonic(), len(bytes(sample.payload))))

    with zenoh.open(config) as session:
        kept = [session.declare_subscriber("softtwin/finger/state", state),
                session.declare_subscriber("softtwin/finger/field/surface", field)]
        while not (states and fields):
            time.sleep(0.01)
        time.sleep(seconds)
        del kept
    lost = sum(b[1] - a[1] - 1 for a, b in zip(states, states[1:]) if a[0] == b[0])
    disordered = sum(b[1] <= a[1] for a, b in zip(states, states[1:]) if a[0] == b[0])
    delays_us.sort()
    print(json.dumps({
        "states": len(states), "states_lost": lost, "states_out_of_order": disordered,
        "twin_to_subscriber_us": {"p50": round(delays_us[len(delays_us) // 2]), "p99": round(delays_us[len(delays_us) * 99 // 100])},
        "fields_per_s": round((len(fields) - 1) / (fields[-1][0] - fields[0][0]), 2), "field_bytes": fields[-1][1],
    }))


class Run:
    """Programs in a domain of their own."""

    def __init__(self, programs):
        self.programs, self.folder, self.children = programs, pathlib.Path(tempfile.mkdtemp(prefix="mg")), []
        self.domain = f"mg_{uuid.uuid4().hex[:8]}"
        self.environment = dict(os.environ, SOFTTWIN_DOMAIN=self.domain, SOFTTWIN_ROOT=str(self.folder / "iox"))
        (self.folder / "scene.toml").write_text(SCENE)
        (self.folder / "gateway.toml").write_text(f'listen = ["{ENDPOINT}"]\nfield_rate_hz = 30.0\n')

    def start(self, name, *arguments, nice=0):
        log = self.folder / f"{len(self.children)}.log"
        command = ["nice", "-n", str(nice), str(self.programs / name), *arguments]
        child = subprocess.Popen(command, stderr=open(log, "w"), env=self.environment)
        self.children.append(child)
        while "ready:" not in log.read_text():
            if child.poll() is not None:
                sys.exit(f"{name} did not start:\n{log.read_text()}")
            time.sleep(0.05)
        return child

    def health(self, seconds):
        """Medians over the twin's own one-second reports."""
        command = [str(self.programs / "softtwin"), "echo", "softtwin/finger/health", "--count", str(max(2, int(seconds))), "--json"]
        said = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=True).stdout
        found = [json.loads(line)["sample"] for line in said.splitlines()][1:]  # the first is from before
        us = lambda key: round(statistics.median(sample[key] for sample in found) / 1e3, 1)
        return {"latency_p50_us": us("latency_p50_ns"), "latency_p99_us": us("latency_p99_ns"),
                "compute_p50_us": us("compute_p50_ns"), "compute_p99_us": us("compute_p99_ns"), "reports": len(found)}

    def close(self):
        for child in reversed(self.children):
            child.terminate()
            child.wait()
        for left in pathlib.Path("/dev/shm").glob(f"iox2_{self.domain}_*"):
            left.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def say(what, found):
    print(json.dumps({"what": what, **found}), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=pathlib.Path, help="folder of our programs")
    parser.add_argument("--seconds", type=float, default=60.0, help="time of each measurement")
    parser.add_argument("--subscribe", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.subscribe:
        return subscribe(options.seconds)
    say("machine", {"load": os.getloadavg()[0], "processors": os.cpu_count()})
    run = Run(options.programs.resolve())
    try:
        scene = str(run.folder / "scene.toml")
        run.start("softtwind", "twin", "--scene", scene)
        run.start("softtwind", "bridge", "--scene", scene)
        time.sleep(2)
        # Without the gateway before and after, so that a drift of the machine is seen.
        say("twin alone", run.health(options.seconds))
        # As its unit starts it: behind the twin in the queue for the processor.
        gateway = run.start("softtwin-gateway", "--config", str(run.folder / "gateway.toml"), nice=5)
        say("gateway, nobody listens", run.health(options.seconds))
        # It stands for another machine, whose processor it would use.
        far = ["nice", "-n", "10", sys.executable, __file__, "--subscribe", "--seconds", str(options.seconds + 2)]
        with subprocess.Popen(far, stdout=subprocess.PIPE, text=True) as subscriber:
            say("gateway, listened to", run.health(options.seconds))
            say("remote subscriber", json.loads(subscriber.stdout.read()))
        gateway.terminate()
        gateway.wait()
        say("twin alone again", run.health(options.seconds))
    finally:
        run.close()


if __name__ == "__main__":
    main()
