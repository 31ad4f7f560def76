"""The structures agree with docs/wire.md, which a Rust test compares with the code."""

import ctypes
import pathlib
import re

import pytest
from softtwin import layout, payload

PAGE = (pathlib.Path(__file__).resolve().parents[3] / "docs/wire.md").read_text()
SIZES = {"u8": 1, "u32": 4, "f32": 4, "u64": 8, "f64": 8}


def documented(name):
    section = PAGE.split(f"### `{name}`, ")[1].split("\n### ")[0]
    rows = re.findall(r"^\| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)` \|", section, re.M)
    size = int(section.split(" ")[0])
    return size, [(field, int(offset), SIZES[kind] * int(count or 1)) for offset, kind, count, field in rows]


@pytest.mark.parametrize("structure", layout.PAYLOADS, ids=lambda structure: structure.__name__)
def test_offsets_agree_with_wire_md(structure):
    size, rows = documented(structure.type_name())
    ours = [(name, getattr(structure, name).offset, getattr(structure, name).size) for name, *_ in structure._fields_]
    assert ours == rows
    assert ctypes.sizeof(structure) == size
    assert ctypes.alignment(structure) == 8


@pytest.mark.parametrize("structure", [layout.State, layout.FieldHeader])
def test_inputs_have_names_values_and_sources(structure):
    sample = structure()
    sample.input_count = 2
    for at, (name, value, source) in enumerate([("pressure_mpa", 0.05, 1), ("elastomer.law.mu_mpa", 0.72, 2)]):
        sample.input_names[32 * at : 32 * at + 32] = payload.pack(name)
        sample.inputs[at], sample.input_sources[at] = value, source
    expected = {"pressure_mpa": (0.05, "measured"), "elastomer.law.mu_mpa": (0.72, "given")}
    assert sample.input_values == expected
    sample.input_sources[1] = 99
    assert sample.input_values["elastomer.law.mu_mpa"] == (0.72, "unknown")
    assert layout.Answer().input_values == {} and layout.Health().input_values == {}


def test_names_are_packed_and_read_back():
    assert payload.text(payload.pack("finger")) == "finger"
    with pytest.raises(ValueError, match="at most 31"):
        payload.pack("x" * 32)
    assert layout.State(flags=0b1000_0001).flag_names == ["stale", "no-data"]
    assert layout.State(regime=2).regime_name == "contact"


def test_absent_numbers_are_none_in_plain_values():
    state = layout.State(contact_force_n=float("nan"), pressure_mpa=0.05, onset_pressure_mpa=float("inf"))
    state.inputs[:2] = [2.6, float("nan")]
    plain = state.to_dict()
    assert plain["contact_force_n"] is None and plain["pressure_mpa"] == 0.05 and plain["onset_pressure_mpa"] == float("inf")
    assert plain["inputs"][:2] == [2.6, None]
