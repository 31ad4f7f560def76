"""The control law without a bus: bit-identical to that in C, whose tests compare it with Rust."""

import math
import subprocess

import pytest
import softtwin
from conftest import PROGRAMS, REPOSITORY

MODEL = REPOSITORY / "models/pneunet/pneunet.twin"
SCENE = REPOSITORY / "config/scenes/rig.toml"


def compiled(folder):
    """clients/c/examples/control.c with the library that was built."""
    folder.mkdir()
    for name in ("libsofttwin.so", "libsofttwin.so.0"):
        (folder / name).symlink_to(PROGRAMS / "libcapi.so")
    source, headers = REPOSITORY / "clients/c/examples/control.c", REPOSITORY / "crates/capi/include"
    command = ["cc", "-std=c11", source, "-I", headers, "-L", folder, f"-Wl,-rpath,{folder}", "-lsofttwin", "-lm"]
    subprocess.run([*map(str, command), "-o", str(folder / "control")], check=True)
    return folder / "control"


@pytest.mark.parametrize("held, law", [("force_n", "inverse"), ("force_n", "predictive"), ("bending_angle_deg", "predictive")])
def test_setpoints_are_those_of_c(tmp_path, held, law):
    model = softtwin.Model(MODEL)
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.read_text().replace('law = "inverse"', f'law = "{law}"'))
    control = softtwin.Control(model, held, scene)
    first, second = (0.3, 0.2) if held == "force_n" else (30.0, 20.0)
    pressure_mpa, setpoints, lines = 0.01, [], []
    for k in range(1, 201):
        state = model.predict(pressure_mpa, 30.0, fields=False)
        sensed = 0.9 * float(state.contact_force_n if held == "force_n" else state.observables[held])
        measured = math.nan if k % 50 < 3 else sensed
        row = (5_000_000 * k, first if k < 120 else second, pressure_mpa, 30.0, measured)
        cycle = control.step(*row)
        assert cycle.fault is None
        setpoints.append(cycle.setpoint_mpa)
        lines.append(" ".join(map(repr, row)))
        pressure_mpa += 0.06 * (cycle.setpoint_mpa - pressure_mpa)
    assert max(setpoints) > 0.02
    done = subprocess.run(
        [compiled(tmp_path / "lib"), MODEL, scene, held], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    assert [float(line.split()[0]) for line in done.stdout.splitlines()] == setpoints


def test_a_series_is_seen_ahead():
    """A ramp as a series is the ramp with its rate; a step that is known begins before it comes, by the law's lead."""
    model = softtwin.Model(MODEL)

    def commands(target, **more):
        control = softtwin.Control(model, "pressure_mpa", SCENE)
        cycles = [control.step(5_000_000 * k, target(0.005 * k), 0.02, **more) for k in range(1, 40)]
        assert not any(cycle.is_fallback or cycle.is_limited or cycle.is_oscillating for cycle in cycles)
        return [cycle.setpoint_mpa for cycle in cycles]

    with_rate = commands(lambda t_s: 0.02 + 0.01 * t_s, rate_per_s=0.01)
    as_series = commands(lambda t_s: [0.02 + 0.01 * t_s, 0.03 + 0.01 * t_s], interval_s=1.0)
    assert with_rate == pytest.approx(as_series, abs=1e-9)
    blind = commands(lambda t_s: 0.02 if t_s < 0.1 else 0.04)
    ahead = commands(lambda t_s: [0.02 if t_s + 0.005 * k < 0.1 else 0.04 for k in range(20)], interval_s=0.005)
    first = [next(at for at, setpoint in enumerate(of) if setpoint > 0.021) for of in (blind, ahead)]
    assert first[1] < first[0]
    control = softtwin.Control(model, "pressure_mpa")
    for targets, interval_s in [([], 0.1), ([0.02, math.nan], 0.1), ([0.02], 0.0), ([0.02], math.nan)]:
        with pytest.raises(ValueError):
            control.step(1, targets, 0.02, interval_s=interval_s)


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
    for of_each_step in ("pressure_mpa", "gap_mm"):
        with pytest.raises(ValueError, match="driven pressure"):
            control.inputs(**{of_each_step: 0.01})
    with pytest.raises(ValueError, match="expected an observable"):
        softtwin.Control(softtwin.Model(MODEL), "warmth")
