"""softtwin, as its users call it: `softtwin learn` on the recordings, `softtwin predict --trace` on instants and inputs."""

import csv
import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from benchmark import Refused

UNITS = {"mm": "mm", "mpa": "MPa", "n": "N", "deg": "deg"}
TEACHES_NOTHING = 65  # exit code
PROGRAM = str(Path(os.environ.get("SOFTTWIN_BIN", "")) / "softtwin")


def run(*arguments) -> dict:
    done = subprocess.run([PROGRAM, *map(str, arguments), "--json"], capture_output=True, text=True)
    if done.returncode == TEACHES_NOTHING:
        raise Refused(done.stderr)
    if done.returncode:
        raise RuntimeError(f"softtwin {' '.join(map(str, arguments))}: exit code {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


class Model:
    def learn(self, runs):
        self.folder = tempfile.TemporaryDirectory()
        folder = Path(self.folder.name)
        self.inputs, self.outputs = runs[0].input_names, runs[0].output_names
        mapping = ["[time]", 'column = "t_s"', 'unit = "s"']
        for kind, names in (("input", self.inputs), ("output", self.outputs)):
            for name in names:
                unit = UNITS[name.rsplit("_", 1)[1]]
                mapping += [f"[[{kind}]]", f'name = "{name}"', f'column = "{name}"', f'unit = "{unit}"']
        (folder / "log.toml").write_text("\n".join(mapping) + "\n")
        paths = []
        for number, recording in enumerate(runs):
            paths.append(folder / f"run{number}.csv")
            self.write(paths[-1], recording.time_s, [*self.inputs, *self.outputs], np.hstack([recording.inputs, recording.outputs]))
        self.model = folder / "learned.twin"
        report = run("learn", *paths, "--log", folder / "log.toml", "--out", self.model)
        self.taken = [name in report["inputs"] for name in self.inputs]  # inputs that do not move are left out

    def write(self, path, time_s, names, columns):
        time_s = np.arange(len(columns), dtype=float) if time_s is None else time_s - time_s[0]
        with open(path, "w", newline="") as out:
            table = csv.writer(out)
            table.writerow(["t_s", *names])
            table.writerows([repr(float(value)) for value in row] for row in np.column_stack([time_s, columns]))
        return time_s

    def predict(self, time_s, inputs):
        folder = Path(self.folder.name)
        names = [name for name, is_taken in zip(self.inputs, self.taken) if is_taken]
        instants = self.write(folder / "trace.csv", time_s, names, inputs[:, self.taken])
        report = run("predict", self.model, "--trace", folder / "trace.csv", "--out", folder / "series.csv", "--step-ms", 1000)
        series = np.genfromtxt(folder / "series.csv", delimiter=",", names=True)
        self.step_us = report["state_us_per_ms"] * 1e3 * report["seconds"] / report["rows"]
        column = lambda name: np.interp(instants, series["t_s"], series[name])
        return (
            np.stack([column(name) for name in self.outputs], 1),
            np.stack([column(f"{name}_half_width") for name in self.outputs], 1),
        )
