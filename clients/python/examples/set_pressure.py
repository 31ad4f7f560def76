"""Owns the valve of an actuator for some seconds: holds a pressure, prints the valve's state, and releases it.

    softtwin-studies rig --listen 127.0.0.1:5020
    softtwind twin   --scene config/scenes/rig.toml
    softtwind bridge --scene config/scenes/rig.toml
    python set_pressure.py --pressure-mpa 0.02
"""

import argparse
import math
import time

import softtwin

VALID_S = 0.2


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--actuator", default="finger")
    parser.add_argument("--pressure-mpa", type=float, default=0.02)
    parser.add_argument("--seconds", type=float, default=5.0)
    args = parser.parse_args()

    writes = softtwin.subscribe(f"softtwin/{args.actuator}/valve", timeout_s=5.0)
    valve = softtwin.SetpointPublisher(args.actuator, owner="set_pressure.py")
    before, renew, end = None, 0.0, time.monotonic() + args.seconds
    try:
        while time.monotonic() < end:
            if time.monotonic() >= renew:
                valve.send(args.pressure_mpa, VALID_S)
                renew = time.monotonic() + VALID_S / 4
            write = writes.newest()
            now = write.name_of("valve_reason")
            if now != before:
                print(f"{now}: {write.pressure_mpa:.4f} MPa", flush=True)
            before = now
    finally:
        valve.send(math.nan)  # releases: the valve closes at once


if __name__ == "__main__":
    main()
