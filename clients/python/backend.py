"""Builds the wheel: the native module by maturin, and beside it the programs and the shipped model; and the source distribution, from which
the same wheel is built elsewhere.

`MATURIN_PEP517_ARGS="--profile dev"` builds with another profile than `release`. `MATURIN_PEP517_ARGS="--target aarch64-unknown-linux-gnu
--compatibility manylinux_2_17"` builds for that processor and for every Linux whose glibc is at least that old, with zig as C compiler and linker.
"""

import io
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import tarfile
import tempfile
from typing import Any, List, Optional

import maturin
from maturin import get_requires_for_build_sdist

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

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


def _argument(name: str) -> Optional[str]:
    given = shlex.split(os.environ.get("MATURIN_PEP517_ARGS", ""))
    return given[given.index(name) + 1] if name in given else None


def _compile_with_zig(target: str) -> str:
    """Has cargo, for us and for maturin, build for `target` with zig, and answers with the glibc that zig is told to link against. The compiler of
    this machine would link against this machine's glibc, and the wheel would start on no older Linux."""
    glibc = (_argument("--compatibility") or "manylinux_2_17").replace("manylinux_", "").replace("_", ".")
    # The path is the same in each build, since cargo compiles everything again when the linker's name changes.
    compiler = ROOT / "target/wheel" / f"cc-{target}"
    compiler.parent.mkdir(parents=True, exist_ok=True)
    # Without -g zig drops the symbols before rustc has used them.
    options = f"-g -fno-sanitize=all -target {target.split('-')[0]}-linux-gnu.{glibc}"
    compiler.write_text(f'#!/bin/sh\nexec maturin zig cc -- {options} "$@"\n')
    compiler.chmod(0o755)
    name = target.replace("-", "_")
    for variable in (f"CC_{name}", f"CARGO_TARGET_{name.upper()}_LINKER"):
        os.environ[variable] = str(compiler)
    os.environ["CARGO_BUILD_TARGET"] = target
    return glibc


def _check_glibc(program: pathlib.Path, newest: str) -> None:
    """maturin compares only the module with the wheel's tag, and installers believe the tag."""
    needed = subprocess.run(["readelf", "--version-info", program], capture_output=True, text=True, check=True).stdout
    versions = {tuple(map(int, version.split("."))) for version in re.findall(r"GLIBC_([0-9.]+)", needed)}
    if not versions or max(versions) > tuple(map(int, newest.split("."))):
        raise ValueError(f"{program}: expected symbols of glibc up to {newest}, found {sorted(versions)}")


def _put_beside() -> None:
    """Programs and model where maturin takes the wheel's data from."""
    profile, target = _argument("--profile") or "release", _argument("--target")
    glibc = _compile_with_zig(target) if target else None
    # The module's package is named, so that packages which it shares with the programs get the same features and are compiled once; maturin
    # builds the module itself.
    packages = [argument for package in ("softtwin", "softtwind", "python") for argument in ("--package", package)]
    programs = [argument for program in PROGRAMS for argument in ("--bin", program)]
    subprocess.run(["cargo", "build", "--locked", "--profile", profile, *programs, *packages], cwd=ROOT, check=True)
    data = ROOT / "target/wheel/softtwin.data"
    shutil.rmtree(data, ignore_errors=True)
    (data / "scripts").mkdir(parents=True)
    built = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / (target or "") / ("debug" if profile == "dev" else profile)
    for program in PROGRAMS:
        if glibc:
            # The profile release has stripped it, and this machine's strip may not know its processor.
            shutil.copy2(built / program, data / "scripts")
            _check_glibc(built / program, glibc)
        else:
            subprocess.run(["strip", "-o", data / "scripts" / program, built / program], check=True)
    share = [ROOT / "scripts/package.sh", "share", data / "data/share/softtwin", "pneunet"]
    subprocess.run(share, cwd=ROOT, check=True)


def get_requires_for_build_wheel(config_settings: Any = None) -> List[str]:
    return maturin.get_requires_for_build_wheel(config_settings) + (["ziglang>=0.14"] if _argument("--target") else [])


get_requires_for_build_editable = get_requires_for_build_wheel


def prepare_metadata_for_build_wheel(metadata_directory: str, config_settings: Any = None) -> str:
    # maturin wants the wheel's data to be there even if it only names the project.
    (ROOT / "target/wheel/softtwin.data").mkdir(parents=True, exist_ok=True)
    return maturin.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    _put_beside()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    _put_beside()
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
    with tempfile.TemporaryDirectory() as folder:
        metadata = pathlib.Path(folder) / prepare_metadata_for_build_wheel(folder) / "METADATA"
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
