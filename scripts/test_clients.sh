#!/usr/bin/env bash
# Tests of the Python client against live twins, in a virtual environment of their own (build/clients-venv).
#   scripts/test_clients.sh [pytest arguments]
# Needs Python 3.9 or newer with venv, and PyPI the first time. scripts/test.sh needs none of this.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if ! python3 -c 'import venv, ensurepip' 2>/dev/null; then
    echo "test_clients: python3 with venv is missing; on Debian or Ubuntu: apt-get install python3-venv" >&2
    exit 1
fi
venv=build/clients-venv
stamp="$venv/installed"
if [ ! -f "$stamp" ] || [ clients/python/pyproject.toml -nt "$stamp" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check "iceoryx2==0.10.0" numpy pytest matplotlib mypy
    touch "$stamp"
fi
cargo build --locked --quiet --workspace --bins
export PYTHONPATH=$PWD/clients/python/src
"$venv/bin/mypy" --ignore-missing-imports --no-error-summary clients/python/src/softtwin
exec "$venv/bin/python" -m pytest -q clients/python/tests "$@"
