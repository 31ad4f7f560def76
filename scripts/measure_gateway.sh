#!/usr/bin/env bash
# What the network gateway carries and costs, measured on loopback: states lost and fields a second at a remote subscriber
# (a plain Zenoh client of its own process), and the twin's own latency without gateway, with one that nobody listens to,
# and with one that is listened to.
#   scripts/measure_gateway.sh [--seconds 60] [--rounds 1] [--realtime yes|no] [--profile release]
# The twin runs in real time with locked memory where the rights for that are there (root, or the limits of
# config/systemd/softtwin-twin@.service); what was refused is printed; with --realtime no it runs as any program. Each round
# measures all three for that many seconds.
# Needs Python 3.9 or newer; the machine should have nothing else to do. One JSON object a line.
set -euo pipefail
seconds=60 rounds=1 realtime=yes profile=release
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/lib.sh
options seconds rounds realtime profile -- "$@"
zenoh_python
cargo build --locked --quiet --workspace --bins --profile "$profile"
cargo build --locked --quiet -p gateway --features network --bins --profile "$profile"
exec "$python" scripts/measure_gateway.py --programs "$(programs "$profile")" \
    --seconds "$seconds" --rounds "$rounds" --realtime "$realtime"
