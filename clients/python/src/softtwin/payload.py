"""Base class of all payloads; the payloads are in `layout`, which is generated."""

import ctypes
from typing import Dict, List, Set, Tuple

from ctypes import c_uint8 as u8


def text(packed: "ctypes.Array[u8]") -> str:
    """A zero-padded name."""
    return bytes(packed).split(b"\0", 1)[0].decode("utf-8", "replace")


def pack(name: str) -> "ctypes.Array[u8]":
    """Name in a payload: at most 31 bytes, zero-padded."""
    raw = name.encode()
    if len(raw) > 31:
        raise ValueError(f"`{name}` has {len(raw)} bytes; expected at most 31")
    return (u8 * 32)(*raw)


class Payload(ctypes.Structure):
    """A payload: its type name, and names instead of numbers."""

    _type: str = ""
    _texts: Set[str] = set()
    _text_lists: Dict[str, str] = {}
    _hashes: Set[str] = set()
    _names: Dict[str, Dict[int, str]] = {}

    @classmethod
    def type_name(cls) -> str:
        """Name on the wire; programs of different layouts refuse each other by it."""
        return cls._type

    def name_of(self, field: str) -> str:
        """The name of the number in a field, such as `contact` for `regime`; `unknown` when it has none."""
        return self._names.get(field, {}).get(getattr(self, field, -1), "unknown")

    @property
    def flag_names(self) -> List[str]:
        """The names of the set flags."""
        bits = getattr(self, "flags", 0)
        return [name for bit, name in self._names.get("flags", {}).items() if bits & bit]

    def text_list(self, field: str) -> List[str]:
        """The names in a field of several, such as `names` of an estimate."""
        packed = bytes(getattr(self, field))
        count = int(getattr(self, self._text_lists[field]))
        pieces = (packed[32 * at : 32 * at + 32] for at in range(count))
        return [piece.split(b"\0", 1)[0].decode("utf-8", "replace") for piece in pieces]

    def names_of(self, field: str) -> List[str]:
        """The names of the numbers in a list, such as `measured` and `given` in `input_sources` of a state."""
        names = self._names.get(field, {})
        return [names.get(number, "unknown") for number in getattr(self, field)]

    @property
    def input_values(self) -> Dict[str, Tuple[float, str]]:
        """Value of each model input of a state, field or answer, and its source: `measured`, `given`,
        `nominal`, `estimated`; `unknown` in an answer. Of a reading its named inputs. Empty for other payloads."""
        if "input_names" not in self._text_lists:
            return {}
        names = self.text_list("input_names")
        sources = self.names_of("input_sources") if hasattr(self, "input_sources") else ["unknown"] * len(names)
        return {name: (value, source) for name, value, source in zip(names, getattr(self, "inputs"), sources)}

    @property
    def observable_values(self) -> Dict[str, Tuple[float, float]]:
        """Value and half-width of each observable of a state or an answer, such as a bending angle. Empty for other payloads."""
        if "observable_names" not in self._text_lists:
            return {}
        pairs = zip(getattr(self, "observables"), getattr(self, "observable_halfwidths"))
        return dict(zip(self.text_list("observable_names"), pairs))

    @property
    def regime_name(self) -> str:
        """`free`, `contact` or `unknown`."""
        return self.name_of("regime")

    @property
    def grasp_status_name(self) -> str:
        """`held`, `held, within the half-width`, `not held` or `unknown`."""
        return self.name_of("grasp_status")

    def to_dict(self) -> Dict[str, object]:
        """All fields as plain Python values; an absent number (NaN) is None."""
        absent = lambda number: None if number != number else number  # noqa: E731
        plain: Dict[str, object] = {}
        for name, *_ in self._fields_:
            value = getattr(self, name)
            if name in self._texts:
                value = text(value)
            elif name in self._text_lists:
                value = self.text_list(name)
            elif name in self._hashes:
                value = bytes(value).hex()
            elif isinstance(value, ctypes.Array):
                value = [absent(number) for number in value]
            else:
                value = absent(value)
            plain[name] = value
        return plain

    def __repr__(self) -> str:
        body = ", ".join(f"{name}={value!r}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({body})"
