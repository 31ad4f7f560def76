#!/usr/bin/env bash
# One full-field prediction and one training, side by side: softtwin, numpy, EZyRB and the paper's own way, all on the
# same contact states with 6 modes, measured in turn in one run. Prints the README's table.
#
#   scripts/bench_peers.sh [--database DIR] [--rounds N] [--softtwin FILE]
#
# DIR: a database in softtwin's layout, by default models/pneunet/database; packed snapshots are unpacked first.
# FILE: a built softtwin; by default a release build is made. Python packages go into a virtual environment of their own
# under target/; EZyRB is installed without PyTorch, which its POD and RBF do not use.
set -euo pipefail
cd "$(dirname "$0")/.."

database=models/pneunet/database
rounds=5
softtwin=
while [ $# -gt 0 ]; do
    case "$1" in
        --database) database=${2:?--database needs a folder}; shift 2 ;;
        --rounds) rounds=${2:?--rounds needs a number}; shift 2 ;;
        --softtwin) softtwin=${2:?--softtwin needs a file}; shift 2 ;;
        -h | --help) sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 0 ;;
        *) echo "bench_peers: unknown option $1; see --help" >&2; exit 2 ;;
    esac
done
if [ ! -f "$database/database.toml" ]; then
    echo "bench_peers: $database is no database (expected database.toml in it); \`softtwin simulate\` makes one" >&2
    exit 1
fi

venv=target/peers-venv
if [ ! -x "$venv/bin/python" ]; then python3 -m venv "$venv"; fi
pip="$venv/bin/pip --quiet --disable-pip-version-check"
$pip install numpy==2.2.6 scipy==1.15.3 scikit-learn matplotlib future >&2
$pip install --no-deps ezyrb==1.3.3 >&2

if [ -z "$softtwin" ]; then
    cargo build --quiet --release -p softtwin
    softtwin=target/release/softtwin
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ ! -f "$database/snapshots.npy" ]; then
    "$softtwin" pack --unpack --database "$database" --out "$work/database" >&2
    database=$work/database
fi
# The peers know one number of modes for all fields, so softtwin gets the same here.
cat > "$work/train.toml" <<'TOML'
[free]
modes = { fixed = 6 }
[contact]
modes = { fixed = 6 }
TOML
# One thread each: a twin has one core, and numpy's pool would take them all.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
"$venv/bin/python" scripts/bench_peers.py --database "$database" --softtwin "$softtwin" --work "$work" --rounds "$rounds"
