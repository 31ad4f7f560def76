"""A program's place in a shared-memory domain."""

import os
from typing import Any, Optional

from . import _native
from ._native import kind_of, now_ns

__all__ = ["Bus", "default_bus", "kind_of", "now_ns"]


class Bus:
    """Membership in a shared-memory domain. The functions of this package create one on demand; create another to name the domain.

    The default domain is `$SOFTTWIN_DOMAIN` (with its folder `$SOFTTWIN_ROOT`), or the user's own: the same rule as of the
    programs `softtwin` and `softtwind`. After a fork it belongs to the parent.

    >>> "softtwin/finger/state" in Bus().topics
    True
    """

    def __init__(self, domain: Optional[str] = None, root: Optional[str] = None) -> None:
        self._process = os.getpid()
        self._native: Any = _native.Bus(domain or None, root or None)
        given = {"SOFTTWIN_DOMAIN": domain, "SOFTTWIN_ROOT": root}
        #: Variables with which a program joins the same domain.
        self.environment = {name: value for name, value in given.items() if value}

    @property
    def folder(self) -> str:
        """Folder of the domain's management files."""
        return str(self._native.folder)

    @property
    def topics(self) -> "list[str]":
        """Names of the domain's topics."""
        return list(self._native.topics())

    def __repr__(self) -> str:
        return f"Bus(folder={self.folder!r})"


_default: Optional[Bus] = None


def default_bus() -> Bus:
    """Default bus of the functions."""
    global _default
    if _default is None or _default._process != os.getpid():  # after a fork: the parent's
        _default = Bus()
    return _default
