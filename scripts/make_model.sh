#!/bin/sh
# Makes databases, models and gauge traces from nothing: mesh -> states -> database -> trained model; cavity volumes -> traces.
#   scripts/make_model.sh [pneunet|gripper|design|motion|traces|cylinder ...]     default: pneunet gripper
#   MESH=1 scripts/make_model.sh                           builds the mesh again too (needs gmsh, see scripts/mesh.py)
# Stop it and start it again as you like: solved states are kept in target/database/*/states.
set -eu
cd "$(dirname "$0")/.."
# SOFTTWIN=path/to/softtwin takes programs that are already built.
softtwin() { ${SOFTTWIN:-cargo run --quiet --release -p softtwin --} "$@"; }
studies() { if [ -n "${SOFTTWIN:-}" ]; then "$SOFTTWIN-studies" "$@"; else cargo run --quiet --release -p studies -- "$@"; fi; }
# config_of FOLDER: what the model there is trained with, where that is not the default.
config_of() { [ ! -f "$1/train.toml" ] || echo "--config $1/train.toml"; }
# solve_and_check NAME LIST MODEL SEALED SEED --parameter ...: a model of the reference actuator with parameters as inputs, and its errors
# on states that no training sees.
solve_and_check() {
    actuator=models/pneunet/actuator.toml folder="target/database/$1"
    list=$2 model=$3 sealed=$4 seed=$5
    shift 5
    softtwin simulate --actuator "$actuator" --cases "$list" --sensitivities --out "$folder"
    softtwin train --database "$folder" $(config_of "$(dirname "$model")") --out "$model"
    # Behind the training list, so that they start from solved states near them.
    softtwin sample --actuator "$actuator" --kind sequence --regime contact --n "$sealed" --seed "$seed" --split check --prefix sealed "$@" --out "$folder-sealed.csv"
    { cat "$list" && tail -n +2 "$folder-sealed.csv"; } >"$folder-both.csv"
    softtwin simulate --actuator "$actuator" --cases "$folder-both.csv" --sensitivities --out "$folder"
    softtwin evaluate "$model" --database "$folder" --split check
}
# scattered REGIME N SEED PREFIX --parameter ...: states of as many designs, added to the list.
scattered() {
    regime=$1 n=$2 seed=$3 prefix=$4
    shift 4
    softtwin sample --actuator models/pneunet/actuator.toml --kind sequence --regime "$regime" --n "$n" --seed "$seed" \
        --prefix "$prefix" "$@" --out target/database/scattered.csv
    tail -n +2 target/database/scattered.csv >>"$list"
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
        # Pressure, gap and five parameters of the reference actuator: 6 designs of eight states each, with a common way from rest,
        # and 279 states of as many designs, which start from those near them and take half the time. 40 of these touch at low
        # pressure, where stress is small and its shape changes most.
        list=models/pneunet-design/cases.csv
        set -- --parameter elastomer.law.mu_mpa=0.6:1.0 --parameter chambers.length_mm=2.6:3.4 --parameter chambers.width_mm=13:15 \
            --parameter base.lower_mm=1.6:2.4 --parameter sheet.thickness_mm=0.08:0.12
        mkdir -p target/database
        softtwin sample --actuator models/pneunet/actuator.toml --database models/pneunet/database --kind sequence --regime both \
            --n 6 --states-per-design 8 --seed 7 --prefix v "$@" --out "$list"
        scattered contact 100 90514277 r "$@"
        scattered free 19 9 f "$@"
        scattered contact 60 61804470 s "$@"
        scattered contact 40 31 p --pressure 0 0.012 "$@"
        scattered contact 60 27182818 t "$@"
        solve_and_check design "$list" models/pneunet-design/pneunet-design.twin 60 14142135 "$@"
        continue
    fi
    if [ "$name" = motion ]; then
        # The reference actuator with the inertial load as third input: it moves in time. Five minutes on two cores.
        softtwin simulate --actuator models/pneunet/actuator.toml --cases models/pneunet/motion/cases.csv --sensitivities --out target/database/motion
        softtwin train --database target/database/motion $(config_of models/pneunet/motion) --inertia models/pneunet/actuator.toml \
            --out models/pneunet/motion/pneunet-motion.twin
        softtwin evaluate models/pneunet/motion/pneunet-motion.twin --database target/database/motion --split check
        continue
    fi
    if [ "$name" = cylinder ]; then
        # A small actuator over a cylinder whose radius is an input; some minutes on one core.
        actuator=models/cylinder/actuator.toml folder=target/database/cylinder
        over="--regime contact --pressure 0.01 0.06 --gap 0.2 0.5 --parameter obstacle.radius_mm=10:30"
        mkdir -p target/database
        softtwin mesh --actuator "$actuator" --size-mm 4
        softtwin sample --actuator "$actuator" --kind sequence --n 60 --seed 1 --prefix r $over --out models/cylinder/cases.csv
        softtwin simulate --actuator "$actuator" --cases models/cylinder/cases.csv --sensitivities --out "$folder"
        softtwin train --database "$folder" --out "$folder.twin"
        softtwin sample --actuator "$actuator" --kind sequence --n 20 --seed 20261122 --split check --prefix sealed $over --out models/cylinder/sealed.csv
        softtwin simulate --actuator "$actuator" --cases models/cylinder/sealed.csv --out "$folder-sealed"
        softtwin evaluate "$folder.twin" --database "$folder-sealed" --split check
        continue
    fi
    model="models/$name"
    database="target/database/$name"
    if [ "${MESH:-0}" = 1 ] && [ "$name" = pneunet ]; then scripts/mesh.py "$model/actuator.toml"; fi
    # The gripper's derivatives gain little (docs/accuracy.md) and would be a third of its data.
    case $name in gripper) obstacle=gripper derivatives= ;; *) obstacle=plate derivatives=--sensitivities ;; esac
    softtwin simulate --actuator "$model/actuator.toml" --cases "$model/cases.csv" $derivatives --out "$database"
    # The gripper's database is not part of the repository.
    if [ "$name" != gripper ]; then
        softtwin pack --database "$database" --out "$model/database"
        database="$model/database"
    fi
    softtwin train --database "$database" --obstacle "$obstacle" $(config_of "$model") --out "$model/$name.twin"
done
