#!/usr/bin/env bash
# What takes longer than every change can wait for; run it before anything is called resolved. Some hours on two cores.
#   scripts/verify_all.sh            all of it
#   scripts/verify_all.sh WHAT...    only soak, cycles, sealed, inputs, kills, peers, ros2-peer, calculix, hard-cases or install
#   soak        an hour at 1 kHz with disturbances: nothing lost, nothing wrong, nothing that grows
#   cycles      10,000 restarts, reloads and rotations, 100,000 readers: nothing that grows, by its slope
#   sealed      40 states that no model has seen, solved afresh and compared with predictions and half-widths
#   inputs      100,000 damaged command lines and files, a million damaged inputs of the parsers
#   kills       every program killed at every system call of its start and end
#   peers       the same job by other libraries, from PyPI
#   ros2-peer   the network gateway by an implementation of ROS 2 that is not ours
#   calculix    a finger by CalculiX; needs root to install it
#   hard-cases  cases with a known truth
#   install     packages of a release build, with the gateway's
# Results go to build/verify, one log each; it ends with 1 when something failed.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
usage() { sed -n '2,14s/^# \{0,1\}//p' "$0"; }
for what in "$@"; do
    case "$what" in
        soak | cycles | sealed | inputs | kills | peers | ros2-peer | calculix | hard-cases | install) ;;
        -h | --help) usage; exit ;;
        *) usage >&2; exit 2 ;;
    esac
done
[ $# -gt 0 ] || set -- soak cycles sealed inputs kills peers ros2-peer calculix hard-cases install
out=build/verify
mkdir -p "$out"
target=${CARGO_TARGET_DIR:-target}

studies() { "$target/release/softtwin-studies" "$@"; }
soak() { studies soak --seconds 3600 --report "$out/soak.json"; }

cycles() { studies cycles > "$out/cycles.json"; }
sealed() { studies sweep --fresh 40 --below-mpa 0.005 --database "$target/sweep"; }
inputs() {
    SOFTTWIN_INPUTS=1000000 cargo test --locked --workspace --test inputs &&
        SOFTTWIN_HOSTILE=100000 cargo test --locked --workspace --test system -- hostile::
}
kills() { SOFTTWIN_KILLS=all SOFTTWIN_KILLED_READERS=1500 cargo test --locked --workspace --test system -- kills::; }
peers() { studies peers; }
ros2-peer() { scripts/check.sh ros2-peer; }
calculix() { scripts/check.sh calculix; }
hard-cases() { studies hard-cases; }
install() {
    scripts/check.sh install --profile release &&
        scripts/package_deb.sh "$out" --profile release --gateway
}

cargo build --locked --release -p softtwin -p softtwind -p studies --bins || exit 1
failed=()
for what in "$@"; do
    begin=$SECONDS
    if "$what" >"$out/$what.log" 2>&1; then result=holds; else result="FAILED, see $out/$what.log"; failed+=("$what"); fi
    printf '%-10s %6d s  %s\n' "$what" $((SECONDS - begin)) "$result"
done
[ ${#failed[@]} -eq 0 ]
