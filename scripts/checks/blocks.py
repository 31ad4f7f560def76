#!/usr/bin/env python3
"""blocks.py [--in-place FOLDER] PAGE...: runs the shell blocks of documents as a reader would type them.

The blocks of a page are one script: what one block made is there for the next, and the first command that fails ends it. The script runs
in an empty folder that has links to those of the repository, so `models/pneunet/pneunet.twin` is a path there. Blocks of other languages
whose first line names a file in a comment (`# beam.py: ...`) are written to that file before. A program that was started with `&` is
waited for until it says that it is ready, and ends with its page. With --in-place the script runs in the repository's root, and it and its output are kept in FOLDER.

A block runs unless the line above it says why not, and the end of the output lists those that do not:

    <!-- not run: it needs a valve -->
"""
import argparse
import concurrent.futures
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
LINKED = ("benchmarks", "clients", "config", "crates", "docs", "examples", "models", "scripts")
# Far above what a page takes: a machine may be busy.
LONGEST_S = 600.0
BLOCK = re.compile(r"(?:^<!-- not run: (?P<reason>[^\n]+) -->\n)?^```(?P<language>\w+)\n(?P<body>.*?)^```$", re.M | re.S)
# A daemon in the background; a reader waits until it says that it is ready.
STARTED = re.compile(r"^soft[^\n]*[^&\n]&(?: *#[^\n]*)?$", re.M)
PRELUDE = """set -euo pipefail -m
trap 'echo "failed: $BASH_COMMAND"' ERR
ready=0
wait_until_ready() {
    ready=$((ready + 1))
    until [ "$(grep -c ready: "$LOG")" -ge $ready ]; do
        kill -0 $! 2>/dev/null || { echo "ended before it was ready"; exit 1; }
        sleep 0.1
    done
}
"""
NAMED = re.compile(r"[^\n#]*# ?(?P<file>[\w-]+\.(?:py|toml|csv))\b")


def parsed(page):
    """The commands that run, those that do not with the reason, and the files that other blocks give."""
    text = page.read_text()
    commands, left_out, files = [], [], {}
    for block in BLOCK.finditer(text):
        if block["language"] == "sh":
            first = block["body"].split("\n", 1)[0]
            left_out.append((first, block["reason"])) if block["reason"] else commands.append(block["body"])
        elif named := NAMED.match(block["body"]):
            files[named["file"]] = block["body"]
    if len(left_out) != len(re.findall("^<!-- not run:", text, re.M)):
        raise SystemExit(f"blocks.py: {page}: expected `<!-- not run: REASON -->` directly above a block of `sh`, found one elsewhere")
    return commands, left_out, files


def members(session):
    """Processes of a session."""
    found = []
    for process in map(int, filter(str.isdigit, os.listdir("/proc"))):
        try:
            if os.getsid(process) == session:
                found.append(process)
        except ProcessLookupError:
            continue  # it has ended meanwhile
    return found


def end_session(session):
    """Ends what a script has left running: asks first, because what a killed program leaves has to be removed by the next one."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        for process in members(session):
            try:
                os.kill(process, sign)
            except ProcessLookupError:
                continue
        until = time.monotonic() + 5.0
        while members(session) and time.monotonic() < until:
            time.sleep(0.05)


def run(page, in_place=None):
    """Runs the blocks of a page; returns the line that reports it, and its output if it failed."""
    commands, _, files = parsed(page)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="page") as scratch:
        folder = in_place or pathlib.Path(scratch)
        if not in_place:
            for name in LINKED:
                (folder / name).symlink_to(ROOT / name)
            (folder / "build").mkdir()
            for name, body in files.items():
                (folder / name).write_text(body)
        script = folder / "script"
        script.write_text(PRELUDE + STARTED.sub(r"\g<0>\nwait_until_ready", "".join(commands)))
        with tempfile.TemporaryDirectory(prefix="iox") as root, (folder / "log").resolve().open("w+") as log:
            process = subprocess.Popen(
                ["bash", str(script)],
                cwd=ROOT if in_place else folder,
                # Each page has its own shared memory: the folder's name is unique, and short.
                env={**os.environ, "SOFTTWIN_DOMAIN": pathlib.Path(root).name, "SOFTTWIN_ROOT": root, "LOG": log.name},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                code = process.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                code = f"none within {LONGEST_S:.0f} s"
            end_session(process.pid)
            process.wait()
            for left in pathlib.Path("/dev/shm").glob(f"iox2_{pathlib.Path(root).name}_*"):
                left.unlink()  # the counter of nodes, which outlives its domain
            log.seek(0)
            said = "".join(log.readlines()[-100:])
    name = page.resolve().relative_to(ROOT)
    if code != 0:
        return f"{name}: expected exit code 0, found {code}", said
    return f"{str(name):42} {len(commands):2} blocks {time.monotonic() - began:5.1f} s", None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--in-place", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("pages", nargs="+", type=pathlib.Path, metavar="PAGE")
    options = parser.parse_args()
    known = {page: parsed(page) for page in options.pages}
    if options.in_place and not all(commands for commands, _, _ in known.values()):
        raise SystemExit(f"blocks.py: {options.pages[0]}: expected a block of commands, found none")
    pages = [page for page, (commands, _, _) in known.items() if commands]
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for line, output in pool.map(lambda page: run(page, options.in_place), pages):
            print(line, flush=True)
            if output is not None:
                failed += 1
                print(output, file=sys.stderr)
    if not options.in_place:
        ran = sum(len(commands) for commands, _, _ in known.values())
        left_out = [(page, *block) for page, (_, blocks, _) in known.items() for block in blocks]
        print(f"{ran} blocks ran. {len(left_out)} did not:")
        for page, first, reason in left_out:
            print(f"  {page.resolve().relative_to(ROOT)}: {first[:60]}: {reason}")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
