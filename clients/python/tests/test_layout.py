"""The structures agree with docs/wire.md, which a Rust test compares with the code."""

import ctypes
import pathlib
import re

import pytest
from softtwin import layout, qos

PAGE = (pathlib.Path(__file__).resolve().parents[3] / "docs/wire.md").read_text()
SIZES = {"u8": 1, "u32": 4, "f32": 4, "u64": 8, "f64": 8}


def documented(name):
    section = PAGE.split(f"### `{name}`, ")[1].split("\n### ")[0]
    rows = re.findall(r"^\| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)` \|", section, re.M)
    size = int(section.split(" ")[0])
    return size, [(field, int(offset), SIZES[kind] * int(count or 1)) for offset, kind, count, field in rows]


@pytest.mark.parametrize("payload", layout.PAYLOADS, ids=lambda payload: payload.__name__)
def test_offsets_agree_with_wire_md(payload):
    size, rows = documented(payload.type_name())
    ours = [(name, getattr(payload, name).offset, getattr(payload, name).size) for name, *_ in payload._fields_]
    assert ours == rows
    assert ctypes.sizeof(payload) == size
    assert ctypes.alignment(payload) == 8


def test_settings_agree_with_wire_md():
    for kind, q in qos.QOS.items():
        row = f"| {kind} | {q.max_readers} | {q.buffer} | {q.max_borrowed} | {q.history} | {q.max_nodes} |"
        assert row in PAGE
    assert f"`query`: {qos.MAX_CLIENTS} clients, 1 server, {qos.MAX_QUERY_NODES} nodes" in PAGE
    assert all(f"| {bit} | {name} |" in PAGE for bit, name in layout.FLAGS.items())


@pytest.mark.parametrize("payload", [layout.State, layout.FieldHeader])
def test_inputs_have_names_values_and_sources(payload):
    sample = payload()
    sample.input_count = 2
    for at, (name, value, source) in enumerate([("pressure_mpa", 0.05, 1), ("elastomer.law.mu_mpa", 0.72, 2)]):
        sample.input_names[32 * at : 32 * at + 32] = layout.pack(name)
        sample.inputs[at], sample.input_sources[at] = value, source
    expected = {"pressure_mpa": (0.05, "measured"), "elastomer.law.mu_mpa": (0.72, "given")}
    assert sample.input_values == expected
    sample.input_sources[1] = 99
    assert sample.input_values["elastomer.law.mu_mpa"] == (0.72, "unknown")
    assert layout.Answer().input_values == {} and layout.Health().input_values == {}


def test_names_are_packed_and_read_back():
    assert layout.text(layout.pack("finger")) == "finger"
    with pytest.raises(ValueError, match="at most 31"):
        layout.pack("x" * 32)
    assert layout.State(flags=0b1000_0001).flag_names == ["stale", "no-data"]
    assert layout.State(regime=2).regime_name == "contact"


def test_absent_numbers_are_none_in_plain_values():
    state = layout.State(contact_force_n=float("nan"), pressure_mpa=0.05, onset_pressure_mpa=float("inf"))
    state.inputs[:2] = [2.6, float("nan")]
    plain = state.to_dict()
    assert plain["contact_force_n"] is None and plain["pressure_mpa"] == 0.05 and plain["onset_pressure_mpa"] == float("inf")
    assert plain["inputs"][:2] == [2.6, None]
