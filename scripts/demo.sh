#!/usr/bin/env bash
# Demonstration: a recorded pressure trace becomes live fields through two processes.
#   scripts/demo.sh                      once through the gap-40 trace
#   scripts/demo.sh --seconds 10         for 10 s
#   scripts/demo.sh --trace FILE         another trace (config/traces/)
#   scripts/demo.sh --json               ends with one JSON object
#   scripts/demo.sh --view               in a browser as well, until Ctrl-C; builds `softtwin` the first time
# Builds what is missing.
set -euo pipefail
# The path of a trace is relative to the caller's folder.
arguments=() packages=(-p softtwind)
while [ $# -gt 0 ]; do
  case "$1" in
    --trace) [ $# -ge 2 ] || { echo "demo.sh: --trace needs a file" >&2; exit 2; }
             arguments+=(--trace "$(realpath "$2")"); shift 2 ;;
    --view) packages+=(-p softtwin); arguments+=(--view); shift ;;
    *) arguments+=("$1"); shift ;;
  esac
done
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/setup.sh
require cargo cc
target=${CARGO_TARGET_DIR:-target}
[ -x "$target/debug/softtwin-demo" ] ||
  echo "demo.sh: building the two daemons and their reader; the first build takes about two minutes on two cores" >&2
# The tests use the same artefacts.
cargo build --locked "${packages[@]}" --bins >&2
echo "demo.sh: starting twin, bridge and reader" >&2
exec "$target/debug/softtwin-demo" "${arguments[@]}"
