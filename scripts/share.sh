#!/usr/bin/env bash
# Writes what the programs find in share/softtwin: scenes, traces, settings, and models with their data sheets, cards and geometry.
#   scripts/share.sh FOLDER [MODEL...]      default: every model
set -euo pipefail
folder=${1:?share.sh needs a folder: scripts/share.sh FOLDER}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
shift
[ $# -gt 0 ] || set -- $(for file in models/*/*.twin; do basename "$(dirname "$file")"; done)
install -D -m 644 -t "$folder/config" config/*.toml
install -D -m 644 -t "$folder/config/traces" config/traces/*.csv
for model in "$@"; do
    install -D -m 644 -t "$folder/models/$model" "models/$model"/{"$model.twin","$model.json","$model.card.json",actuator.toml}
done
mkdir -p "$folder/config/scenes"
for scene in config/scenes/*.toml; do
    # A scene goes along when its models do.
    complete=yes
    for model in $(sed -n 's|^model = "../../models/\([^/]*\)/.*|\1|p' "$scene"); do
        [ -f "$folder/models/$model/$model.twin" ] || complete=
    done
    [ -z "$complete" ] || install -m 644 -t "$folder/config/scenes" "$scene"
done
