"""Holds a contact force by commanding pressure: inverse of the model and a PI. `softtwin hold` has the law on the dynamics.

    softtwind twin --scene config/scenes/force.toml
    softtwin-studies plant --scene config/scenes/force.toml --true-gap-mm 33 --target-n 0.3
    python hold_force.py --scene config/scenes/force.toml --target-n 0.3 --plot force.png     # the plot needs matplotlib

The law is u = P(F*) + kp e/g + ki * integral(e/g): P(F*) is the twin's inverse at gap and inputs of its first state, g its gradient
dF/dP at the present state, e the force's error. The integral takes up what the model does not know. Range, rate and force limit are
those of the scene's valve; without one the range is the model's.
"""

import argparse
import json
import math
import pathlib
import time
from dataclasses import dataclass

try:
    import tomllib
except ImportError:  # Python 3.10 and older
    import tomli as tomllib

import softtwin

KP, KI_PER_S = 0.5, 6.0  # for a lag of 80 ms behind a delay of 20 to 40 ms
LEAST_GRADIENT = 3.0  # N/MPa; the twin's gradient is 0 without contact
SILENCE_S = 1.0
VALID_S = 0.05
NOT_A_READING = {"no-data", "stale", "held"}


@dataclass
class Limits:
    """Limits of an actuator in a scene."""

    actuator: str
    range_mpa: tuple
    rate_mpa_per_s: float
    force_max_n: float


def limits(scene, name=None):
    """Limits of the actuator with this name in a scene file; default: of its first one."""
    path = pathlib.Path(scene)
    actuators = tomllib.loads(path.read_text("utf-8")).get("actuator", [])
    actuator = next((one for one in actuators if name in (None, one["name"])), None)
    if actuator is None:
        raise SystemExit(f"--actuator: expected one of {[one['name'] for one in actuators]} in {path}, found {name}")
    valve = actuator.get("valve", {})
    pressure = softtwin.Model(path.parent / actuator["model"]).inputs["pressure_mpa"]
    low_mpa, high_mpa = valve.get("range_mpa", (pressure.min, pressure.max))
    no_limit = math.inf
    return Limits(actuator["name"], (low_mpa, high_mpa), valve.get("rate_mpa_per_s", no_limit), valve.get("force_max_n", no_limit))


class Controller:
    """Feed-forward and PI over the twin's gradient, with an integral that is frozen at the limits."""

    def __init__(self, target_n, feed_forward_mpa, limits):
        self.target_n, self.feed_forward_mpa, self.limits = target_n, feed_forward_mpa, limits
        self.integral_mpa, self.command_mpa = 0.0, None

    def update(self, force_n, gradient, pressure_mpa, dt_s):
        before_mpa = pressure_mpa if self.command_mpa is None else self.command_mpa
        error_mpa = (self.target_n - force_n) / max(gradient, LEAST_GRADIENT)
        integral_mpa = self.integral_mpa + KI_PER_S * error_mpa * dt_s
        wanted = self.feed_forward_mpa + KP * error_mpa + integral_mpa
        step_mpa = self.limits.rate_mpa_per_s * dt_s if dt_s > 0.0 else 0.0
        command = min(max(wanted, before_mpa - step_mpa), before_mpa + step_mpa)
        low_mpa, high_mpa = self.limits.range_mpa
        command = min(max(command, low_mpa), high_mpa)
        if command == wanted or (wanted - command) * error_mpa < 0.0:
            self.integral_mpa = integral_mpa
        self.command_mpa = command
        return command


def feed_forward(limits, state, target_n):
    """Pressure for the force at gap and inputs of a state, MPa; ends the program if the limits do not allow it."""
    if target_n > limits.force_max_n:
        raise SystemExit(f"--target-n: expected at most {limits.force_max_n} N, the valve's force_max_n in the scene, found {target_n}")
    inputs = dict(zip(state.text_list("input_names"), state.inputs))
    gap_mm = inputs.pop("gap_mm", math.nan)
    inputs.pop("pressure_mpa", None)
    pressure_mpa = softtwin.Client(limits.actuator).pressure(target_n, gap_mm, inputs=inputs).pressure_mpa
    low_mpa, high_mpa = limits.range_mpa
    if not low_mpa <= pressure_mpa <= high_mpa:
        raise SystemExit(f"{target_n} N needs {pressure_mpa:.4f} MPa, the scene allows {low_mpa} to {high_mpa} MPa")
    return pressure_mpa


def plot(path, points, target_n):
    """Draws force and commanded pressure over time."""
    from matplotlib.figure import Figure

    times, forces, commands = zip(*[(t - points[0][0], force, command) for t, force, command in points])
    figure = Figure(figsize=(7, 5), layout="constrained")
    force, pressure = figure.subplots(2, 1, sharex=True)
    force.plot(times, forces)
    force.axhline(target_n, linestyle="--", color="gray")
    force.set_ylabel("contact force (N)")
    pressure.plot(times, commands)
    pressure.set_ylabel("commanded pressure (MPa)")
    pressure.set_xlabel("time (s)")
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, metavar="FILE", help="scene of the twin")
    parser.add_argument("--actuator", help="default: the scene's first")
    parser.add_argument("--target-n", type=float, default=0.3)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--plot", metavar="FILE", help="force and commanded pressure over time, .png or .svg")
    parser.add_argument("--json", action="store_true", help="end with one JSON object instead of a line")
    args = parser.parse_args()

    allowed = limits(args.scene, args.actuator)
    valve = softtwin.SetpointPublisher(allowed.actuator, owner="hold_force.py")
    states = softtwin.subscribe(f"softtwin/{allowed.actuator}/state", timeout_s=SILENCE_S)
    controller, last_ns, turns_ns, points, end = None, None, [], [], time.monotonic() + args.seconds
    try:
        while time.monotonic() < end:
            state = states.newest()
            if NOT_A_READING.intersection(state.flag_names):
                if state.age_ns > SILENCE_S * 1e9:
                    break
                continue
            if controller is None:
                controller = Controller(args.target_n, feed_forward(allowed, state, args.target_n), allowed)
            dt_s = 0.0 if last_ns is None else min((state.t_sensor_ns - last_ns) * 1e-9, 0.1)
            last_ns = state.t_sensor_ns
            measured = state.measured_force_n
            force_n = state.contact_force_n if math.isnan(measured) else measured
            command_mpa = controller.update(force_n, state.force_by_pressure_n_per_mpa, state.pressure_mpa, dt_s)
            valve.send(command_mpa, VALID_S, state.t_sensor_ns)
            turns_ns.append(softtwin.now_ns() - state.t_sensor_ns)
            points.append((state.t_sensor_ns * 1e-9, force_n, command_mpa))
    except softtwin.TwinSilent:
        pass  # the twin ended: the pressure is released below
    finally:
        valve.send(math.nan)
    if not points:
        raise SystemExit("no reading came; is softtwin-studies plant running?")
    turns_ns.sort()
    p50_us, p99_us = (turns_ns[int(share * (len(turns_ns) - 1))] / 1e3 for share in (0.5, 0.99))
    report = {"feed_forward_mpa": controller.feed_forward_mpa, "commands": len(turns_ns)}
    if args.plot:
        plot(args.plot, points, args.target_n)
    if args.json:
        print(json.dumps({**report, "reading_to_command_sent": {"p50_us": p50_us, "p99_us": p99_us}}))
        return
    (first_s, _, _), (last_s, force_n, command_mpa) = points[0], points[-1]
    print(
        f"{last_s - first_s:.1f} s: {force_n:.3f} N at the end, wanted {args.target_n:.3f} N, at {command_mpa:.4f} MPa; "
        f"{len(points)} commands, {p50_us:.0f} us after the reading ({p99_us:.0f} us at the 99th percentile)"
    )


if __name__ == "__main__":
    main()
