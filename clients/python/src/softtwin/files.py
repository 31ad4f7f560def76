"""Files that come with the package: scenes, recorded traces, settings, the shipped model."""

import os
import pathlib
import sys

from .errors import SofttwinError

_HERE = pathlib.Path(__file__).resolve()


def shared_file(path: str) -> pathlib.Path:
    """The file at `path`, for example `models/pneunet/pneunet.twin` or `config/scenes/finger.toml`: below `$SOFTTWIN_SHARE`, or else of the
    installation or of the checkout that this package is in.

    >>> shared_file("config/scenes/finger.toml").name
    'finger.toml'
    """
    named = os.environ.get("SOFTTWIN_SHARE")
    folders = [pathlib.Path(named)] if named else [pathlib.Path(sys.prefix) / "share/softtwin", *_HERE.parents]
    for folder in folders:
        if (folder / path).is_file():
            return folder / path
    raise SofttwinError(f"expected {path} in one of {', '.join(map(str, folders[:2]))}; name a folder that has it in SOFTTWIN_SHARE")
