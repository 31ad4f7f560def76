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
# What its unit gives the rights for (config/systemd/softtwin-twin@.service); what is refused is said.
REALTIME = """
[realtime]
lock_memory = true
prefault = true
fifo_priority = 50
stay_awake = true
"""
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

    # It stands for another machine: it gets what this one leaves.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
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
    lost = sum(b[1] - a[1] - 1 for a, b in zip(states, states[1:]) if a[0] == b[0])
    disordered = sum(b[1] <= a[1] for a, b in zip(states, states[1:]) if a[0] == b[0])
    delays_us.sort()
    print(json.dumps({
        "states": len(states), "states_lost": lost, "states_out_of_order": disordered,
        "twin_to_subscriber_us": {"p50": round(delays_us[len(delays_us) // 2]), "p99": round(delays_us[len(delays_us) * 99 // 100])},
        "fields_per_s": round((len(fields) - 1) / (fields[-1][0] - fields[0][0]), 2), "field_bytes": fields[-1][1],
        "fields_skipped_on_the_way": sum(b - a - 1 for a, b in zip(numbers, numbers[1:])),
    }))


class Run:
    """Programs in a domain of their own."""

    def __init__(self, programs, realtime):
        self.programs, self.folder, self.children = programs, pathlib.Path(tempfile.mkdtemp(prefix="mg")), []
        self.domain = f"mg_{uuid.uuid4().hex[:8]}"
        self.environment = dict(os.environ, SOFTTWIN_DOMAIN=self.domain, SOFTTWIN_ROOT=str(self.folder / "iox"))
        (self.folder / "scene.toml").write_text(SCENE)
        (self.folder / "twin.toml").write_text(REALTIME if realtime else "")
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

    def refused(self):
        """What the twin was refused of its real-time settings."""
        said = (self.folder / "0.log").read_text().splitlines()
        return [line.split("ASKED FOR: ")[1].split(";")[0] for line in said if "ASKED FOR" in line]

    def health(self, seconds):
        """The twin's own one-second reports of so many seconds."""
        command = [str(self.programs / "softtwin"), "echo", "softtwin/finger/health", "--count", str(max(2, int(seconds))), "--json"]
        said = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=True).stdout
        return [json.loads(line)["sample"] for line in said.splitlines()][1:]  # the first is from before

    def stop(self, child):
        child.terminate()
        child.wait()
        self.children.remove(child)

    def close(self):
        for child in reversed(self.children):
            child.terminate()
            child.wait()
        for left in pathlib.Path("/dev/shm").glob(f"iox2_{self.domain}_*"):
            left.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def say(what, found):
    print(json.dumps({"what": what, **found}), flush=True)


def processor_s(child):
    """Processor time of a program so far, all its threads."""
    numbers = pathlib.Path(f"/proc/{child.pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")


def summary(rounds):
    """Medians over all one-second reports, and from where to where those of the single rounds go."""
    found = {"reports": sum(map(len, rounds))}
    for key in ("latency_p50", "latency_p99", "compute_p99"):
        us = [[report[key + "_ns"] / 1e3 for report in reports] for reports in rounds]
        medians = [statistics.median(values) for values in us]
        found[key + "_us"] = round(statistics.median(sum(us, [])), 1)
        found[key + "_us_rounds"] = [round(min(medians), 1), round(max(medians), 1)]
    return found


class Phases:
    """The three situations, each as often as the others and in turn, so that a drift of the machine is seen as one."""

    def __init__(self, run, seconds):
        self.run, self.seconds = run, seconds
        self.found = {"twin alone": [], "gateway, nobody listens": [], "gateway, listened to": []}

    def note(self, phase, gateway=None):
        before, begin = gateway and processor_s(gateway), time.monotonic()
        reports = self.run.health(self.seconds)
        self.found[phase].append(reports)
        more = {"gateway_share_of_a_core": round((processor_s(gateway) - before) / (time.monotonic() - begin), 3)} if gateway else {}
        say(phase, {"round": len(self.found[phase]), **summary([reports]), **more})

    def round(self):
        self.note("twin alone")
        # As its unit starts it: behind the twin in the queue for the processor.
        gateway = self.run.start("softtwin-gateway", "--config", str(self.run.folder / "gateway.toml"), nice=5)
        self.note("gateway, nobody listens", gateway)
        far = [sys.executable, __file__, "--subscribe", "--seconds", str(self.seconds + 2)]
        with subprocess.Popen(far, stdout=subprocess.PIPE, text=True) as subscriber:
            time.sleep(1)  # Python starts: not what is measured
            self.note("gateway, listened to", gateway)
            say("remote subscriber", json.loads(subscriber.stdout.read()))
        self.run.stop(gateway)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=pathlib.Path, help="folder of our programs")
    parser.add_argument("--seconds", type=float, default=60.0, help="time of each measurement")
    parser.add_argument("--rounds", type=int, default=1, help="how often all three situations are measured")
    parser.add_argument("--realtime", choices=["yes", "no"], default="yes", help="the twin in real time, or as any program")
    parser.add_argument("--subscribe", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.subscribe:
        return subscribe(options.seconds)
    run = Run(options.programs.resolve(), options.realtime == "yes")
    try:
        scene = str(run.folder / "scene.toml")
        run.start("softtwind", "twin", "--scene", scene, "--config", str(run.folder / "twin.toml"))
        run.start("softtwind", "bridge", "--scene", scene)
        say("machine", {"load": os.getloadavg()[0], "processors": os.cpu_count(), "realtime": options.realtime, "twin_was_refused": run.refused()})
        time.sleep(2)
        phases = Phases(run, options.seconds)
        for _ in range(options.rounds):
            phases.round()
        phases.note("twin alone")
        for phase, rounds in phases.found.items():
            say("all rounds: " + phase, summary(rounds))
    finally:
        run.close()


if __name__ == "__main__":
    main()
