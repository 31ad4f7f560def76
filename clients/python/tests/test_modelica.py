"""The Modelica example in a Modelica parser: valid syntax, and its names exist in the FMU. No simulation."""

import subprocess

import fmpy
import pytest
from conftest import PROGRAMS, REPOSITORY
from pymoca import ast, parser, tree

EXAMPLE = REPOSITORY / "clients/fmi/Valve.mo"


@pytest.fixture(scope="module")
def variables(tmp_path_factory):
    """Causality of the FMU's variables by name."""
    path = tmp_path_factory.mktemp("fmu") / "finger.fmu"
    model = REPOSITORY / "models/pneunet/pneunet.twin"
    subprocess.run([PROGRAMS / "softtwin", "export", model, "--out", path], check=True, capture_output=True)
    return {variable.name: variable.causality for variable in fmpy.read_model_description(path).modelVariables}


class Named(tree.TreeListener):
    """Variables of a component that a model names."""

    def __init__(self, component):
        super().__init__()
        self.component, self.names = component, []

    def enterComponentRef(self, reference):
        if reference.name == self.component and reference.child:
            self.names.append(reference.child[0].name)


def named(model):
    found = Named("twin")
    tree.TreeWalker().walk(found, model)
    return found.names


def test_the_example_is_modelica_and_names_what_the_fmu_has(variables):
    text = EXAMPLE.read_text()
    model = parser.parse(text).classes["Valve"]
    assert set(named(model)) == {"pressure_mpa", "gap_mm", "domain_status"}
    left = [equation.left for equation in model.equations if isinstance(equation, ast.Equation)]
    set_by_equations = {side.child[0].name for side in left if isinstance(side, ast.ComponentRef) and side.name == "twin"}
    assert {name: variables[name] for name in named(model)} == {"pressure_mpa": "input", "gap_mm": "input", "domain_status": "output"}
    assert set_by_equations == {name for name, causality in variables.items() if causality == "input"}
    # With the interface instead of the import the model has as many equations as unknowns.
    interface = "".join(f"  {variables[name]} Real {name};\n" for name in sorted(set(named(model))))
    whole = parser.parse(f"model finger\n{interface}equation\n  domain_status = 0 * (pressure_mpa + gap_mm);\nend finger;\n{text}")
    flat = tree.flatten(whole, ast.ComponentRef.from_string("Valve")).classes["Valve"]
    equations = [equation for equation in flat.equations if isinstance(equation, ast.Equation)]
    unknowns = [name for name, symbol in flat.symbols.items() if "parameter" not in symbol.prefixes]
    assert len(equations) == len(unknowns), (equations, unknowns)


@pytest.mark.parametrize(("good", "wrong"), [("end when;", "end wen;"), ("equation", "equatoin"), ("der(pressure_mpa)", "der(pressure_mpa")])
def test_invalid_modelica_is_refused(good, wrong):
    assert good in EXAMPLE.read_text()
    with pytest.raises(parser.ModelicaSyntaxError):
        assert parser.parse(EXAMPLE.read_text().replace(good, wrong, 1)) is not None
