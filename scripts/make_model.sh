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
# over_parameters NAME LIST MODEL STATES SEED PREFIX SEALED --parameter ...: a model of the reference actuator with parameters as
# inputs, and its errors on states that no training sees.
over_parameters() {
    actuator=models/pneunet/actuator.toml folder="target/database/$1"
    list=$2 model=$3 states=$4 seed=$5 prefix=$6 sealed=$7
    shift 7
    softtwin sample --actuator "$actuator" --kind sequence --regime both --n "$states" --seed "$seed" --prefix "$prefix" "$@" --out "$list"
    softtwin simulate --actuator "$actuator" --cases "$list" --sensitivities --out "$folder"
    softtwin train --database "$folder" --out "$model"
    softtwin sample --actuator "$actuator" --kind sequence --regime contact --n "$sealed" --seed 20261122 --split check --prefix sealed "$@" --out "$folder-sealed.csv"
    softtwin simulate --actuator "$actuator" --cases "$folder-sealed.csv" --out "$folder-sealed"
    softtwin evaluate --model "$model" --database "$folder-sealed" --split check
}
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
        mkdir -p target/database
        over_parameters design target/database/design.csv target/pneunet-design.twin 400 1 d 60 \
            --parameter elastomer.law.mu_mpa=0.6:1.0 --parameter chambers.length_mm=2.6:3.4 \
            --parameter chambers.width_mm=13:15 --parameter base.lower_mm=1.6:2.4 --parameter sheet.thickness_mm=0.08:0.12
        continue
    fi
    if [ "$name" = stiffness ]; then
        # Pressure, gap and the silicone's stiffness: what config/scenes/estimate.toml looks for.
        over_parameters stiffness models/pneunet-stiffness/cases.csv models/pneunet-stiffness/pneunet-stiffness.twin 140 3 m 30 \
            --parameter elastomer.law.mu_mpa=0.6:1.0
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
