#!/usr/bin/env bash
# Soak test: bridge, twin, recorder and readers that come and go, with faults injected, for a given time. Reports memory,
# files, latency drift, lost and wrong samples, and exits with 1 when something was lost, wrong or grew.
#   scripts/soak.sh --seconds 3600 --model models/pneunet/model.twin
#   scripts/soak.sh --seconds 60 --model FILE --rate 1000 --no-faults
# Needs the two programs (cargo build --release --bins), bash, awk, and python3 for the summary.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

seconds=60 rate=1000 model="" faults=1 bin=${SOFTTWIN_BIN:-target/release} keep=0
usage() { sed -n '2,7s/^# \{0,1\}//p' "$0"; exit "${1:-2}"; }
while (($#)); do
    case $1 in
        --seconds) seconds=$2; shift 2 ;;
        --rate) rate=$2; shift 2 ;;
        --model) model=$2; shift 2 ;;
        --bin) bin=$2; shift 2 ;;
        --no-faults) faults=0; shift ;;
        --keep) keep=1; shift ;;
        -h | --help) usage 0 ;;
        *) echo "soak: unknown option $1" >&2; usage ;;
    esac
done
[[ -n $model && -f $model ]] || { echo "soak: --model: expected a model file, found '${model}'" >&2; exit 2; }
for program in softtwind softtwin; do
    [[ -x $bin/$program ]] || { echo "soak: $bin/$program is not built; cargo build --release --bins" >&2; exit 2; }
done
bin=$(realpath "$bin") model=$(realpath "$model")

work=$(mktemp -d)
export SOFTTWIN_DOMAIN=soak_$$ SOFTTWIN_ROOT=$work/iox
pids=()
finish() {
    for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -f /dev/shm/iox2_soak_$$_*
    if ((keep)); then echo "soak: files are in $work" >&2; else rm -rf "$work"; fi
}
trap finish EXIT

cat >"$work/scene.toml" <<SCENE
name = "soak"
[[actuator]]
name = "finger"
model = "$model"
[actuator.source]
kind = "simulate"
rate_hz = $rate
gap_mm = 40.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 0.5 }
[[actuator.output]]
nodes = "all"
SCENE

start_twin() { "$bin/softtwind" twin --scene "$work/scene.toml" 2>>"$work/twin.log" & twin=$!; pids+=("$twin"); }
start_bridge() { "$bin/softtwind" bridge --scene "$work/scene.toml" 2>>"$work/bridge.log" & bridge=$!; pids+=("$bridge"); }
start_twin
start_bridge
"$bin/softtwin" record --out "$work/run.mcap" --rotate-mb 256 --keep 4 --json >"$work/record.json" 2>"$work/record.log" &
recorder=$!
pids+=("$recorder")

resident_kb() { awk '/^VmRSS/ {print $2}' "/proc/$1/status" 2>/dev/null || echo 0; }
open_files() { find "/proc/$1/fd" -mindepth 1 2>/dev/null | wc -l; }
shm_files() { find /dev/shm -name "iox2_soak_$$_*" | wc -l; }
row() {
    local top
    top=$("$bin/softtwin" top --once --json 2>/dev/null || echo '[]')
    echo "$SECONDS $(resident_kb "$twin") $(resident_kb "$bridge") $(resident_kb "$recorder") $(open_files "$twin") $(open_files "$recorder") $(shm_files) $top" >>"$work/rows"
}

echo "soak: ${seconds} s at ${rate} Hz, faults: $faults, model $model" >&2
begin=$SECONDS turn=0 kills=0 readers=0
sleep 3
while ((SECONDS - begin < seconds)); do
    row
    turn=$((turn + 1))
    # A reader that comes, takes a few states and goes; every third is killed in the middle.
    timeout 3 "$bin/softtwin" top --key 'softtwin/**' --once >/dev/null 2>&1 & reader=$!
    readers=$((readers + 1))
    ((turn % 3 == 0)) && { sleep 0.2; kill -9 "$reader" 2>/dev/null || true; }
    if ((faults && turn % 6 == 0)); then
        kill -9 "$bridge"; wait "$bridge" 2>/dev/null || true; start_bridge; kills=$((kills + 1))
    fi
    if ((faults && turn % 10 == 0)); then
        kill -9 "$twin"; wait "$twin" 2>/dev/null || true; start_twin; kills=$((kills + 1))
    fi
    sleep 5
done
row
kill -INT "$recorder"
wait "$recorder" || true
cat "$work/record.json" >&2

python3 - "$work" "$faults" "$kills" "$readers" <<'SUMMARY'
import json, sys
work, faults, kills, readers = sys.argv[1], sys.argv[2] == "1", int(sys.argv[3]), int(sys.argv[4])
rows = [line.split(" ", 7) for line in open(f"{work}/rows")]
# The first rows are the programs' own warm-up; a row right after a restart is one too.
settled = rows[max(1, len(rows) // 5):] or rows
column = lambda index: [int(row[index]) for row in settled]
tops = [entry for row in settled for entry in json.loads(row[7])]
p50 = [entry["latency_p50_us"] for entry in tops if entry.get("latency_p50_us")]
p99 = [entry["latency_p99_us"] for entry in tops if entry.get("latency_p99_us")]
half = max(1, len(p50) // 2)
mean = lambda values: sum(values) / len(values) if values else float("nan")
record = json.load(open(f"{work}/record.json"))
bad = {}
for entry in tops:
    for name, count in entry["outcomes"].items():
        if name not in ("published", "dropped: superseded") and count:
            bad[name] = max(bad.get(name, 0), count)
growth = lambda values: values[-1] - values[0] if values else 0
report = {
    "seconds": int(rows[-1][0]) - int(rows[0][0]),
    "kills": kills,
    "readers": readers,
    "recorded": sum(record["messages"].values()),
    "lost_in_recorder": record["missing"] + record["dropped"],
    "wrong_outcomes": bad,
    "twin_rss_kb": [column(1)[0], column(1)[-1]],
    "bridge_rss_kb": [column(2)[0], column(2)[-1]],
    "recorder_rss_kb": [column(3)[0], column(3)[-1]],
    "twin_open_files": [column(4)[0], column(4)[-1]],
    "recorder_open_files": [column(5)[0], column(5)[-1]],
    "shm_files": [column(6)[0], column(6)[-1]],
    "latency_p50_us_first_and_second_half": [round(mean(p50[:half]), 1), round(mean(p50[half:]), 1)],
    "latency_p99_us_first_and_second_half": [round(mean(p99[:half]), 1), round(mean(p99[half:]), 1)],
}
print(json.dumps(report))
grew = [name for name, values in (("twin", column(1)), ("bridge", column(2)), ("recorder", column(3))) if growth(values) > 8192]
leaked = growth(column(6)) > 4 or growth(column(5)) > 8
failed = record["missing"] + record["dropped"] > 0 or bad or leaked or (not faults and grew)
sys.exit(1 if failed else 0)
SUMMARY
