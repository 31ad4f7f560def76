#!/usr/bin/env bash
# The main job, end to end: a recorded pressure trace becomes live fields through two real processes.
#   scripts/demo.sh                      once through the gap-40 trace
#   scripts/demo.sh --seconds 10         for ten seconds
#   scripts/demo.sh --trace FILE         another trace (config/traces/)
#   scripts/demo.sh --json               ends with one JSON object
# Builds what is missing. Needs Rust and a C compiler.
set -euo pipefail
# A trace is named from where the user stands, everything else from the repository.
arguments=()
while [ $# -gt 0 ]; do
  case "$1" in
    --trace) [ $# -ge 2 ] || { echo "demo.sh: --trace needs a file" >&2; exit 2; }
             arguments+=(--trace "$(realpath "$2")"); shift 2 ;;
    *) arguments+=("$1"); shift ;;
  esac
done
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# The whole workspace, so that the tests later build on the same artefacts.
cargo build --locked --quiet --workspace --bins >&2
exec "${CARGO_TARGET_DIR:-target}/debug/softtwin" demo "${arguments[@]}"
