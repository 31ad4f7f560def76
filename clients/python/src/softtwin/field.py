"""Fields in shared memory as numpy arrays, without a copy."""

from typing import Any, Dict, List, Union

import numpy as np

from .layout import FIELD_NAMES, Answer, FieldHeader
from .payload import text


class Field:
    """One field sample: `field.x`, `field.von_mises`, ... are read-only views of shared memory, one value per node.

    A view keeps its sample: at most four samples of a topic can be held at the same time, so drop them (or copy) before
    asking for more.

    >>> from softtwin import newest
    >>> field = newest("softtwin/finger/field")
    >>> field.node_set, field.values.shape, field.x.flags.writeable
    ('all', (5, 25022), False)
    """

    def __init__(self, sample: Any, header: Union[FieldHeader, Answer]) -> None:
        #: Header of the field; a copy, valid without the sample.
        self.header = header
        #: All values, shape (fields, nodes).
        self.values: "np.ndarray[Any, Any]" = np.asarray(sample)

    @property
    def names(self) -> List[str]:
        """The fields in their order."""
        ids = list(self.header.field_ids)[: self.header.field_count]
        return [FIELD_NAMES.get(number, f"other{number}") for number in ids]

    @property
    def node_set(self) -> str:
        """Name of the node set; `all` for all nodes."""
        return text(self.header.node_set)

    def __getitem__(self, name: str) -> "np.ndarray[Any, Any]":
        names = self.names
        if name not in names:
            raise KeyError(f"this field has {', '.join(names)}, not `{name}`")
        found: "np.ndarray[Any, Any]" = self.values[names.index(name)]
        return found

    def __getattr__(self, name: str) -> "np.ndarray[Any, Any]":
        if name in FIELD_NAMES.values():
            try:
                return self[name]
            except KeyError as error:
                raise AttributeError(str(error)) from None
        raise AttributeError(f"{type(self).__name__} has no attribute `{name}`")

    def as_dict(self) -> "Dict[str, np.ndarray[Any, Any]]":
        """Views by name."""
        return dict(zip(self.names, self.values))

    def __repr__(self) -> str:
        return f"Field(seq={getattr(self.header, 'seq', None)}, {self.header.node_count} nodes x {self.names})"
