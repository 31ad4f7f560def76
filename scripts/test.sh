#!/usr/bin/env bash
# All tests: units, properties, golden files, several processes.
#   scripts/test.sh              everything
#   scripts/test.sh NAME         only the tests whose name contains NAME
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/setup.sh
require cargo cc strace
# Crates whose tests compute and have no deadline, in two groups of about the same length. The other tests mostly wait for processes
# and readings, so the three parts run at the same time, these two at low priority.
# (tests/tests/architecture.rs reads these two lines.)
computing_first=(softtwin formats rom estimate control)
computing_second=(train fem studies)

# Multi-process tests start our programs, so these are built as well.
cargo build --locked --workspace --bins --tests --examples
built_s=$SECONDS
logs=$(mktemp -d)
set -m # each group of crates in its own process group, which ends with this script
nice -n 15 cargo test --locked "${computing_first[@]/#/--package=}" --no-fail-fast -- "$@" >"$logs/first" 2>&1 &
beside=($!)
nice -n 15 cargo test --locked "${computing_second[@]/#/--package=}" --no-fail-fast -- "$@" >"$logs/second" 2>&1 &
beside+=($!)
set +m
trap 'kill -- "${beside[@]/#/-}" 2>/dev/null || true; rm -rf "$logs"' EXIT
failed=0
computing=("${computing_first[@]}" "${computing_second[@]}")
cargo test --locked --workspace "${computing[@]/#/--exclude=}" --no-fail-fast -- "$@" || failed=1
processes_s=$SECONDS
renice -n 0 -g "${beside[@]}" >/dev/null 2>&1 || true
for group in "${beside[@]}"; do wait "$group" || failed=1; done
cat "$logs"/*
echo "test.sh: built in $built_s s; tests with processes $((processes_s - built_s)) s, all tests $((SECONDS - built_s)) s"
((failed == 0)) || echo "test.sh: tests failed; their names are below 'failures:' above" >&2
exit "$failed"
