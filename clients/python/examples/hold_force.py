"""Holds a contact force by commanding pressure; crates/control/examples/hold_force.rs in Python.

    softtwind twin --scene config/scenes/force.toml
    softtwin-studies plant --scene config/scenes/force.toml --true-gap-mm 33 --target-n 0.3
    python hold_force.py --target-n 0.3 --plot force.png     # the plot needs matplotlib

The law is u = P(F*) + kp e/g + ki * integral(e/g): P(F*) is the twin's inverse at the gap that is assumed, g its gradient
dF/dP at the present state, e the force's error. The integral takes up what the model does not know.
"""

import argparse
import json
import math
import time

import softtwin

KP, KI_PER_S = 0.5, 6.0  # for a lag of 80 ms behind a delay of 20 to 40 ms
LEAST_GRADIENT = 3.0  # N/MPa; the twin's gradient is 0 without contact
HIGHEST_MPA = 0.09
SILENCE_S = 1.0
NOT_A_READING = {"no-data", "stale", "held"}


class Controller:
    """Feed-forward and PI over the twin's gradient, with an integral that is frozen at the limits."""

    def __init__(self, target_n, feed_forward_mpa):
        self.target_n, self.feed_forward_mpa, self.integral_mpa = target_n, feed_forward_mpa, 0.0

    def update(self, force_n, gradient, dt_s):
        error_mpa = (self.target_n - force_n) / max(gradient, LEAST_GRADIENT)
        integral_mpa = self.integral_mpa + KI_PER_S * error_mpa * dt_s
        wanted = self.feed_forward_mpa + KP * error_mpa + integral_mpa
        command = min(max(wanted, 0.0), HIGHEST_MPA)
        if command == wanted or (wanted - command) * error_mpa < 0.0:
            self.integral_mpa = integral_mpa
        return command


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
    parser.add_argument("--actuator", default="finger")
    parser.add_argument("--target-n", type=float, default=0.3)
    parser.add_argument("--gap-mm", type=float, default=30.0, help="gap that is assumed, mm")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--plot", metavar="FILE", help="force and commanded pressure over time, .png or .svg")
    parser.add_argument("--json", action="store_true", help="end with one JSON object instead of a line")
    args = parser.parse_args()

    feed_forward_mpa = softtwin.Client(args.actuator).pressure(args.target_n, args.gap_mm).pressure_mpa
    controller = Controller(args.target_n, feed_forward_mpa)
    valve = softtwin.CommandPublisher(args.actuator)
    states = softtwin.subscribe(f"softtwin/{args.actuator}/state", timeout_s=SILENCE_S)
    last_ns, turns_ns, points, end = None, [], [], time.monotonic() + args.seconds
    try:
        while time.monotonic() < end:
            state = states.newest()
            if NOT_A_READING.intersection(state.flag_names):
                if state.age_ns > SILENCE_S * 1e9:
                    break
                continue
            dt_s = 0.0 if last_ns is None else min((state.t_sensor_ns - last_ns) * 1e-9, 0.1)
            last_ns = state.t_sensor_ns
            measured = state.measured_force_n
            force_n = state.contact_force_n if math.isnan(measured) else measured
            command_mpa = controller.update(force_n, state.force_by_pressure_n_per_mpa, dt_s)
            valve.send(command_mpa, state.t_sensor_ns)
            turns_ns.append(softtwin.now_ns() - state.t_sensor_ns)
            points.append((state.t_sensor_ns * 1e-9, force_n, command_mpa))
    except softtwin.TwinSilent:
        pass  # the twin ended: the pressure is released below
    finally:
        valve.send(0.0)
    if not points:
        raise SystemExit("no reading came; is softtwin-studies plant running?")
    turns_ns.sort()
    p50_us, p99_us = (turns_ns[int(share * (len(turns_ns) - 1))] / 1e3 for share in (0.5, 0.99))
    report = {"feed_forward_mpa": feed_forward_mpa, "commands": len(turns_ns)}
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
