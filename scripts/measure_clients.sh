#!/usr/bin/env bash
# What the clients cost, measured: latency from publish to a reader in Rust, C and Python at 1 kHz, what nothing lost means,
# what-if questions beside the running twin, and what these do to the twin's own latency. One JSON object a line.
#   scripts/measure_clients.sh [--seconds 60] [--profile release]
set -euo pipefail
seconds=60
profile=release
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/lib.sh
options seconds profile -- "$@"
cargo build --locked --quiet --workspace --profile "$profile"
folder=$(programs "$profile")
work=$(mktemp -d /tmp/mcXXXXXX)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$work"' EXIT
export SOFTTWIN_DOMAIN="mc$$" SOFTTWIN_ROOT="$work/iox" PYTHONPATH=$PWD/clients/python/src
cc -O2 -std=c11 clients/c/examples/latency.c -Icrates/capi/include -L"$folder" -Wl,-rpath,"$(realpath "$folder")" -lsofttwin -o "$work/latency"
cat > "$work/scene.toml" <<TOML
name = "khz"
[[actuator]]
name = "finger"
model = "$PWD/models/pneunet/pneunet.twin"
queries = "fields"
[actuator.source]
kind = "simulate"
rate_hz = 1000.0
gap_mm = 30.0
[actuator.source.profile]
shape = "sine"
mean_mpa = 0.045
amplitude_mpa = 0.03
frequency_hz = 0.5
[[actuator.output]]
nodes = "all"
TOML
ready "$work/twin.log" "$folder/softtwind" twin --scene "$work/scene.toml"
ready "$work/bridge.log" "$folder/softtwind" bridge --scene "$work/scene.toml"
sleep 1
say() { printf '{"reader":"%s","result":%s}\n' "$1" "$2"; }
# The twin's own latency: the newest health of the last seconds, without and with questions.
health() { "$folder/softtwin" echo softtwin/finger/health --count 5 --json | tail -1; }
for what in state field; do
    say "rust $what" "$("$folder/softtwin-latency" $what --seconds "$seconds")"
    say "c $what" "$("$work/latency" "$seconds" $what)"
    if [ -x build/clients-venv/bin/python ]; then
        say "python $what" "$(build/clients-venv/bin/python clients/python/examples/latency.py $what --seconds "$seconds")"
    fi
done
say "twin alone" "$(health)"
"$folder/softtwin-latency" whatif --seconds "$seconds" > "$work/whatif.json" &
asking=$!
sleep 2
say "twin while asked" "$(health)"
wait $asking
say "rust what-if" "$(cat "$work/whatif.json")"
