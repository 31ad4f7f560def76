#!/usr/bin/env bash
# Solves a list of cases as a SLURM array. Each task solves its rows into a separate folder; a last job collects the states and
# writes the database. A repeated job continues: solved states are kept.
#   job=$(sbatch --parsable --array=0-7 slurm.sh actuator.toml cases.csv study [OPTIONS OF softtwin simulate])
#   sbatch --dependency=afterok:"$job" slurm.sh actuator.toml cases.csv study [THE SAME OPTIONS]
#SBATCH --job-name=softtwin
#SBATCH --cpus-per-task=2
#SBATCH --mem-per-cpu=1200M
set -euo pipefail
[ $# -ge 3 ] || { echo "usage: slurm.sh ACTUATOR CASES OUT [OPTION...]" >&2; exit 2; }
actuator=$1 cases=$2 out=$3 options=("${@:4}")

simulate() { # CASES OUT
    softtwin simulate --actuator "$actuator" --cases "$1" --out "$2" --threads "${SLURM_CPUS_PER_TASK:-1}" "${options[@]}"
}

if [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
    part=$out/parts/$SLURM_ARRAY_TASK_ID
    mkdir -p "$part"
    # The heading and every n-th row.
    awk -v at="$SLURM_ARRAY_TASK_ID" -v count="$SLURM_ARRAY_TASK_COUNT" 'NR == 1 || (NR - 2) % count == at' "$cases" >"$part/list.csv"
    simulate "$part/list.csv" "$part"
else
    mkdir -p "$out/states"
    cp -u "$out"/parts/*/states/* "$out/states"
    simulate "$cases" "$out"
fi
