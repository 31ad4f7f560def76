"""Pressure traces of the short finger of docs/memory.md: random steps of 20 ms to 1 s, sweeps of 0.2 to 6 Hz and walks, free, in contact and
landing; a sine of 4 Hz that lands and leaves.

    python3 scripts/motion_traces.py OUT [SEED]
"""

import math
import random
import sys
from pathlib import Path

# Pressures (MPa) and gaps (mm); free without obstacle. Contact is lost below about 0.026 MPa at a gap of 4.6 mm.
CLASSES = {
    "free": ((0.005, 0.035), None),
    "contact": ((0.030, 0.040), (3.6, 4.2)),
    "landing": ((0.010, 0.040), (4.2, 5.5)),
}
INTERVAL_S = 0.01


def steps(rng, low, high):
    t_s, rows = 0.0, [(0.0, rng.uniform(low, high))]
    while t_s < 0.8:
        rise_s = 0.02 * 50 ** rng.random()
        hold_s = rng.uniform(0.05, 0.2)
        value = rng.uniform(low, high)
        rows += [(t_s + rise_s, value), (t_s + rise_s + hold_s, value)]
        t_s += rise_s + hold_s
    return rows


def sweep(rng, low, high):
    """A sine whose frequency rises exponentially from 0.2 to 6 Hz."""
    end_s, ratio = 2.0, math.log(30.0)
    middle, amplitude = 0.5 * (low + high), 0.5 * (high - low) * rng.uniform(0.6, 1.0)
    phase = rng.uniform(0.0, math.tau)
    rows = []
    for k in range(int(end_s / INTERVAL_S) + 1):
        t_s = k * INTERVAL_S
        turns = 0.2 * end_s / ratio * (math.exp(ratio * t_s / end_s) - 1.0)
        rows.append((t_s, middle + amplitude * math.sin(math.tau * turns + phase)))
    return rows


def walk(rng, low, high):
    """A random walk of 20 ms intervals, reflected at the bounds."""
    value = rng.uniform(low, high)
    rows = []
    for k in range(41):
        rows.append((0.02 * k, value))
        value += rng.gauss(0.0, 0.15 * (high - low))
        value = 2 * low - value if value < low else 2 * high - value if value > high else value
        value = min(max(value, low), high)
    return rows


def main():
    out, rng = Path(sys.argv[1]), random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    out.mkdir(parents=True, exist_ok=True)
    for name, ((low, high), gaps) in CLASSES.items():
        for kind in (steps, sweep, walk):
            gap = f",{rng.uniform(*gaps):.3f}" if gaps else ""
            lines = [f"{t_s:.4f},{p:.6f}{gap}" for t_s, p in kind(rng, low, high)]
            header = "t_s,pressure_mpa" + (",gap_mm" if gaps else "")
            (out / f"{name}-{kind.__name__}.csv").write_text("\n".join([header, *lines]) + "\n")
    (low, high), gaps = CLASSES["landing"]
    middle, amplitude = 0.5 * (low + high), 0.5 * (high - low)
    instants = [k * INTERVAL_S for k in range(101)]
    lines = [f"{t_s:.4f},{middle + amplitude * math.sin(math.tau * 4.0 * t_s):.6f},{sum(gaps) / 2:.3f}" for t_s in instants]
    (out / "landing-sine.csv").write_text("\n".join(["t_s,pressure_mpa,gap_mm", *lines]) + "\n")


if __name__ == "__main__":
    main()
