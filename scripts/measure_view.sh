#!/usr/bin/env bash
# What watching costs: frames a second at the full surface, and the twin's latency without viewers, with three, and with a
# slow one, each for so many seconds.
#   scripts/measure_view.sh [SECONDS]
# Needs Rust, a C compiler and Python 3. Measures the release build; the machine should have nothing else to do.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
cargo build --locked --quiet --release -p softtwin -p softtwind
exec python3 scripts/measure_view.py --programs "${CARGO_TARGET_DIR:-target}/release" --seconds "${1:-10}"
