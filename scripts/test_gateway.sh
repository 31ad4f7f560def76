#!/usr/bin/env bash
# The network gateway: lints, tests, and a plain Zenoh client from PyPI against a live twin (build/gateway-venv).
#   scripts/test_gateway.sh [cargo test arguments]
# Needs openssl, Python 3.9 or newer with venv, and PyPI the first time. scripts/test.sh needs none of this, and builds
# nothing of it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/lib.sh
for needed in openssl python3; do
    command -v "$needed" >/dev/null || { echo "test_gateway: $needed is missing; on Debian or Ubuntu: apt-get install $needed" >&2; exit 1; }
done
if ! python3 -c 'import venv, ensurepip' 2>/dev/null; then
    echo "test_gateway: python3 with venv is missing; on Debian or Ubuntu: apt-get install python3-venv" >&2
    exit 1
fi
zenoh_python
cargo build --locked --quiet --workspace --bins
# Its hundreds of dependencies are not optimised here: that would take most of the time, and no test needs it.
gateway() { cargo --config 'profile.dev.package."*".opt-level=0' "$1" --locked -p gateway --features network "${@:2}"; }
gateway clippy --quiet --all-targets -- -D warnings
gateway test --no-fail-fast -- "$@"
exec "$python" -m pytest -q crates/gateway/tests
