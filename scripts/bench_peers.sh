#!/usr/bin/env bash
# One full-field prediction and one training, side by side: softtwin, numpy, EZyRB and the paper's own way, all on the
# same contact states with 6 modes, measured in turn in one run. Prints the README's table.
#
#   scripts/bench_peers.sh [--database DIR] [--rounds N]
#
# DIR: a database in softtwin's layout (database.toml, cases.csv, snapshots.npy); by default ../shared/database or
# models/pneunet/database. Python packages go into a virtual environment of their own under build/; EZyRB brings PyTorch.
set -euo pipefail
cd "$(dirname "$0")/.."

database=
rounds=5
while [ $# -gt 0 ]; do
    case "$1" in
        --database) database=${2:?--database needs a folder}; shift 2 ;;
        --rounds) rounds=${2:?--rounds needs a number}; shift 2 ;;
        -h | --help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
        *) echo "bench_peers: unknown option $1; see --help" >&2; exit 2 ;;
    esac
done
if [ -z "$database" ]; then
    for candidate in ../shared/database models/pneunet/database; do
        if [ -f "$candidate/snapshots.npy" ]; then database=$candidate; break; fi
    done
fi
if [ ! -f "$database/snapshots.npy" ]; then
    echo "bench_peers: no database found (${database:-none}); give one with --database, \`softtwin simulate\` makes one" >&2
    exit 1
fi

venv=build/peers-venv
if [ ! -x "$venv/bin/python" ]; then python3 -m venv "$venv"; fi
"$venv/bin/pip" install --quiet --disable-pip-version-check numpy==2.2.6 scipy==1.15.3 ezyrb==1.3.3 >&2

cargo build --quiet --release -p softtwin
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# The peers know one number of modes for all fields, so softtwin gets the same here.
cat > "$work/train.toml" <<'TOML'
[free]
modes = { fixed = 6 }
[contact]
modes = { fixed = 6 }
TOML
# One thread each: a twin has one core, and numpy's pool would take them all.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
"$venv/bin/python" scripts/bench_peers.py --database "$database" --softtwin target/release/softtwin \
    --work "$work" --rounds "$rounds"
