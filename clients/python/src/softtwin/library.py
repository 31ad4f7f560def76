"""libsofttwin, the C library: structures and functions for models through ctypes."""

import ctypes
import os
from ctypes import POINTER, byref, c_char_p, c_double, c_float, c_int, c_size_t, c_uint32, c_uint64, c_void_p
from functools import lru_cache

from .errors import SofttwinError
from .programs import carried

MAX_INPUTS = 8
"""Largest number of inputs of a model."""

MAX_OBSERVABLES = 8
"""Largest number of observables of a model."""

_ARGUMENT, _REFUSED = 5, 7


class ModelInput(ctypes.Structure):
    """softtwin_model_input."""

    _fields_ = [("name", c_char_p), ("unit", c_char_p), ("min", c_double), ("max", c_double), ("value", c_double)]


class ModelField(ctypes.Structure):
    """softtwin_model_field."""

    _fields_ = [("name", c_char_p), ("unit", c_char_p)]


class ModelNodeSet(ctypes.Structure):
    """softtwin_model_node_set."""

    _fields_ = [("name", c_char_p), ("nodes", POINTER(c_uint32)), ("count", c_size_t)]


class ModelInfo(ctypes.Structure):
    """softtwin_model_info."""

    _fields_ = [
        ("actuator", c_char_p),
        ("inputs", POINTER(ModelInput)),
        ("input_count", c_size_t),
        ("fields", POINTER(ModelField)),
        ("field_count", c_size_t),
        ("node_count", c_size_t),
        ("model_node_count", c_size_t),
        ("node_sets", POINTER(ModelNodeSet)),
        ("node_set_count", c_size_t),
        ("undeformed_mm", POINTER(c_float) * 3),
        ("triangles", POINTER(c_uint32)),
        ("triangle_count", c_size_t),
        ("observables", POINTER(ModelField)),
        ("observable_count", c_size_t),
    ]


class PredictionRow(ctypes.Structure):
    """softtwin_prediction: one state's answer."""

    _fields_ = [
        ("contact_force_n", c_double),
        ("force_gradient", c_double * MAX_INPUTS),
        ("onset_pressure_mpa", c_double),
        ("force_halfwidth_n", c_double),
        ("displacement_halfwidth_mm", c_double),
        ("von_mises_halfwidth_mpa", c_double),
        ("coverage", c_double),
        ("domain_distance", c_double),
        ("max_displacement_mm", c_double),
        ("max_von_mises_mpa", c_double),
        ("max_displacement_node", c_uint32),
        ("max_von_mises_node", c_uint32),
        ("regime", c_uint32),
        ("domain_status", c_uint32),
        ("force_clamped", c_uint32),
        ("reserved", c_uint32),
        ("observables", c_double * MAX_OBSERVABLES),
        ("observable_halfwidths", c_double * MAX_OBSERVABLES),
        ("observable_offsets", c_double * MAX_OBSERVABLES),
    ]


class ControlReading(ctypes.Structure):
    """softtwin_control_reading."""

    _fields_ = [("pressure_mpa", c_double), ("gap_mm", c_double), ("measured", c_double), ("written_mpa", c_double)]


class ControlCycle(ctypes.Structure):
    """softtwin_control_cycle."""

    _fields_ = [
        ("setpoint_mpa", c_double),
        ("target", c_double),
        ("reference_mpa", c_double),
        ("followed", c_double),
        ("correction_mpa", c_double),
        ("bias_mpa", c_double),
        ("limited", c_uint32),
        ("fault", c_uint32),
    ]


@lru_cache(maxsize=None)
def library() -> ctypes.CDLL:
    """The library: `$SOFTTWIN_LIBRARY`, that of the wheel, or the one that the system's loader finds."""
    named = os.environ.get("SOFTTWIN_LIBRARY")
    try:
        path = named or str(carried("lib/libsofttwin.so.0"))
    except SofttwinError:
        path = "libsofttwin.so.0"
    try:
        found = ctypes.CDLL(path)
        _declare(found)
    except (OSError, AttributeError) as error:
        raise SofttwinError(
            f"expected the C library {path}, found none that fits: {error}. Install the wheel of scripts/package.sh wheel, or "
            "build it with `cargo build --release -p capi` and set SOFTTWIN_LIBRARY=target/release/libcapi.so"
        ) from error
    return found


def _declare(found: ctypes.CDLL) -> None:
    found.softtwin_last_error.restype = c_char_p
    found.softtwin_model_open.argtypes = [c_char_p, POINTER(c_void_p)]
    found.softtwin_model_select.argtypes = [c_void_p, c_char_p, c_char_p, c_void_p, c_size_t, POINTER(c_void_p)]
    found.softtwin_model_describe.argtypes = [c_void_p, POINTER(ModelInfo)]
    found.softtwin_model_predict.argtypes = [c_void_p, c_void_p, c_size_t, c_void_p, c_void_p]
    found.softtwin_model_close.argtypes = [c_void_p]
    found.softtwin_model_close.restype = None
    for name in ("open", "select", "describe", "predict"):
        getattr(found, f"softtwin_model_{name}").restype = c_int
    found.softtwin_motion_open.argtypes = [c_void_p, POINTER(c_void_p)]
    found.softtwin_motion_open.restype = c_int
    found.softtwin_motion_step.argtypes = [c_void_p, c_uint64, c_void_p, c_void_p, c_void_p]
    found.softtwin_motion_step.restype = c_int
    for name in ("reset", "close"):
        getattr(found, f"softtwin_motion_{name}").argtypes = [c_void_p]
        getattr(found, f"softtwin_motion_{name}").restype = None
    found.softtwin_control_open.argtypes = [c_void_p, c_char_p, c_char_p, c_char_p, POINTER(c_void_p)]
    found.softtwin_control_inputs.argtypes = [c_void_p, POINTER(c_double), c_size_t]
    found.softtwin_control_step.argtypes = [
        c_void_p,
        c_uint64,
        c_double,
        c_double,
        POINTER(ControlReading),
        POINTER(ControlCycle),
    ]
    found.softtwin_control_start.argtypes = [c_void_p, POINTER(ControlReading)]
    for name in ("open", "inputs", "step", "start"):
        getattr(found, f"softtwin_control_{name}").restype = c_int
    for name in ("release", "close"):
        getattr(found, f"softtwin_control_{name}").argtypes = [c_void_p]
        getattr(found, f"softtwin_control_{name}").restype = None
    found.softtwin_control_fault_name.argtypes = [c_uint32]
    found.softtwin_control_fault_name.restype = c_char_p


def check(status: int) -> None:
    """Raises the exception of a status, with the library's message."""
    if status == 0:
        return
    text = (library().softtwin_last_error() or b"").decode("utf-8", "replace")
    raise ValueError(text) if status in (_ARGUMENT, _REFUSED) else SofttwinError(text)


def open_model(path: "os.PathLike[str] | str") -> int:
    """The handle of a model file."""
    out = c_void_p()
    check(library().softtwin_model_open(os.fsencode(path), byref(out)))
    return out.value or 0
