"""Programs and files that the built wheel carries: the daemon, the demonstration, the C library, a model.

`pip install` of the sources has none of them, only the client.
"""

import os
import pathlib
import sys
from typing import NoReturn

from .errors import SofttwinError

_HERE = pathlib.Path(__file__).resolve().parent


def carried(path: str) -> pathlib.Path:
    """The file of the wheel at `path`, for example `lib/libsofttwin.so.0` or `share/config/scenes/finger.toml`."""
    found = _HERE / "carried" / path
    if not found.exists():
        raise SofttwinError(
            f"expected {path} in this installation of softtwin, found none: only the wheel carries programs and files; make it "
            "with scripts/package.sh wheel in the sources and install that file"
        )
    return found


def _become(name: str) -> NoReturn:
    """Replaces this process by a program of the wheel, which finds scene and model in the wheel as well."""
    try:
        program = carried(f"bin/{name}")
        os.environ.setdefault("SOFTTWIN_SHARE", str(carried("share")))
    except SofttwinError as error:
        sys.exit(f"{name}: {error}")
    os.execv(program, [name, *sys.argv[1:]])


def softtwind() -> NoReturn:
    """The command `softtwind`: the daemon."""
    _become("softtwind")


def demo() -> NoReturn:
    """The command `softtwin-demo`: a recorded pressure trace becomes live fields."""
    _become("softtwin-demo")
