#!/usr/bin/env bash
# All tests: units, properties, golden files, multi-process stories. Needs Rust, a C compiler and strace.
#   scripts/test.sh              everything
#   scripts/test.sh NAME         only the tests whose name contains NAME
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# Crates whose tests compute and have no deadline. The others mostly wait for processes and readings, so both run at the same time, these
# at low priority: a process that a story waits for does not wait for them. (tests/tests/house.rs reads this line.)
computing=(rom train fem formats estimate control studies softtwin)

# Multi-process tests start our programs, so these are built as well.
cargo build --locked --workspace --bins --tests --examples
built_s=$SECONDS
log=$(mktemp)
set -m # a process group of its own, so that it ends with this script
nice -n 10 cargo test --locked "${computing[@]/#/--package=}" --no-fail-fast -- "$@" >"$log" 2>&1 &
beside=$!
set +m
trap 'kill -- -$beside 2>/dev/null || true; rm -f "$log"' EXIT
failed=0
cargo test --locked --workspace "${computing[@]/#/--exclude=}" --no-fail-fast -- "$@" || failed=1
stories_s=$SECONDS
# Nothing is left to give way to. Without the right to raise a priority it stays low.
renice -n 0 -g "$beside" >/dev/null 2>&1 || true
wait "$beside" || failed=1
cat "$log"
echo "test.sh: built in $built_s s; stories $((stories_s - built_s)) s, with the computing tests beside them $((SECONDS - built_s)) s"
((failed == 0)) || echo "test.sh: tests failed; their names stand below 'failures:' above" >&2
exit "$failed"
