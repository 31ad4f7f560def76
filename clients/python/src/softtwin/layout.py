"""The wire's payloads as ctypes structures, made from the tables of the native module. docs/wire.md lists them with their units."""

import ctypes
from typing import Any, Dict, List, Type

from ._native import codes, layouts
from .payload import Payload, pack, text

_SCALARS: Dict[str, Any] = {
    "u8": ctypes.c_uint8,
    "u32": ctypes.c_uint32,
    "u64": ctypes.c_uint64,
    "f32": ctypes.c_float,
    "f64": ctypes.c_double,
}

LAYOUT_VERSION, _structures = layouts()
FIELD_NAMES: Dict[int, str] = dict(codes("fields"))
REGIMES: Dict[int, str] = dict(codes("regimes"))
DOMAIN_STATUSES: Dict[int, str] = dict(codes("domain statuses"))
QUERY_STATUSES: Dict[int, str] = dict(codes("query statuses"))
FLAGS: Dict[int, str] = dict(codes("flags"))
QUERY_KINDS: Dict[str, int] = {name: number for number, name in codes("queries")}


def _structure(name: str, type_name: str, meaning: str, fields: List[Any]) -> Type[Payload]:
    def shown(*ways: str) -> List[Any]:
        return [field for field in fields if field[3][0] in ways]

    body = {
        "__doc__": meaning.strip(),
        "__module__": __name__,
        "_type": type_name,
        "_fields_": [(field, _SCALARS[kind] * count if count > 1 else _SCALARS[kind]) for field, kind, count, _, _ in fields],
        "_texts": {field for field, *_ in shown("name")},
        "_hashes": {field for field, kind, *_ in shown("hex") if kind == "u8"},
        "_text_lists": {field: count for field, _, _, (_, count), _ in shown("names")},
        "_names": {field: dict(names) for field, _, _, _, names in shown("code", "codes", "flags")},
    }
    return type(name, (Payload,), body)


PAYLOADS: List[Type[Payload]] = [_structure(*structure) for structure in _structures]
globals().update({payload.__name__: payload for payload in PAYLOADS})
