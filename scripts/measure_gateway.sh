#!/usr/bin/env bash
# What the network gateway carries and costs, measured on loopback: states lost and fields a second at a remote subscriber
# (a plain Zenoh client of its own process), and the twin's own latency without gateway, with one that nobody listens to,
# and with one that is listened to.
#   scripts/measure_gateway.sh [--seconds 60] [--profile release]
# Needs Python 3.9 or newer; the machine should have nothing else to do. One JSON object a line.
set -euo pipefail
seconds=60
profile=release
while [ $# -gt 0 ]; do
    case "$1" in
        --seconds) seconds=${2:?--seconds needs a number}; shift 2 ;;
        --profile) profile=${2:?--profile needs dev or release}; shift 2 ;;
        *) echo "measure_gateway: unknown option $1" >&2; exit 2 ;;
    esac
done
cd "$(dirname "${BASH_SOURCE[0]}")/.."
venv=build/gateway-venv
if [ ! -f "$venv/installed" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check "eclipse-zenoh==1.10.2" numpy pytest
    touch "$venv/installed"
fi
cargo build --locked --quiet --workspace --bins --profile "$profile"
cargo build --locked --quiet -p softtwin-gateway --features network --bins --profile "$profile"
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
exec "$venv/bin/python" scripts/measure_gateway.py --programs "$folder" --seconds "$seconds"
