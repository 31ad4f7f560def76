#!/usr/bin/env bash
# Builds the Python wheel: the client, libsofttwin, the daemon, the demonstration and its plant, one model with its scenes and
# traces. Whoever installs it needs no compiler: pip install softtwin-*.whl, then softtwin-demo.
#   scripts/package_wheel.sh OUT [--profile dev|light|release]       default: release
# Needs Rust, a C compiler, and Python 3.9 or newer with pip and setuptools. Writes into OUT and the target folder only.
set -euo pipefail
out=${1:?package_wheel.sh needs a folder: scripts/package_wheel.sh OUT}
profile=release
if [ "${2:-}" = --profile ]; then profile=${3:?--profile needs a name}; fi
mkdir -p "$out"
out=$(cd "$out" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
cargo build --locked --quiet --profile "$profile" -p capi -p softtwind --bins --lib
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -r clients/python/{pyproject.toml,README.md,src} "$work/"
carried=$work/src/softtwin/carried
scripts/share.sh "$carried/share" pneunet
mkdir -p "$carried/bin" "$carried/lib" "$carried/include"
for program in softtwind softtwin-demo; do strip -o "$carried/bin/$program" "$folder/$program"; done
strip --strip-unneeded -o "$carried/lib/libsofttwin.so.0" "$folder/libcapi.so"
cp crates/capi/include/softtwin* "$carried/include/"
# Programs for this processor, for every Python 3.
printf '[bdist_wheel]\npython_tag = py3\nplat_name = %s\n' "linux_$(uname -m)" > "$work/setup.cfg"
"${PYTHON:-python3}" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$out" "$work"
ls "$out"/softtwin-*.whl
