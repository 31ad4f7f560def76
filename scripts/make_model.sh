#!/bin/sh
# Makes databases and models from nothing: mesh -> states -> database -> trained model.
#   scripts/make_model.sh [pneunet|gripper ...]     default: both
#   MESH=1 scripts/make_model.sh                    builds the mesh again too (needs gmsh, see scripts/mesh.sh)
# Stop it and start it again as you like: solved states are kept in target/database/*/states.
set -eu
cd "$(dirname "$0")/.."
# SOFTTWIN=path/to/softtwin takes a program that is already built.
softtwin() { ${SOFTTWIN:-cargo run --quiet --release -p softtwin --} "$@"; }
[ $# -gt 0 ] || set -- pneunet gripper
for name in "$@"; do
    model="models/$name"
    database="target/database/$name"
    if [ "${MESH:-0}" = 1 ] && [ "$name" = pneunet ]; then scripts/mesh.sh "$model/actuator.toml"; fi
    softtwin simulate --actuator "$model/actuator.toml" --cases "$model/cases.csv" --out "$database"
    softtwin pack --database "$database" --out "$model/database"
    case $name in gripper) scene=gripper ;; *) scene=plate ;; esac
    softtwin train --database "$model/database" --scene "$scene" --out "$model/$name.twin"
done
