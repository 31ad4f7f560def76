#!/usr/bin/env bash
# The main job, end to end: a recorded pressure trace becomes live fields through two real processes.
#   scripts/demo.sh                      once through the gap-40 trace
#   scripts/demo.sh --seconds 10         for ten seconds
#   scripts/demo.sh --trace FILE         another trace (config/traces/)
#   scripts/demo.sh --json               ends with one JSON object
#   scripts/demo.sh --view               shows it in a browser as well, until Ctrl-C; builds the page the first time
# Builds what is missing, and nothing else. Needs Rust and a C compiler.
set -euo pipefail
# A trace is named from where the user stands, everything else from the repository.
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
target=${CARGO_TARGET_DIR:-target}
[ -x "$target/debug/softtwin-demo" ] ||
  echo "demo.sh: building the two daemons and their reader; the first time takes about three minutes on two cores" >&2
# Cargo names each crate and says at the end how long it took. The tests later build on the same artefacts.
cargo build --locked "${packages[@]}" --bins >&2
echo "demo.sh: starting twin, bridge and reader" >&2
exec "$target/debug/softtwin-demo" "${arguments[@]}"
