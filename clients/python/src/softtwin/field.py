"""Fields as numpy views that keep their shared memory."""

import ctypes
from typing import Any, Dict, List, Union

import numpy as np

from .layout import FIELD_NAMES, Answer, FieldHeader, text
from .start import Holder, hold


class _Keeper(Holder):
    """Memory of a sample for numpy: the sample lives as long as any view.

    numpy keeps the object whose `__array_interface__` it read; that object keeps the sample.
    """

    def __init__(self, sample: Any, address: int, shape: Any) -> None:
        self._sample = sample
        hold(self)
        self.__array_interface__ = {
            "version": 3,
            "typestr": "<f4",
            "shape": shape,
            "data": (address, True),  # read-only: the pages are mapped so
        }


def view(sample: Any, address: int, fields: int, nodes: int) -> np.ndarray:
    """The values of a sample as a read-only array of shape (fields, nodes), without a copy."""
    if fields * nodes == 0:
        return np.empty((fields, nodes), dtype=np.float32)
    return np.asarray(_Keeper(sample, address, (fields, nodes)))


class Field:
    """One field sample: `field.x`, `field.von_mises`, ... are read-only views of shared memory, one value per node.

    A view keeps its sample: at most four samples of a topic can be held at the same time, so drop them (or copy) before
    asking for more.
    """

    def __init__(self, sample: Any, header: Union[FieldHeader, Answer], address: int) -> None:
        #: Header of the field; a copy, valid without the sample.
        self.header = header
        #: All values, shape (fields, nodes).
        self.values = view(sample, address, header.field_count, header.node_count)

    @property
    def names(self) -> List[str]:
        """The fields in their order."""
        ids = list(self.header.field_ids)[: self.header.field_count]
        return [FIELD_NAMES.get(number, f"other{number}") for number in ids]

    @property
    def node_set(self) -> str:
        """Name of the node set; `all` for all nodes."""
        return text(self.header.node_set)

    def __getitem__(self, name: str) -> np.ndarray:
        names = self.names
        if name not in names:
            raise KeyError(f"this field has {', '.join(names)}, not `{name}`")
        return self.values[names.index(name)]

    def __getattr__(self, name: str) -> np.ndarray:
        if name in FIELD_NAMES.values():
            try:
                return self[name]
            except KeyError as error:
                raise AttributeError(str(error)) from None
        raise AttributeError(f"{type(self).__name__} has no attribute `{name}`")

    def as_dict(self) -> Dict[str, np.ndarray]:
        """Views by name."""
        return dict(zip(self.names, self.values))

    def __repr__(self) -> str:
        return f"Field(seq={getattr(self.header, 'seq', None)}, {self.header.node_count} nodes x {self.names})"


def copy_of(kind: Any, address: int) -> Any:
    """A payload copied out of shared memory (at most 768 bytes)."""
    return kind.from_buffer_copy(ctypes.string_at(address, ctypes.sizeof(kind)))
