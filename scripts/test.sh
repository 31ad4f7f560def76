#!/usr/bin/env bash
# All tests: units, properties, golden files, multi-process stories. Needs Rust, a C compiler and strace.
#   scripts/test.sh              everything
#   scripts/test.sh NAME         only the tests whose name contains NAME
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# Crates whose tests compute and have no deadline, in two groups of about the same length. The others mostly wait for processes and
# readings, so all three run at the same time, these two at low priority: a process that a story waits for does not wait for them.
# (tests/tests/house.rs reads these two lines.)
computing_first=(softtwin formats rom estimate control)
computing_second=(train fem studies)

# Multi-process tests start our programs, so these are built as well.
cargo build --locked --workspace --bins --tests --examples
built_s=$SECONDS
logs=$(mktemp -d)
# computing LOG PACKAGE... : in the background, a process group of its own, so that it ends with this script.
groups=()
computing() {
    set -m
    nice -n 15 cargo test --locked "${@:2}" --no-fail-fast -- "${names[@]}" >"$logs/$1" 2>&1 &
    set +m
    groups+=($!)
}
names=("$@")
computing first "${computing_first[@]/#/--package=}"
computing second "${computing_second[@]/#/--package=}"
trap 'for group in "${groups[@]}"; do kill -- "-$group" 2>/dev/null || true; done; rm -rf "$logs"' EXIT
failed=0
cargo test --locked --workspace "${computing_first[@]/#/--exclude=}" "${computing_second[@]/#/--exclude=}" --no-fail-fast -- "$@" || failed=1
stories_s=$SECONDS
for group in "${groups[@]}"; do
    # Nothing is left to give way to. Without the right to raise a priority it stays low.
    renice -n 0 -g "$group" >/dev/null 2>&1 || true
done
for group in "${groups[@]}"; do wait "$group" || failed=1; done
cat "$logs"/*
echo "test.sh: built in $built_s s; stories $((stories_s - built_s)) s, with the computing tests beside them $((SECONDS - built_s)) s"
((failed == 0)) || echo "test.sh: tests failed; their names stand below 'failures:' above" >&2
exit "$failed"
