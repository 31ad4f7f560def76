"""Builds the wheel: the native module by maturin, and beside it the programs and the shipped model.

`MATURIN_PEP517_ARGS="--profile dev"` builds with another profile than `release`.
"""

import os
import pathlib
import shlex
import shutil
import subprocess
from typing import Any

import maturin
from maturin import build_sdist, get_requires_for_build_sdist, get_requires_for_build_wheel

__all__ = ["build_editable", "build_sdist", "build_wheel", "get_requires_for_build_sdist", "get_requires_for_build_wheel"]

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = ["softtwin", "softtwind", "softtwin-demo"]


def _put_beside(profile: str) -> None:
    """Programs and model where maturin takes the wheel's data from."""
    # One call, so that nothing is compiled twice.
    packages = [argument for package in ("softtwin", "softtwind", "python") for argument in ("--package", package)]
    subprocess.run(["cargo", "build", "--locked", "--profile", profile, *packages], cwd=ROOT, check=True)
    data = ROOT / "target/wheel/softtwin.data"
    shutil.rmtree(data, ignore_errors=True)
    (data / "scripts").mkdir(parents=True)
    built = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / ("debug" if profile == "dev" else profile)
    for program in PROGRAMS:
        subprocess.run(["strip", "-o", data / "scripts" / program, built / program], check=True)
    share = [ROOT / "scripts/package.sh", "share", data / "data/share/softtwin", "pneunet"]
    subprocess.run(share, cwd=ROOT, check=True)


def _profile() -> str:
    given = shlex.split(os.environ.get("MATURIN_PEP517_ARGS", ""))
    return given[given.index("--profile") + 1] if "--profile" in given else "release"


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    _put_beside(_profile())
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    _put_beside(_profile())
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
