"""Builds the wheel: the native module by maturin, and beside it the programs and the shipped model; and the source distribution, from which
the same wheel is built elsewhere.

`MATURIN_PEP517_ARGS="--profile dev"` builds with another profile than `release`.
"""

import io
import os
import pathlib
import shlex
import shutil
import subprocess
import tarfile
import tempfile
from typing import Any, List

import maturin
from maturin import get_requires_for_build_sdist, get_requires_for_build_wheel

__all__ = ["build_editable", "build_sdist", "build_wheel", "get_requires_for_build_sdist", "get_requires_for_build_wheel"]

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = ["softtwin", "softtwind"]
#: What the programs and the module are compiled from, and what the wheel carries: prefixes of paths. The workspace's other members have to be
#: there because cargo reads them all.
SOURCES = (
    "Cargo.",
    "LICENSE-",
    "rust-toolchain",
    ".cargo/",
    "crates/",
    "studies/",
    "tests/",
    "clients/python/",
    "config/",
    "scripts/package.sh",
    "scripts/setup.sh",
    "scripts/step.py",
    "models/pneunet/actuator.toml",
    "models/pneunet/pneunet.",
)


def _put_beside(profile: str) -> None:
    """Programs and model where maturin takes the wheel's data from."""
    # The module's package is named, so that packages which it shares with the programs get the same features and are compiled once; maturin
    # builds the module itself.
    packages = [argument for package in ("softtwin", "softtwind", "python") for argument in ("--package", package)]
    programs = [argument for program in PROGRAMS for argument in ("--bin", program)]
    subprocess.run(["cargo", "build", "--locked", "--profile", profile, *programs, *packages], cwd=ROOT, check=True)
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


def _sources() -> List[str]:
    """Paths of the files of a source distribution: those that git knows, with the code of exported pages where it has been compiled, or, in
    an unpacked one, all that are there."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode == 0 and listed.stdout:
        paths = [*listed.stdout.rstrip("\0").split("\0"), "crates/viewer/page.wasm"]
    else:
        found = (path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*") if path.is_file())
        paths = [path for path in found if "/__pycache__/" not in path]
    return sorted(path for path in paths if path.startswith(SOURCES) and (ROOT / path).is_file())


def _pyproject() -> bytes:
    """The project file for the top of a source distribution, where the paths in it begin."""
    text = (ROOT / "clients/python/pyproject.toml").read_text()
    for here, there in (
        ('backend-path = ["."]', 'backend-path = ["clients/python"]'),
        ('readme = "README.md"', 'readme = "clients/python/README.md"'),
        ('manifest-path = "../../crates', 'manifest-path = "crates'),
        ('python-source = "src"', 'python-source = "clients/python/src"'),
        ('data = "../../target', 'data = "target'),
    ):
        if here not in text:
            raise ValueError(f"clients/python/pyproject.toml: expected {here}")
        text = text.replace(here, there)
    return text.encode()


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    # maturin wants the wheel's data to be there even if it only names the project.
    (ROOT / "target/wheel/softtwin.data").mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        metadata = pathlib.Path(folder) / maturin.prepare_metadata_for_build_wheel(folder) / "METADATA"
        information = metadata.read_bytes()
    fields = dict(line.split(": ", 1) for line in information.decode().split("\n\n")[0].splitlines() if ": " in line)
    top = f"{fields['Name']}-{fields['Version']}"
    name = f"{top}.tar.gz"
    with tarfile.open(pathlib.Path(sdist_directory) / name, "w:gz", format=tarfile.PAX_FORMAT) as archive:
        for path in _sources():
            archive.add(ROOT / path, f"{top}/{path}", recursive=False)
        for path, content in (("pyproject.toml", _pyproject()), ("PKG-INFO", information)):
            entry = tarfile.TarInfo(f"{top}/{path}")
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return name
