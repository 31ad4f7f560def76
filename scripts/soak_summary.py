#!/usr/bin/env python3
"""Sums up what scripts/soak.sh left in its folder; prints one JSON object, ends with 1 when something is wrong."""
import json
import statistics
import sys
from pathlib import Path

work, seconds, rate, readers = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
PROGRAMS = ["twin", "bridge", "recorder"]
# Columns of each of them; in front stands the time, behind them two counts of files.
PER_PROGRAM = ["resident_kb", "private_kb", "open_files", "threads"]
# The first tenth is warm-up: pages are touched as samples first travel through them.
WARM_UP = 0.1
# Growth that counts as a leak over the whole run: a page more now and then is the allocator's business.
GROWTH_KB = 2048
GROWTH_FILES = 4
# What may end otherwise than published without anything being wrong: the newest reading won.
HARMLESS = {"published", "dropped: superseded"}

rows = []
for line in (work / "rows").read_text().splitlines():
    *numbers, top = line.split(" ", 3 + len(PER_PROGRAM) * len(PROGRAMS))
    rows.append(([int(number) for number in numbers], json.loads(top)))
settled = rows[min(len(rows) - 1, max(1, int(len(rows) * WARM_UP))):]


def begin_end_max(index):
    """Medians of the first and the last tenth: a moment's backlog is no leak, and a leak shows in both."""
    column = [numbers[index] for numbers, _ in settled]
    tenth = max(1, len(column) // 10)
    begin, end = (round(statistics.median(part)) for part in (column[:tenth], column[-tenth:]))
    return [begin, end, max(column)]


def by_program(what):
    first = 1 + PER_PROGRAM.index(what)
    return {name: begin_end_max(first + len(PER_PROGRAM) * i) for i, name in enumerate(PROGRAMS)}


def halves(key):
    values = [twin[key] for _, top in settled for twin in top if twin["actuator"] == "steady" and twin.get(key)]
    middle = max(1, len(values) // 2)
    return [round(statistics.median(half), 1) for half in (values[:middle], values[middle:] or values[:middle])]


record = json.loads((work / "record.json").read_text())
judges = {name: json.loads((work / f"judge.{name}.json").read_text()) for name in ("steady", "disturbed")}
last_top = {twin["actuator"]: twin for _, top in rows for twin in top}
unusual = {k: v for k, v in last_top["steady"]["outcomes"].items() if v and k not in HARMLESS}
report = {
    "seconds": seconds,
    "rate_hz": rate,
    "faults": dict(line.split() for line in (work / "injected").read_text().splitlines()),
    "readers_come_and_gone": readers,
    "recorded_messages": sum(record["messages"].values()),
    "lost_in_recorder": record["missing"] + record["dropped"],
    "judges": judges,
    "unusual_outcomes_steady": unusual,
    **{f"{what}_begin_end_max": by_program(what) for what in PER_PROGRAM},
    "shared_memory_files_begin_end_max": begin_end_max(-2),
    "management_files_begin_end_max": begin_end_max(-1),
    "latency_p50_us_first_and_second_half": halves("latency_p50_us"),
    "latency_p99_us_first_and_second_half": halves("latency_p99_us"),
}
wrong = [
    f"{report['lost_in_recorder']} samples lost in the recorder" if report["lost_in_recorder"] else "",
    *(f"at the end not recorded: {what}" for what in record["troubles"].values()),
    *(f"{name}: {judge}" for name, judge in judges.items()
      if judge["wrong_fields"] or judge["wrong_states"] or judge["states_out_of_order"] or not judge["fields_checked"]),
    f"unusual outcomes {unusual}" if unusual else "",
    *(f"{name} grew by {v[1] - v[0]} kB ({what})" for what in ("resident_kb", "private_kb")
      for name, v in report[f"{what}_begin_end_max"].items() if v[1] - v[0] > GROWTH_KB),
    *(f"{name} holds {v[1] - v[0]} more files" for name, v in report["open_files_begin_end_max"].items()
      if v[1] - v[0] > GROWTH_FILES),
    *(f"{what} grew: {report[what]}" for what in ("shared_memory_files_begin_end_max", "management_files_begin_end_max")
      if report[what][1] - report[what][0] > 2 * GROWTH_FILES),
]
report["wrong"] = [text for text in wrong if text]
print(json.dumps(report, indent=1))
sys.exit(1 if report["wrong"] else 0)
