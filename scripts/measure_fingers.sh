#!/usr/bin/env bash
# What one twin with many fingers costs: processor time of the twin process, readings answered, latency. Every finger has
# its own readings at 1 kHz and publishes state (force, gradients, bars) and its tip. Prints one JSON object.
#   scripts/measure_fingers.sh [--fingers 10] [--seconds 20] [--profile release]
set -euo pipefail
fingers=10 seconds=20 profile=release
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/lib.sh
options fingers seconds profile -- "$@"
cargo build --locked --quiet --workspace --bins --profile "$profile"
folder=$(programs "$profile")
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$work"' EXIT
export SOFTTWIN_DOMAIN="mf$$" SOFTTWIN_ROOT="$work/iox"
{
    echo 'name = "fingers"'
    for n in $(seq "$fingers"); do
        sed -n '/^\[\[actuator\]\]/,$p' config/scenes/control.toml |
            sed "s#^name = \"finger\"#name = \"finger$n\"#; s#\"../../models#\"$PWD/models#; s#^seed = 1#seed = $n#"
    done
} >"$work/scene.toml"
ready "$work/twin.log" "$folder/softtwind" twin --scene "$work/scene.toml"
twin=$started
ready "$work/bridge.log" "$folder/softtwind" bridge --scene "$work/scene.toml"
sleep 3
ticks() { awk '{ sub(/.*\) /, ""); print $12 + $13 }' "/proc/$twin/stat"; } # user and system time of all threads
health() { "$folder/softtwin" top --once --json >"$work/$1.json"; }
health before
from=$(ticks) begin=$(date +%s%N)
sleep "$seconds"
to=$(ticks) end=$(date +%s%N)
health after
python3 - "$work" "$((to - from))" "$((end - begin))" "$(getconf CLK_TCK)" <<'PY'
import json, sys
folder, ticks, elapsed_ns, hz = sys.argv[1], *map(int, sys.argv[2:])
def rows(name):
    return {row["actuator"]: row for row in json.load(open(f"{folder}/{name}.json"))}
before, after = rows("before"), rows("after")
def counted(key):
    return sum(key(after[name]) - key(before[name]) for name in after)
elapsed_s = elapsed_ns / 1e9
print(json.dumps({
    "fingers": len(after),
    "seconds": round(elapsed_s, 2),
    "share_of_a_core": round(ticks / hz / elapsed_s, 3),
    "readings_per_second": round(counted(lambda row: row["received"]) / elapsed_s),
    "answered_per_second": round(counted(lambda row: row["outcomes"]["published"]) / elapsed_s),
    "missed": counted(lambda row: row["missed"]),
    "latency_p99_us": max(row["latency_p99_us"] for row in after.values()),
}))
PY
