#!/usr/bin/env python3
"""blocks.py [--in-place FOLDER] [--long] PAGE...: runs the shell blocks of documents as a reader would type them.

The blocks of a page are one script: what one block made is there for the next, and the first command that fails ends it. The script runs
in an empty folder that has links to those of the repository, so `models/pneunet/pneunet.twin` is a path there. Blocks of other languages
whose first line names a file in a comment (`# beam.py: ...`) are written to that file before. A program that was started with `&` is
waited for until it says that it is ready, and ends with its page. With --in-place the script runs in the repository's root, and it and its output are kept in FOLDER.

A block runs unless the line above it says otherwise, and the end of the output lists those that do not:

    <!-- not run: it needs a valve -->
    <!-- long: 200 states of finite elements -->       runs with --long, which runs the pages that have such a block
    <!-- needs: page.wasm -->                          runs if some crate has that file, which is made and not committed
    <!-- run by: scripts/check.sh -->                  its commands occur in that file; several files have a blank between them
"""
import argparse
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
LINKED = ("benchmarks", "clients", "config", "crates", "docs", "examples", "models", "scripts")
# Far above what a page takes: a machine may be busy.
LONGEST_S, LONGEST_OF_LONG_S = 900.0, 20000.0
KINDS = "not run|long|needs|run by"
BLOCK = re.compile(rf"(?:^<!-- (?P<kind>{KINDS}): (?P<about>[^\n]+) -->\n)?^```(?P<language>\w+)\n(?P<body>.*?)^```$", re.M | re.S)
# A program in the background that says when it is ready, by this word or by its address; a reader waits for that.
STARTED = re.compile(r"^(?:softtwind|softtwin view|softtwin-gateway|softtwin-studies rig)[^\n]*[^&\n]&(?: *#[^\n]*)?$", re.M)
PRELUDE = """set -euo pipefail -m
trap 'echo "failed: $BASH_COMMAND"' ERR
ready=0
wait_until_ready() {
    ready=$((ready + 1))
    until [ "$(grep -c 'ready:\|^http:' "$LOG")" -ge $ready ]; do
        kill -0 $! 2>/dev/null || { echo "ended before it was ready"; exit 1; }
        sleep 0.1
    done
}
"""
NAMED = re.compile(r"[^\n#]*# ?(?P<file>[\w-]+\.(?:py|toml|csv))\b")


def not_in(files, body):
    """The first command of a block that the files do not have: its program, and what follows it if that is a word."""
    text = "".join((ROOT / file).read_text() for file in files)
    for line in filter(None, map(lambda line: shlex.split(line, comments=True), body.splitlines())):
        words = [word for word in line if "=" not in word]
        command = " ".join(words[: 2 if len(words) > 1 and re.fullmatch(r"[a-z][a-z-]*", words[1]) else 1])
        if command.removeprefix("./") not in text:
            return command
    return None


def parsed(page, long):
    """The commands that run, those that do not with the reason, and the files that other blocks give."""
    text = page.read_text()
    commands, left_out, files, marked = [], [], {}, 0
    for block in BLOCK.finditer(text):
        kind, about, body = block["kind"], block["about"], block["body"]
        marked += kind is not None
        if block["language"] != "sh":
            if named := NAMED.match(body):
                files[named["file"]] = body
        elif kind is None or (kind == "long" and long) or (kind == "needs" and any(ROOT.glob(f"crates/*/{about}"))):
            commands.append(body)
        else:
            if kind == "run by" and (missing := not_in(about.split(), body)):
                raise SystemExit(f"blocks.py: {page}: expected `{missing}` in {about}, which is said to run it, found none")
            left_out.append((kind, body.split("\n", 1)[0].split("#")[0].strip(), about))
    if marked != len(re.findall(f"^<!-- (?:{KINDS}):", text, re.M)):
        raise SystemExit(f"blocks.py: {page}: expected a remark such as `<!-- not run: REASON -->` directly above a block, found one elsewhere")
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


def run(page, in_place, long, commands, files):
    """Runs the blocks of a page; returns the line that reports it, and its output if it failed."""
    began = time.monotonic()
    longest_s = LONGEST_OF_LONG_S if long else LONGEST_S
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
                code = process.wait(longest_s)
            except subprocess.TimeoutExpired:
                code = f"none within {longest_s:.0f} s"
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
    parser.add_argument("--long", action="store_true")
    parser.add_argument("pages", nargs="+", type=pathlib.Path, metavar="PAGE")
    options = parser.parse_args()
    known = {page: parsed(page, options.long) for page in options.pages}
    if options.in_place and not all(commands for commands, _, _ in known.values()):
        raise SystemExit(f"blocks.py: {options.pages[0]}: expected a block of commands, found none")
    if options.long:
        known = {page: found for page, found in known.items() if "<!-- long: " in page.read_text()}
    # One page after the other: two that take the same port would disturb each other.
    failed = 0
    for page, (commands, _, files) in known.items():
        if not commands:
            continue
        line, output = run(page, options.in_place, options.long, commands, files)
        print(line, flush=True)
        if output is not None:
            failed += 1
            print(output, file=sys.stderr)
    if not options.in_place:
        left_out = [(page, *block) for page, (_, blocks, _) in known.items() for block in blocks]
        print(f"{sum(len(commands) for commands, _, _ in known.values())} blocks ran, {len(left_out)} did not:")
        for page, kind, first, about in sorted(left_out, key=lambda block: block[1]):
            print(f"  {kind}: {about}: {page.resolve().relative_to(ROOT)}: {first[:60]}")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
