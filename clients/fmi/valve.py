"""A supply valve, an actuator's chamber and the twin's FMU, stepped together by FMPy.

    softtwin export models/pneunet/pneunet.twin --out finger.fmu
    python valve.py finger.fmu

The chamber fills through the valve with a time constant; a controller opens it until the force is reached.
"""

import argparse
import tempfile

import fmpy
from fmpy.fmi3 import FMU3Slave

SUPPLY_MPA = 0.09
TIME_CONSTANT_S = 0.15
STEP_S = 0.001


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("fmu")
    options.add_argument("--gap-mm", type=float, default=30.0)
    options.add_argument("--force-n", type=float, default=0.3)
    options.add_argument("--seconds", type=float, default=1.0)
    given = options.parse_args()
    description = fmpy.read_model_description(given.fmu)
    number = {variable.name: variable.valueReference for variable in description.modelVariables}
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(given.fmu, folder)
        twin = FMU3Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="finger",
        )
        twin.instantiate()
        twin.enterInitializationMode()
        twin.setFloat64([number["gap_mm"]], [given.gap_mm])
        twin.exitInitializationMode()
        pressure_mpa, time_s, wanted = 0.0, 0.0, [number["contact_force_n"], number["force_by_pressure_mpa"]]
        while time_s < given.seconds:
            twin.setFloat64([number["pressure_mpa"]], [pressure_mpa])
            twin.doStep(currentCommunicationPoint=time_s, communicationStepSize=STEP_S)
            force_n, slope = twin.getFloat64(wanted)
            time_s += STEP_S
            # Newton's step to the wanted force where there is contact; full supply before.
            goal_mpa = pressure_mpa + (given.force_n - force_n) / slope if slope > 0.0 else SUPPLY_MPA
            opening = min(max(goal_mpa, 0.0), SUPPLY_MPA)
            pressure_mpa += (opening - pressure_mpa) * STEP_S / TIME_CONSTANT_S
        (status,) = twin.getInt32([number["domain_status"]])
        tip = twin.getFloat64([number["tip.x"], number["tip.y"]])
        print(f"{force_n:.4f} N at {pressure_mpa:.5f} MPa after {time_s:.3f} s; tip {tip[0]:.2f}, {tip[1]:.2f} mm; domain {status}")
        twin.terminate()
        twin.freeInstance()


if __name__ == "__main__":
    main()
