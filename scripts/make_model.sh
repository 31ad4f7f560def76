#!/bin/sh
# Makes databases, models and gauge traces from nothing: mesh -> states -> database -> trained model; cavity volumes -> traces.
#   scripts/make_model.sh [pneunet|gripper|stiffness|design|traces ...]     default: pneunet gripper
#   MESH=1 scripts/make_model.sh                           builds the mesh again too (needs gmsh, see scripts/mesh.sh)
# Stop it and start it again as you like: solved states are kept in target/database/*/states.
set -eu
cd "$(dirname "$0")/.."
# SOFTTWIN=path/to/softtwin takes programs that are already built.
softtwin() { ${SOFTTWIN:-cargo run --quiet --release -p softtwin --} "$@"; }
studies() { if [ -n "${SOFTTWIN:-}" ]; then "$SOFTTWIN-studies" "$@"; else cargo run --quiet --release -p studies -- "$@"; fi; }
[ $# -gt 0 ] || set -- pneunet gripper
for name in "$@"; do
    if [ "$name" = traces ]; then
        # Volumes at the paper's three gaps (about 45 states), then the gas law and a gauge: config/traces/.
        softtwin simulate --actuator models/pneunet/actuator.toml --cases models/pneunet/trace_cases.csv --out target/traces
        seed=1
        for gap in 80 40 15; do
            studies trace --volumes target/traces/volumes.csv --gap-mm "$gap" --seed "$seed" --out "config/traces/gap$gap.csv"
            seed=$((seed + 1))
        done
        continue
    fi
    if [ "$name" = design ]; then
        # Pressure, gap and five parameters of the reference actuator; any first part of the list is a design too.
        set -- --parameter elastomer.law.mu_mpa=0.6:1.0 --parameter chambers.length_mm=2.6:3.4 \
            --parameter chambers.width_mm=13:15 --parameter base.lower_mm=1.6:2.4 --parameter sheet.thickness_mm=0.08:0.12
        actuator=models/pneunet/actuator.toml
        folder=target/database/design
        model=target/pneunet-design.twin
        mkdir -p target/database
        softtwin sample --actuator "$actuator" --kind sequence --regime both --n 400 --seed 1 --prefix d "$@" --out "$folder.csv"
        softtwin simulate --actuator "$actuator" --cases "$folder.csv" --sensitivities --out "$folder"
        softtwin train --database "$folder" --out "$model"
        # States that no training sees.
        softtwin sample --actuator "$actuator" --kind sequence --regime contact --n 60 --seed 20261122 --split check --prefix sealed "$@" --out "$folder-sealed.csv"
        softtwin simulate --actuator "$actuator" --cases "$folder-sealed.csv" --out "$folder-sealed"
        softtwin evaluate --model "$model" --database "$folder-sealed" --split held-out
        continue
    fi
    if [ "$name" = stiffness ]; then
        # Pressure, gap and the silicone's stiffness: what config/scenes/estimate.toml looks for.
        actuator=models/pneunet/actuator.toml
        list=models/pneunet-stiffness/cases.csv
        folder=target/database/stiffness
        model=models/pneunet-stiffness/pneunet-stiffness.twin
        softtwin sample --actuator "$actuator" --kind sequence --regime both --n 140 --seed 3 --prefix m --parameter elastomer.law.mu_mpa=0.6:1.0 --out "$list"
        softtwin simulate --actuator "$actuator" --cases "$list" --sensitivities --out "$folder"
        softtwin train --database "$folder" --out "$model"
        # States that no training sees.
        softtwin sample --actuator "$actuator" --kind sequence --regime contact --n 30 --seed 20261122 --split check --prefix sealed --parameter elastomer.law.mu_mpa=0.6:1.0 --out "$folder-sealed.csv"
        softtwin simulate --actuator "$actuator" --cases "$folder-sealed.csv" --out "$folder-sealed"
        softtwin evaluate --model "$model" --database "$folder-sealed" --split check
        continue
    fi
    model="models/$name"
    database="target/database/$name"
    if [ "${MESH:-0}" = 1 ] && [ "$name" = pneunet ]; then scripts/mesh.sh "$model/actuator.toml"; fi
    # The gripper's derivatives gain little (docs/accuracy.md) and would be a third of its data.
    case $name in gripper) scene=gripper derivatives= ;; *) scene=plate derivatives=--sensitivities ;; esac
    softtwin simulate --actuator "$model/actuator.toml" --cases "$model/cases.csv" $derivatives --out "$database"
    softtwin pack --database "$database" --out "$model/database"
    softtwin train --database "$model/database" --scene "$scene" --out "$model/$name.twin"
done
