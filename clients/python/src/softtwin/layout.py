"""The wire's payloads as ctypes structures; offsets, units and meanings are in docs/wire.md, which the tests compare."""

import ctypes
from ctypes import c_double as f64
from ctypes import c_float as f32
from ctypes import c_uint8 as u8
from ctypes import c_uint32 as u32
from ctypes import c_uint64 as u64
from typing import Dict, List

VERSION = 2
"""Layout version; it is part of every type name."""

FIELD_NAMES: Dict[int, str] = {1: "x", 2: "y", 3: "z", 4: "displacement", 5: "von_mises"}
"""Fields by their number on the wire."""

REGIMES: Dict[int, str] = {0: "unknown", 1: "free", 2: "contact"}
"""Regimes by number."""

GRASP_VERDICTS: Dict[int, str] = {0: "unknown", 1: "not held", 2: "held, within the error bar", 3: "held"}
"""Verdicts of a grasp by number."""

QUERY_KINDS: Dict[str, int] = {"whatif": 1, "pressure": 2, "gap": 3}
"""Kinds of questions."""

FLAGS: List[str] = [
    "stale",
    "held",
    "near-edge",
    "outside-domain",
    "force-measured",
    "force-mismatch",
    "late",
    "no-data",
    "coefficients-cut",
    "force-clamped",
    "regime-held",
]
"""Flags by bit."""


def text(packed: "ctypes.Array[u8]") -> str:
    """A zero-padded name."""
    return bytes(packed).split(b"\0", 1)[0].decode("utf-8", "replace")


def pack(name: str) -> "ctypes.Array[u8]":
    """A name as it travels: at most 31 bytes, zero-padded."""
    raw = name.encode()
    if len(raw) > 31:
        raise ValueError(f"`{name}` has {len(raw)} bytes; expected at most 31")
    return (u8 * 32)(*raw)


def flag_names(bits: int) -> List[str]:
    """The names of the set flags."""
    return [name for bit, name in enumerate(FLAGS) if bits >> bit & 1]


class Payload(ctypes.Structure):
    """What all payloads share: their type name, and names instead of numbers."""

    _type: str = ""

    @classmethod
    def type_name(cls) -> str:
        """Name on the wire; programs of different layouts refuse each other by it."""
        return f"softtwin.{cls._type}.v{VERSION}"

    @property
    def flag_names(self) -> List[str]:
        """The names of the set flags."""
        return flag_names(getattr(self, "flags", 0))

    @property
    def regime_name(self) -> str:
        """`free`, `contact` or `unknown`."""
        return REGIMES.get(getattr(self, "regime", 0), "unknown")

    def to_dict(self) -> Dict[str, object]:
        """All fields as plain Python values."""
        plain: Dict[str, object] = {}
        for name, *_ in self._fields_:
            value = getattr(self, name)
            if name in ("actuator", "node_set", "scene"):
                value = text(value)
            elif name == "model_hash":
                value = bytes(value).hex()
            elif isinstance(value, ctypes.Array):
                value = list(value)
            plain[name] = value
        return plain

    def __repr__(self) -> str:
        body = ", ".join(f"{name}={value!r}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({body})"


class SensorSample(Payload):
    """One reading."""

    _type = "SensorSample"
    _fields_ = [
        ("boot_id", u64),
        ("seq", u64),
        ("t_sensor_ns", u64),
        ("pressure_mpa", f64),
        ("gap_mm", f64),
        ("measured_force_n", f64),
        ("t_trace_s", f64),
        ("status", u32),
        ("reserved", u32),
    ]


class FieldHeader(Payload):
    """What stands before every field."""

    _type = "FieldHeader"
    _fields_ = [
        ("layout_version", u32),
        ("flags", u32),
        ("model_hash", u8 * 16),
        ("boot_id", u64),
        ("seq", u64),
        ("sensor_boot_id", u64),
        ("sensor_seq", u64),
        ("t_sensor_ns", u64),
        ("t_publish_ns", u64),
        ("pressure_mpa", f64),
        ("gap_mm", f64),
        ("contact_force_n", f64),
        ("max_von_mises_mpa", f64),
        ("max_von_mises_node", u32),
        ("regime", u32),
        ("node_count", u32),
        ("field_count", u32),
        ("field_ids", u8 * 16),
        ("node_set", u8 * 32),
    ]


class State(Payload):
    """The small state that a controller needs."""

    _type = "State"
    _fields_ = [
        ("layout_version", u32),
        ("flags", u32),
        ("model_hash", u8 * 16),
        ("boot_id", u64),
        ("seq", u64),
        ("sensor_boot_id", u64),
        ("sensor_seq", u64),
        ("t_sensor_ns", u64),
        ("t_publish_ns", u64),
        ("age_ns", u64),
        ("pressure_mpa", f64),
        ("gap_mm", f64),
        ("contact_force_n", f64),
        ("force_by_pressure_n_per_mpa", f64),
        ("force_by_gap_n_per_mm", f64),
        ("onset_pressure_mpa", f64),
        ("measured_force_n", f64),
        ("force_halfwidth_n", f32),
        ("displacement_halfwidth_mm", f32),
        ("von_mises_halfwidth_mpa", f32),
        ("domain_distance", f32),
        ("regime", u32),
        ("outcome", u32),
        ("domain_status", u32),
        ("coefficient_count", u32),
        ("group_sizes", u8 * 8),
        ("coefficients", f32 * 128),
        ("actuator", u8 * 32),
        ("reserved", u64 * 4),
    ]


class Health(Payload):
    """How a twin is doing, once a second."""

    _type = "Health"
    _fields_ = [
        ("layout_version", u32),
        ("flags", u32),
        ("model_hash", u8 * 16),
        ("boot_id", u64),
        ("seq", u64),
        ("t_publish_ns", u64),
        ("uptime_ns", u64),
        ("sensor_boot_id", u64),
        ("received", u64),
        ("missed", u64),
        ("sensor_restarts", u64),
        ("deadline_misses", u64),
        ("fields_sent", u64),
        ("states_sent", u64),
        ("late", u64),
        ("log_lost", u64),
        ("age_ns", u64),
        ("rate_hz", f64),
        ("latency_p50_ns", u64),
        ("latency_p99_ns", u64),
        ("latency_max_ns", u64),
        ("compute_p50_ns", u64),
        ("compute_p99_ns", u64),
        ("compute_max_ns", u64),
        ("outcomes", u64 * 24),
        ("actuator", u8 * 32),
    ]


class Grasp(Payload):
    """Whether a gripper holds its object."""

    _type = "Grasp"
    _fields_ = [
        ("layout_version", u32),
        ("flags", u32),
        ("boot_id", u64),
        ("seq", u64),
        ("t_sensor_ns", u64),
        ("t_publish_ns", u64),
        ("verdict", u32),
        ("finger_count", u32),
        ("mass_kg", f64),
        ("friction", f64),
        ("safety", f64),
        ("needed_force_n", f64),
        ("least_force_n", f64),
        ("margin", f64),
        ("needed_friction", f64),
        ("stop_pressure_mpa", f64),
        ("stop_pressure_bar_mpa", f64),
        ("forces_n", f64 * 8),
        ("pressures_mpa", f64 * 8),
        ("force_halfwidth_n", f64),
        ("reserved", u64 * 3),
        ("scene", u8 * 32),
    ]

    @property
    def verdict_name(self) -> str:
        """`held`, `held, within the error bar`, `not held` or `unknown`."""
        return GRASP_VERDICTS.get(self.verdict, "unknown")


class Command(Payload):
    """What a controller wants of a pressure source."""

    _type = "Command"
    _fields_ = [
        ("boot_id", u64),
        ("seq", u64),
        ("t_sensor_ns", u64),
        ("t_publish_ns", u64),
        ("pressure_mpa", f64),
        ("reserved", u64),
    ]


class Query(Payload):
    """A question to a twin."""

    _type = "Query"
    _fields_ = [
        ("layout_version", u32),
        ("kind", u32),
        ("want_field", u32),
        ("reserved", u32),
        ("pressure_mpa", f64),
        ("gap_mm", f64),
        ("force_n", f64),
        ("force_halfwidth_n", f64),
        ("node_set", u8 * 32),
    ]


class Answer(Payload):
    """The answer; the field, when one was wanted, follows as payload."""

    _type = "Answer"
    _fields_ = [
        ("layout_version", u32),
        ("verdict", u32),
        ("model_hash", u8 * 16),
        ("kind", u32),
        ("regime", u32),
        ("domain_status", u32),
        ("flags", u32),
        ("compute_ns", u64),
        ("pressure_mpa", f64),
        ("gap_mm", f64),
        ("contact_force_n", f64),
        ("force_by_pressure_n_per_mpa", f64),
        ("force_by_gap_n_per_mm", f64),
        ("onset_pressure_mpa", f64),
        ("uncertainty", f64),
        ("low", f64),
        ("high", f64),
        ("limit", f64),
        ("force_halfwidth_n", f32),
        ("displacement_halfwidth_mm", f32),
        ("von_mises_halfwidth_mpa", f32),
        ("domain_distance", f32),
        ("coefficient_count", u32),
        ("node_count", u32),
        ("field_count", u32),
        ("max_von_mises_node", u32),
        ("max_von_mises_mpa", f64),
        ("field_ids", u8 * 16),
        ("group_sizes", u8 * 8),
        ("coefficients", f32 * 128),
        ("node_set", u8 * 32),
        ("actuator", u8 * 32),
    ]


PAYLOADS = [SensorSample, FieldHeader, State, Health, Grasp, Command, Query, Answer]
"""All structures, for the tests."""
