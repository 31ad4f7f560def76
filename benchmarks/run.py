"""Learns and predicts every task with every model, prints the table, keeps the figures in results.json.

    python benchmarks/run.py                       all tasks, all models
    python benchmarks/run.py --models narx softtwin --tasks "arm 10-2"
    python benchmarks/run.py --draw errors.svg     draws the figures of results.json

`softtwin` is found on PATH, or SOFTTWIN_BIN names its folder. A model is a file of `models` with a class `Model` that has
`learn(runs)` and `predict(time_s, inputs) -> (outputs, half_widths)`; it never sees the outputs it is judged on.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: times are those of one thread
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import importlib
import json
import math
import resource
import sys
import time

from benchmark import HERE, Refused, judged, rounded, tasks

OWN = "softtwin"
ALL_MODELS = sorted(path.stem for path in (HERE / "models").glob("*.py"))
RESULTS = HERE / "results.json"


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--models", nargs="+", default=ALL_MODELS)
    options.add_argument("--tasks", nargs="+", help="names of tasks [default: all]")
    options.add_argument("--draw", metavar="FILE", help="draw results.json instead")
    options.add_argument("--json", action="store_true", help="print results as JSON")
    chosen = options.parse_args()
    if chosen.draw:
        return draw(chosen.draw)
    results = []
    for task in tasks():
        if chosen.tasks and task.name not in chosen.tasks:
            continue
        for name in chosen.models:
            try:
                results.append({"task": task.name, "kind": task.kind, "model": name, **measured(task, name)})
            except Refused as reason:
                print(f"{task.name}: {name} refuses: {reason}", file=sys.stderr)
            print(f"{task.name}: {name}", file=sys.stderr, flush=True)
    if not chosen.tasks and chosen.models == ALL_MODELS:
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    print(json.dumps(results) if chosen.json else table(results))


def measured(task, name: str) -> dict:
    """One model on one task: errors, half-widths, processor seconds to learn, microseconds per predicted reading."""
    model = importlib.import_module(f"models.{name}").Model()
    begin = cpu_s()
    model.learn(task.learned)
    learned = cpu_s()
    outputs, half_widths = model.predict(task.predicted.time_s, task.predicted.inputs)
    predicted = cpu_s()
    own_step_us = getattr(model, "step_us", None)  # a program that starts for each prediction measures its steps itself
    return {
        **judged(task.predicted, outputs, half_widths),
        "selection_percent": rounded(100 * model.score) if hasattr(model, "score") else None,
        "learn_s": rounded(learned - begin),
        "step_us": rounded(own_step_us or 1e6 * (predicted - learned) / len(outputs)),
    }


def cpu_s() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def selected(results: list[dict], task: str) -> dict | None:
    """The peer with the smallest error on left-out parts of the learned runs: what one would have chosen without seeing the rest."""
    peers = [result for result in results if result["task"] == task and result["selection_percent"] is not None and result["model"] != OWN]
    return min(peers, key=lambda result: result["selection_percent"], default=None)


def table(results: list[dict]) -> str:
    """Error per task and model as Markdown; the peer selected on the learned runs is bold. Then what the half-widths hold and cost."""
    # The ratio and softtwin come first: the table is wide.
    models = sorted(dict.fromkeys(result["model"] for result in results), key=lambda name: name != OWN)
    lines = ["| task | kind | softtwin / selected peer | " + " | ".join(models) + " |", "|---|---|---|" + "---|" * len(models)]
    ratios, to_best = [], []
    for task in dict.fromkeys(result["task"] for result in results):
        row = {result["model"]: result for result in results if result["task"] == task}
        peer = selected(results, task)
        cells = []
        for model in models:
            text = f"{row[model]['rms_percent']:.2f}" if model in row else "refused"
            cells.append(f"**{text}**" if peer and model == peer["model"] else text)
        ratio_text = ""
        if peer and OWN in row:
            ratio = row[OWN]["rms_percent"] / peer["rms_percent"]
            ratio_text = f"{ratio:.2f}"
            if row[OWN]["kind"] != "beyond":  # there a peer's error has no bound, and would rule the mean
                ratios.append(ratio)
                to_best.append(row[OWN]["rms_percent"] / min(found["rms_percent"] for name, found in row.items() if name != OWN))
        lines.append(f"| {task} | {next(iter(row.values()))['kind']} | {ratio_text} | " + " | ".join(cells) + " |")
    if ratios:
        geometric = lambda values: math.exp(sum(map(math.log, values)) / len(values))
        lines.append(f"\nRatio, geometric mean over {len(ratios)} tasks within what was learned: {geometric(ratios):.2f}")
        lines.append(f"To the peer that turned out best, which nobody can choose before: {geometric(to_best):.2f} ({min(to_best):.2f} to {max(to_best):.2f})")
    lines += ["", "| model | coverage, mean % | coverage, least % | median half-width / 90 % error | learn, s | step, us |", "|---|---|---|---|---|---|"]
    for model in models:
        own = [result for result in results if result["model"] == model]
        coverage = [value for result in own for value in result["coverage_percent"] if value is not None]
        widths = sorted(value for result in own for value in result["width_over_error"] if value is not None)
        median = lambda values: sorted(values)[len(values) // 2] if values else float("nan")
        mean = sum(coverage) / len(coverage) if coverage else float("nan")
        lines.append(
            f"| {model} | {mean:.0f} | {min(coverage, default=float('nan')):.0f} | {median(widths):.2f} "
            f"| {median([r['learn_s'] for r in own]):.1f} | {median([r['step_us'] for r in own]):.1f} |"
        )
    return "\n".join(lines)


def draw(path: str):
    """Error of every model on every task, on a logarithmic axis."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    results = json.loads(RESULTS.read_text())
    names = list(dict.fromkeys(result["task"] for result in results))
    figure, axes = pyplot.subplots(figsize=(9, 0.5 * len(names) + 1.5), layout="constrained")
    for model in dict.fromkeys(result["model"] for result in results):
        errors = {result["task"]: result["rms_percent"] for result in results if result["model"] == model}
        is_own = model == OWN
        axes.plot(
            [errors.get(name) for name in names],
            range(len(names)),
            "D" if is_own else "o",
            label=model.replace("_", " "),
            markersize=9 if is_own else 6,
            color="black" if is_own else None,
            zorder=3 if is_own else 2,
        )
    axes.set(xscale="log", xlabel="RMS error of the run that was not learned, % of the range", yticks=range(len(names)), yticklabels=names)
    axes.invert_yaxis()
    axes.grid(axis="x", which="both", alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    figure.savefig(path)


if __name__ == "__main__":
    main()
