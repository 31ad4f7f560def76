#!/usr/bin/env bash
# All tests: units, properties, golden files, several processes.
#   scripts/test.sh              everything
#   scripts/test.sh NAME         only the tests whose name contains NAME
#   scripts/test.sh --fast       what one needs between two edits: without trainings, solved paths, whole commands and programs that work together
# With SOFTTWIN_NETWORK=1 the network gateway is built and tested too, which takes two minutes more.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/setup.sh
require cargo cc strace
# Packages whose tests compute and have no deadline. The tests of the others mostly wait for processes, so both run at the same time,
# these in two lists at low priority.
computing="softtwin|formats|rom|estimate|control|train|fem|studies"

fast=""
if [[ ${1-} == --fast ]]; then
    fast=yes
    shift
fi
# Test programs that `--fast` leaves out: each takes a minute or more.
long="^[^ ]*/(softtwin|train|fem|studies|gateway|tests) .*/(all|system|processes)-[0-9a-f]*$"

# Multi-process tests start our programs. One build for all: packages that are selected alone have other features.
# shellcheck disable=SC2046 # `network` prints no word or two
cargo build --locked --workspace $(network) --bins --lib --examples
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
cargo test --locked --workspace $(network) --no-run --message-format json-render-diagnostics >"$logs/built"
sed -n '/"profile":{[^}]*"test":true/s/.*"manifest_path":"\([^"]*\)\/Cargo.toml".*"executable":"\([^"]*\)".*/\1 \2/p' "$logs/built" >"$logs/programs"
[[ -z $fast ]] || { grep -vE "$long" "$logs/programs" >"$logs/short"; mv "$logs/short" "$logs/programs"; }
built_s=$SECONDS

# run PROGRAM [NAME]: one test program in the folder of its package; PROGRAM is "FOLDER PATH".
run() {
    local folder=${1% *} program=${1#* }
    printf '\n== %s\n' "${folder#"$PWD/"} ${program##*/}"
    (cd "$folder" && CARGO_MANIFEST_DIR=$folder "$program" "${@:2}")
}
# run_all [NAME]: the programs of standard input one after the other; fails if one failed.
run_all() {
    local program failed=0
    while read -r program; do
        run "$program" "$@" </dev/null 2>&1 || failed=1
    done
    return "$failed"
}
of_computing() { grep "$@" -E "^[^ ]*/($computing) " "$logs/programs"; }
set -m # each list in its own process group, which ends with this script
beside=()
for half in 0 1; do
    of_computing | awk "NR % 2 == $half" | (renice -n 15 "$BASHPID" >/dev/null && run_all "$@" >"$logs/beside$half") &
    beside+=($!)
done
set +m
trap 'kill -- "${beside[@]/#/-}" 2>/dev/null || true; rm -rf "$logs"' EXIT
failed=0
of_computing -v | run_all "$@" || failed=1
[[ -n $fast ]] || cargo test --locked --workspace $(network) --doc --quiet -- "$@" || failed=1
processes_s=$SECONDS
for group in "${beside[@]}"; do
    renice -n 0 -g "$group" >/dev/null 2>&1 || true # ignored without the right to raise a priority
done
for group in "${beside[@]}"; do wait "$group" || failed=1; done
cat "$logs"/beside*
echo "test.sh: built in $built_s s; tests with processes $((processes_s - built_s)) s, all tests $((SECONDS - built_s)) s"
((failed == 0)) || echo "test.sh: tests failed; their names are below 'failures:' above" >&2
exit "$failed"
