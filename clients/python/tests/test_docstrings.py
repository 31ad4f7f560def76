"""Each public class and function has an example in its docstring, and the examples run."""

import ctypes
import inspect
import pathlib
import re
import subprocess
import sys

import pytest
import softtwin
from conftest import REPOSITORY

PACKAGE = pathlib.Path(softtwin.__file__).parent
#: Results, which the example of what returns them shows.
RESULTS = {"Comparison", "Cycle", "SimulatedState", "Material"}


def public():
    """Names of classes and functions, without exceptions and the structures of the wire."""
    for name in softtwin.__all__:
        found = getattr(softtwin, name)
        is_plain = inspect.isclass(found) and issubclass(found, (BaseException, ctypes.Structure))
        if not is_plain and name not in RESULTS and name != "now_ns":
            yield name, found


def test_every_public_name_has_an_example():
    def texts(found):
        yield found.__doc__ or ""
        yield from ((member.__doc__ or "") for _, member in inspect.getmembers(found, callable))

    without = [name for name, found in public() if not any(">>>" in text for text in texts(found))]
    assert not without
    assert len(list(public())) > 20


def test_the_examples_run(live):
    optional = ["--ignore", str(PACKAGE / "convert"), "--ignore", str(PACKAGE / "paraview.py")]
    for module, needs in (("environment", "gymnasium"), ("regressor", "sklearn")):
        try:
            __import__(needs)
        except ImportError:
            optional += ["--ignore", str(PACKAGE / f"{module}.py")]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--doctest-modules", *optional, str(PACKAGE)]
    environment = dict(live.environment(), PYTHONPATH=str(PACKAGE.parent))
    done = subprocess.run(command, env=environment, cwd=REPOSITORY, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr
    passed = int(re.search(r"(\d+) passed", done.stdout)[1])
    assert passed >= 20, done.stdout
