"""Cards of the shipped models: valid by their schema, and as submodels for another reader."""

import json
import subprocess

import basyx.aas.adapter.json as aas_json
import jsonschema
import pytest
from conftest import PROGRAMS, REPOSITORY

MODELS = sorted(REPOSITORY.glob("models/*/*.twin"))


@pytest.mark.parametrize("model", MODELS, ids=lambda path: path.stem)
def test_a_card_fits_its_schema_and_is_a_submodel(model, tmp_path):
    schema = json.loads((REPOSITORY / "docs/card.schema.json").read_text())
    card = json.loads(model.with_suffix(".card.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(card, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**card, "inputs": card["inputs"][:1]}, schema)
    done = subprocess.run([PROGRAMS / "softtwin", "inspect", model, "--card", "aas"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    environment = tmp_path / "environment.json"
    environment.write_text(json.dumps({"submodels": [json.loads(done.stdout)]}))
    (submodel,) = aas_json.read_aas_json_file(str(environment), failsafe=False)
    simulation = submodel.get_referable("SimulationModel00")
    ports = simulation.get_referable("Ports")
    names = [port.get_referable("VariableName").value for port in ports]
    assert names[: len(card["inputs"])] == [one["name"] for one in card["inputs"]] and "von_mises" in names
    assert simulation.get_referable("LicenseModel").value == card["licence"] == "MIT OR Apache-2.0"


def test_there_are_models():
    assert len(MODELS) >= 2
