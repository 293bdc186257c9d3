"""Pictures of numbers that benchmarks left in benchmarks/results."""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from style import BLUE, FAINT, GREEN, INK, MUTED, ORANGE, new_figure

_RESULTS = Path(__file__).parents[3] / "benchmarks" / "results"
_METHODS = {"static": MUTED, "paper": BLUE, "bayesian": ORANGE}
_WORDS = {"static": "static: joint torques at rest", "paper": "paper: bisection", "bayesian": "bayesian"}


def _lines(name: str) -> list[dict]:
    return [json.loads(line) for line in (_RESULTS / name).read_text(encoding="utf-8").splitlines()]


def draw_methods() -> Figure:
    """How far from the truth each method's planar CoM was, one dot a simulated A1."""
    figure = new_figure(7.4, 2.6)
    axes = figure.add_subplot()
    rng = np.random.default_rng(0)
    rows = [
        row for row in _lines("accuracy.jsonl") if row["case"][:2] == ["unitree_a1", "realistic"] and "error" in row
    ]
    for place, (method, colour) in enumerate(_METHODS.items()):
        errors = np.array([1000 * np.hypot(*row["error"][1:3]) for row in rows if row["case"][2] == method])
        axes.plot(
            errors, place + rng.uniform(-0.24, 0.24, len(errors)), "o", color=colour, markersize=3.4, alpha=0.5, mew=0
        )
        rms = float(np.sqrt(np.mean(errors**2)))
        axes.plot([rms, rms], [place - 0.36, place + 0.36], color=INK, linewidth=2)
        axes.annotate(f"{rms:.2g} mm rms, n = {len(errors)}", (rms, place + 0.36), (4, 2), textcoords="offset points",
                      fontsize=9, va="bottom")  # fmt: skip
    axes.set_yticks(range(len(_METHODS)), [_WORDS[method] for method in _METHODS], color=INK)
    axes.set_xscale("log")
    axes.set_xticks([0.03, 0.1, 0.3, 1, 3, 10], ["0.03", "0.1", "0.3", "1", "3", "10"])
    axes.minorticks_off()
    axes.set_ylim(-0.5, 2.8)
    axes.set_xlabel("error of the planar centre of mass [mm]")
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    axes.tick_params(length=0)
    return figure


def draw_balance() -> Figure:
    """Share of runs that balanced, against the error of the controller's CoM."""
    figure = new_figure(7.4, 2.7)
    axes = figure.add_subplot()
    rows = [row for row in _lines("paper.jsonl") if row["key"].startswith("balance/") and "failed" not in row]
    axes.axvspan(-5, 5, color=FAINT, alpha=0.45, linewidth=0)
    axes.annotate("the paper's 5 mm", (0, 1.04), ha="center", fontsize=9, color=MUTED, va="bottom")
    for robot, colour, dash in (
        ("unitree_a1", ORANGE, "-"),
        ("go2", BLUE, (0, (5, 2))),
        ("solo12", GREEN, (0, (1, 1.6))),
    ):
        of = [(row["case"][2], row["balanced"]) for row in rows if row["case"][0] == robot]
        errors = sorted({error for error, _ in of})
        share = [np.mean([balanced for error, balanced in of if error == one]) for one in errors]
        axes.plot(errors, share, color=colour, linestyle=dash, marker="o", markersize=3.5, label=robot)
    axes.set_xlim(-16, 16)
    axes.set_ylim(-0.05, 1.15)
    axes.set_xlabel("CoM of the controller minus true CoM, across the support line [mm]")
    axes.set_ylabel("stood for 10 s")
    axes.set_yticks([0, 0.5, 1], ["none", "half", "all"])
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
