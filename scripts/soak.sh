#!/usr/bin/env bash
# Soak test in one domain: a steady twin that nobody touches, a disturbed twin that is killed, stopped, reloaded and starved, a
# disk that is kept busy, a recorder of both, a judge of each that computes every sample again, and readers that come and go.
# Reports memory, files, latency drift, lost and wrong samples; ends with 1 when something was lost, wrong or grew.
#   scripts/soak.sh --seconds 3600 --model models/pneunet/pneunet.twin --report soak.json
#   scripts/soak.sh --seconds 60 --model FILE --rate 1000 --no-faults
# --rate is that of the steady twin, Hz. Needs the programs (cargo build --release --workspace --bins; SOFTTWIN_BIN names their
# folder), bash, awk, and python3 for the summary.
set -euo pipefail
{ # read as a whole: whoever edits this file meanwhile must not change a run of hours
cd "$(dirname "${BASH_SOURCE[0]}")/.."

seconds=60 rate=1000 model="" faults=1 bin=${SOFTTWIN_BIN:-target/release} keep=0 report=/dev/null
usage() { sed -n '2,8s/^# \{0,1\}//p' "$0"; exit "${1:-2}"; }
while (($#)); do
    case $1 in
        --seconds) seconds=$2; shift 2 ;;
        --rate) rate=$2; shift 2 ;;
        --model) model=$2; shift 2 ;;
        --bin) bin=$2; shift 2 ;;
        --report) report=$(realpath -m "$2"); shift 2 ;;
        --no-faults) faults=0; shift ;;
        --keep) keep=1; shift ;;
        -h | --help) usage 0 ;;
        *) echo "soak: unknown option $1" >&2; usage ;;
    esac
done
[[ -n $model && -f $model ]] || { echo "soak: --model: expected a model file, found '${model}'" >&2; exit 2; }
for program in softtwind softtwin soak_reader; do
    [[ -x $bin/$program ]] || { echo "soak: $bin/$program is not built; cargo build --release --workspace --bins" >&2; exit 2; }
done
bin=$(realpath "$bin") model=$(realpath "$model")

work=$(mktemp -d)
export SOFTTWIN_DOMAIN=soak_$$ SOFTTWIN_ROOT=$work/iox
finish() {
    local own # only what still runs: in hours the system gives the numbers of the dead to other programs
    own=$(jobs -p)
    for pid in $own; do kill -CONT "$pid" 2>/dev/null || true; kill "$pid" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -f /dev/shm/iox2_soak_$$_*
    if ((keep)); then echo "soak: files are in $work" >&2; else rm -rf "$work"; fi
}
trap finish EXIT

# A copy: whoever trains the model anew meanwhile must not change what the judges expect.
cp "$model" "$work/model.twin"
model=$work/model.twin
scene() { # name, rate in Hz, gap in mm
    cp "$model" "$work/$1.twin"
    cat >"$work/$1.toml" <<SCENE
name = "$1"
[[actuator]]
name = "$1"
model = "$1.twin"
[actuator.source]
kind = "simulate"
rate_hz = $2
gap_mm = $3
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 0.5 }
[[actuator.output]]
nodes = "all"
SCENE
}
scene steady "$rate" 40.0
scene disturbed 200 40.0

declare -A injected=()
count() { injected[$1]=$((${injected[$1]:-0} + 1)); }
daemon() { # role, scene: sets `started` once it is ready; a start that fails is tried again, as systemd would, and counted
    local log=$work/$2.$1.log said attempt
    touch "$log"
    for attempt in 1 2 3 4 5; do
        said=$(grep -c "ready:" "$log" || true)
        "$bin/softtwind" "$1" --scene "$work/$2.toml" 2>>"$log" &
        started=$!
        while kill -0 "$started" 2>/dev/null; do
            if (($(grep -c 'ready:' "$log" || true) > said)); then return; fi
            sleep 0.02
        done
        count failed_start
        sleep 0.2
    done
    echo "soak: the $1 of $2 does not start: $(tail -n 3 "$log")" >&2
    exit 1
}
daemon twin steady; steady_twin=$started
daemon twin disturbed; twin=$started
"$bin/softtwin" record --out "$work/run.mcap" --rotate-mb 256 --keep 4 --json >"$work/record.json" 2>"$work/record.log" &
recorder=$!
sleep 1 # the recorder looks for topics once in a while; what is sent before it has found them is not lost
daemon bridge steady; steady_bridge=$started
daemon bridge disturbed; bridge=$started
judges=()
for name in steady disturbed; do
    "$bin/soak_reader" "$model" "$name" "$seconds" 20 >"$work/judge.$name.json" 2>"$work/judge.$name.log" &
    judges+=($!)
done

# All pages it has in memory, and those that are its own: the rest is program text and shared memory, mapped as it is first used.
memory_kb() { awk '/^VmRSS/ {all = $2} /^RssAnon/ {own = $2} END {print all, own}' "/proc/$1/status"; }
open_files() { find "/proc/$1/fd" -mindepth 1 | wc -l; }
threads() { awk '/^Threads/ {print $2}' "/proc/$1/status"; }
shm_files() { find /dev/shm -name "iox2_soak_$$_*" | wc -l; }
row() {
    local top pid
    top=$("$bin/softtwin" top --once --json 2>/dev/null || echo '[]')
    {
        printf '%s' "$SECONDS"
        for pid in "$steady_twin" "$steady_bridge" "$recorder"; do
            printf ' %s %s %s' "$(memory_kb "$pid")" "$(open_files "$pid")" "$(threads "$pid")"
        done
        printf ' %s %s %s\n' "$(shm_files)" "$(find "$SOFTTWIN_ROOT" -type f | wc -l)" "$top"
    } >>"$work/rows"
}

echo "soak: ${seconds} s, steady at ${rate} Hz, faults: $faults, model $model" >&2
begin=$SECONDS turn=0 readers=0
disturb() {
    case $((turn % 9)) in
        0) count kill_bridge; kill -9 "$bridge"; wait "$bridge" 2>/dev/null || true; daemon bridge disturbed; bridge=$started ;;
        1) count kill_twin; kill -9 "$twin"; wait "$twin" 2>/dev/null || true; daemon twin disturbed; twin=$started ;;
        2) count stop_bridge_500ms; kill -STOP "$bridge"; sleep 0.5; kill -CONT "$bridge" ;;
        3) count reload; kill -HUP "$twin" ;;
        4) count damaged_model; printf 'damage' | dd of="$work/disturbed.twin" bs=1 seek=5000 conv=notrunc status=none
           kill -HUP "$twin"; sleep 1; cp "$model" "$work/disturbed.twin" ;;
        5) count stopped_reader
           "$bin/softtwin" echo softtwin/disturbed/field >/dev/null 2>&1 & local reader=$!
           sleep 0.5; kill -STOP "$reader"; sleep 2; kill -9 "$reader"; wait "$reader" 2>/dev/null || true ;;
        6) count stop_twin_500ms; kill -STOP "$twin"; sleep 0.5; kill -CONT "$twin" ;;
        7) count kill_both; kill -9 "$twin" "$bridge"; wait "$twin" "$bridge" 2>/dev/null || true
           daemon bridge disturbed; bridge=$started; daemon twin disturbed; twin=$started ;;
        8) count busy_disk # the disk of recording and management files: whoever waits for it waits for seconds
           dd if=/dev/zero of="$work/ballast" bs=1M count=2000 conv=fsync status=none; rm "$work/ballast" ;;
    esac
}
while ((SECONDS - begin < seconds)); do
    row
    # A reader that comes, takes a few states and goes; every third is killed in the middle.
    "$bin/softtwin" echo 'softtwin/*/state' >/dev/null 2>&1 & reader=$!
    sleep 0.5
    if ((turn % 3 == 0)); then kill -9 "$reader" || true; else kill -TERM "$reader" || true; fi # a shell's children ignore INT until they have a handler
    wait "$reader" 2>/dev/null || true
    readers=$((readers + 1))
    if ((faults)); then disturb; fi
    turn=$((turn + 1))
    sleep 5
done
row
for judge in "${judges[@]}"; do wait "$judge" || true; done
kill -INT "$recorder"
wait "$recorder" || true
for pid in "$bridge" "$steady_bridge" "$twin" "$steady_twin"; do kill -TERM "$pid"; wait "$pid" || true; done
for name in "${!injected[@]}"; do echo "$name ${injected[$name]}"; done >"$work/injected"
python3 scripts/soak_summary.py "$work" "$seconds" "$rate" "$readers" | tee "$report"
exit "${PIPESTATUS[0]}"
}
