#!/bin/sh
# Makes config/traces/ from nothing: simulated cavity volumes at the paper's three gaps, then the gas law and a gauge.
# About 45 states; stop it and start it again as you like.
set -eu
cd "$(dirname "$0")/.."
# SOFTTWIN=path/to/softtwin takes a program that is already built.
softtwin() { ${SOFTTWIN:-cargo run --quiet --release -p softtwin --} "$@"; }
softtwin simulate --cases models/pneunet/trace_cases.csv --out target/traces
seed=1
for gap in 80 40 15; do
    softtwin trace --volumes target/traces/volumes.csv --gap-mm "$gap" --seed "$seed" --out "config/traces/gap$gap.csv"
    seed=$((seed + 1))
done
