"""Time of an FMU's step in contact per set of outputs, and of a whole field of the same model, in us, as one JSON object.

    softtwin export models/pneunet/pneunet.twin --out finger.fmu --node tip=9696
    python3 studies/python/fmu_step.py finger.fmu models/pneunet/pneunet.twin     # needs fmpy and the Python client

FMPy's overhead is subtracted: the time of a step with unchanged inputs, for which nothing is computed.
"""

import json
import sys
import tempfile
import time

import fmpy
import numpy as np
import softtwin
from fmpy.fmi3 import FMU3Slave

PRESSURES_MPA = np.linspace(0.04, 0.06, 100)
ROUNDS = 100


def microseconds(fmu, number, outputs, pressures_mpa):
    """Smallest mean over the rounds of one step with these outputs."""
    wanted, inputs, best = [number[name] for name in outputs], [number["pressure_mpa"]], np.inf
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for pressure_mpa in pressures_mpa:
            fmu.setFloat64(inputs, [pressure_mpa])
            fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.001)
            fmu.getFloat64(wanted)
        best = min(best, (time.perf_counter() - began) / len(pressures_mpa) * 1e6)
    return best


def main(archive, path):
    description = fmpy.read_model_description(archive)
    number = {v.name: v.valueReference for v in description.modelVariables}
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(archive, folder)
        identifier = description.coSimulation.modelIdentifier
        fmu = FMU3Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="finger")
        fmu.instantiate()
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        fmu.setFloat64([number["gap_mm"]], [30.0])
        outputs = {"force": ["contact_force_n"], "tip": ["tip.x"], "max_von_mises": ["max_von_mises_mpa"]}
        outputs["everything"] = [v.name for v in description.modelVariables if v.causality == "output" and v.type == "Float64"]
        still = [0.05] * len(PRESSURES_MPA)
        found = {
            f"{what}_us": microseconds(fmu, number, names, PRESSURES_MPA) - microseconds(fmu, number, names, still)
            for what, names in outputs.items()
        }
        fmu.terminate()
        fmu.freeInstance()
    model, field = softtwin.Model(path), np.inf
    for pressure_mpa in np.tile(PRESSURES_MPA, 5):
        began = time.perf_counter()
        model.predict(pressure_mpa, 30.0)
        field = min(field, (time.perf_counter() - began) * 1e6)
    print(json.dumps({name: round(us, 1) for name, us in {**found, "whole_field_us": field}.items()}))


main(*sys.argv[1:])
