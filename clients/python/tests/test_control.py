"""The control law without a bus: bit-identical to that in C, whose tests compare it with Rust."""

import math
import subprocess

import pytest
import softtwin
from conftest import REPOSITORY
from softtwin.library import library

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
SCENE = REPOSITORY / "config/scenes/rig.toml"


def compiled(folder):
    """clients/c/examples/control.c with the library of this process."""
    folder.mkdir()
    for name in ("libsofttwin.so", "libsofttwin.so.0"):
        (folder / name).symlink_to(library()._name)
    source, headers = REPOSITORY / "clients/c/examples/control.c", REPOSITORY / "crates/capi/include"
    command = ["cc", "-std=c11", source, "-I", headers, "-L", folder, f"-Wl,-rpath,{folder}", "-lsofttwin", "-lm"]
    subprocess.run([*map(str, command), "-o", str(folder / "control")], check=True)
    return folder / "control"


def test_setpoints_are_those_of_c(tmp_path):
    model = softtwin.Model(MODEL)
    control = softtwin.Control(model, "force_n", SCENE)
    pressure_mpa, setpoints, lines = 0.01, [], []
    for k in range(1, 201):
        force_n = float(0.9 * model.predict(pressure_mpa, 30.0, fields=False).contact_force_n)
        measured = math.nan if k % 50 < 3 else force_n
        row = (5_000_000 * k, 0.3 if k < 120 else 0.2, pressure_mpa, 30.0, measured)
        cycle = control.step(*row)
        assert cycle.fault is None
        setpoints.append(cycle.setpoint_mpa)
        lines.append(" ".join(map(repr, row)))
        pressure_mpa += 0.06 * (cycle.setpoint_mpa - pressure_mpa)
    assert max(setpoints) > 0.03
    done = subprocess.run(
        [compiled(tmp_path / "lib"), MODEL, SCENE, "force_n"], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    assert [float(line.split()[0]) for line in done.stdout.splitlines()] == setpoints


def test_refusals_and_faults():
    control = softtwin.Control(softtwin.Model(MODEL), "pressure_mpa")
    control.step(5_000_000, 0.05, 0.0)
    for t_ns, target, pressure_mpa in [(5_000_000, 0.05, 0.0), (6_000_000, math.nan, 0.0), (6_000_000, 0.05, math.nan)]:
        with pytest.raises(ValueError):
            control.step(t_ns, target, pressure_mpa)
    faults = [control.step(5_000_000 * k, 0.05, 0.0).fault for k in range(2, 200)]  # supply gone
    assert faults[-1] == "no-response" and math.isnan(control.step(10**9, 0.05, 0.0).setpoint_mpa)
    control.release()
    assert control.step(10**9 + 5_000_000, 0.05, 0.0).fault is None
    with pytest.raises(ValueError, match="expected an observable"):
        softtwin.Control(softtwin.Model(MODEL), "warmth")
