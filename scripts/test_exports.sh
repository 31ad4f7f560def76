#!/usr/bin/env bash
# Files that others open: every export is read by meshio and numpy and compared with `softtwin predict`; what meshio wrote is
# imported.
#   scripts/test_exports.sh
# Needs Rust, a C compiler, Python 3 with venv, and a package registry for meshio, numpy and h5py (or all installed already).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
command -v python3 >/dev/null || { echo "test_exports: python3 is not here" >&2; exit 1; }
cargo build --locked --quiet --workspace --bins
target=${CARGO_TARGET_DIR:-target}
python=python3
if ! python3 -c 'import meshio, numpy, h5py' 2>/dev/null; then
  python=$target/readers/bin/python
  [ -x "$python" ] || python3 -m venv "$target/readers"
  "$python" -c 'import meshio, numpy, h5py' 2>/dev/null || "$python" -m pip install --quiet 'meshio==5.3.5' 'numpy<3' h5py
fi
exec "$python" scripts/test_exports.py --programs "$target/debug"
