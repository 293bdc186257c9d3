"""Accuracy of calibrations and coverage of their intervals: `make bench-accuracy`. Writes benchmarks/results/accuracy.md.

Simulated robots carry payloads drawn from the seed and are weighed. They are calibrated with the Bayesian method in three
presets; the same recordings are estimated with other settings. Other durations and methods run on an A1.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from rows import Case, Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import choices
import numpy as np
from scipy.stats import binom, ttest_1samp
from simulated import FIRST_SEED, SCALE_ERROR, cases_of, judged, loaded, robot_called
from tables import column, coverage_with_interval, failed_checks, figures, markdown, relative, rms

from equipoise import BayesianMethod, Calibration, Method, PaperMethod, Recording, calibrate, estimate
from equipoise.lab.static.method import Static

OTHERS = ("go2", "anymal_c", "solo12", "b1")
SEEDS = {"stress": 16, "realistic": 16, "ideal": 2}  # of each other robot
METHODS: dict[str, Method] = {
    "bayesian": BayesianMethod(),
    "bayesian, rotated halfway": BayesianMethod(rotate_halfway=True),
    "bayesian, 60 s": BayesianMethod(duration=60.0),
    "paper": PaperMethod(),
    "static": Static(),
}
COUNTS: dict[Case, int] = {  # robot, preset, method
    ("unitree_a1", "stress", "bayesian"): 80,
    ("unitree_a1", "stress", "bayesian, rotated halfway"): 24,
    ("unitree_a1", "realistic", "bayesian"): 80,
    **{("unitree_a1", "realistic", method): 40 for method in ("bayesian, 60 s", "paper", "static")},
    ("unitree_a1", "ideal", "bayesian"): 4,
    **{(robot, preset, "bayesian"): n for robot in OTHERS for preset, n in SEEDS.items()},
}
NARROW = "no cable, narrow leg priors"
VARIANTS: dict[str, dict[str, Any]] = {  # settings with which the recordings of `bayesian` are estimated too
    "no scale": {"mass": None, "mass_std": None, "confirm_mass": False},
    "no cable": {"cable": "none"},
    NARROW: {"cable": "none", "leg_prior": "narrow"},
}
VARIED = {"stress": ("no scale", NARROW), "realistic": tuple(VARIANTS), "ideal": ("no scale",)}
JUDGED = ("error", "sd", "holds", "alarms")
# CoM x, y, z [mm] on an A1, in proportion to the leg length on others; Ixx, Iyy, Izz [%].
TARGETS = {
    ("stress", "bayesian"): (0.75, 0.6, 2.0, 5, 3, 4),
    ("stress", "bayesian, rotated halfway"): (0.5, 0.4, 2.0, 5, 3, 4),
    ("realistic", "bayesian, no cable"): (0.30, 0.25, 1.5, 3, 2, 2),
    ("realistic", f"bayesian, {NARROW}"): (0.22, 0.20, 0.45, 1.2, 0.8, 1.2),
}
A1_LEG = 0.4  # [m]
LEAST, UNLIKELY = 0.90, 0.003  # least coverage; probability of a mean that is taken to differ from zero

Line = tuple[str, str, str, list[Row]]
"""Robot, preset, label and rows of a table's line."""


def run(name: str, preset: str, method: str, seed: int) -> Row:
    """Return the row of a calibration, with those of other settings."""
    robot, recordings = robot_called(name), list[Recording]()
    simulation, mass = loaded(robot, preset, seed)
    settings = METHODS[method].weighed(mass, SCALE_ERROR * mass)
    with simulation:
        truth = simulation.truth
        result = calibrate(simulation.platform, robot, settings, recordings.append).with_truth(truth)
    row = judged(result) | {"leg_length": robot.leg_length}
    if method == "paper":
        row["error"][4:7] = excitation_errors(result)
    if isinstance(settings, BayesianMethod) and method == "bayesian":
        row["variants"] = {}
        for label in VARIED[preset]:
            other = judged(estimate(robot, recordings, replace(settings, **VARIANTS[label])).with_truth(truth))
            row["variants"][label] = {key: other[key] for key in JUDGED}
    return row


def excitation_errors(result: Calibration) -> list[float | None]:
    """Return the errors of the moments of inertia of the paper's method, against those of the whole robot [kg m2]."""
    true = dict(zip(("roll", "pitch", "yaw"), [quantity.truth for quantity in result.composite][4:7], strict=True))
    found = {axis: excitation.moment for axis, excitation in result.excitations.items()}
    return [None if found.get(axis) is None else float(found[axis] - true[axis]) for axis in true]


def lines_of(rows: list[Row]) -> Iterator[Line]:
    """Yield the lines of both tables, in the order of the groups."""
    for group in COUNTS:
        of = [row for row in rows if tuple(row["case"][:3]) == group]
        if of:
            yield *group, of
            for label in of[0].get("variants", {}):
                yield *group[:2], f"bayesian, {label}", [row | row["variants"][label] for row in of]
            if group[2] == "bayesian":
                yield *group[:2], "model file", [row | {"error": row["file_error"]} for row in of]


def show(rows: list[Row]) -> Iterator[str]:
    units = "mass [%]", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "Ixy, Ixz, Iyz [% of Ixx]"
    yield from markdown(("robot", "preset", "method", "n", *units, "robot time [s]"), _accuracy_lines(rows))
    yield ""
    yield "## Coverage of the 95 % intervals of `bayesian`"
    yield ""
    yield (
        "Share of runs whose interval contains the truth, for each parameter; all runs count. Bold: significantly below "
        f"{LEAST:.0%}. *All*: share of all intervals, with its 95 % interval; if all contain the truth, each run counts once, "
        "because values of a run correlate. *Mean*: mean of error / std; bold: not zero (t-test, p below "
        f"{UNLIKELY:.1%})."
    )
    yield ""
    of = "mass", "CoM x, y, z", "Ixx, Iyy, Izz", "Ixy, Ixz, Iyz", "all"
    mean = "mean of mass; CoM x, y, z; Ixx, Iyy, Izz"
    head = ("robot", "preset", "method", "n", *of, "error / std, rms", mean, "runs with a failed check")
    yield from markdown(head, _coverage_lines(rows))


def _accuracy_lines(rows: list[Row]) -> Iterator[list[Any]]:
    for robot, preset, label, of in lines_of(rows):
        target = np.array(TARGETS.get((preset, label), (np.inf,) * 6), dtype=float)
        target[:3] *= of[0]["leg_length"] / A1_LEG
        found = rms(relative(of))
        time = "" if label == "model file" else f"{column(of, 'robot_time').mean():.0f}"
        yield [
            robot, preset, label, len(of), figures(found[:1]), figures(found[1:4], most=target[:3]),
            figures(found[4:7], most=target[3:]), figures(found[7:]), time,
        ]  # fmt: skip
        if np.isfinite(target[0]):
            yield [robot, preset, "*target*", "", "", f"*{figures(target[:3])}*", f"*{figures(target[3:])}*", "", ""]


def _coverage_lines(rows: list[Row]) -> Iterable[list[Any]]:
    for robot, preset, label, of in lines_of(rows):
        if "sd" in of[0] and label != "model file":
            least = binom.ppf(0.025, len(of), LEAST) / len(of)
            shares = np.mean([row["holds"] for row in of], axis=0)
            cells = [f"{share:.0%}" if share >= least else f"**{share:.0%}**" for share in shares]
            ratios = column(of, "error") / column(of, "sd")
            yield [
                robot, preset, label, len(of), cells[0], *(" ".join(cells[at : at + 3]) for at in (1, 4, 7)),
                coverage_with_interval(of), f"{rms(ratios.ravel()):.2f}", _means(ratios[:, :7]), failed_checks(of),
            ]  # fmt: skip


def _means(ratios: np.ndarray) -> str:
    """Return the means of (n, 7) errors over their standard deviations, in bold if they differ from zero."""
    means = ratios.mean(axis=0)
    unlikely = ttest_1samp(ratios, 0.0).pvalue < UNLIKELY if len(ratios) > 1 else np.zeros(len(means), dtype=bool)
    cells = [f"**{mean:+.1f}**" if bold else f"{mean:+.1f}" for mean, bold in zip(means, unlikely, strict=True)]
    return "; ".join(" ".join(part) for part in (cells[:1], cells[1:4], cells[4:]))


PAGE = Page(
    "accuracy",
    f"""# Accuracy

`make bench-accuracy`; seeds from {FIRST_SEED:,} on, not used in development. Root mean square errors of the whole robot at
the nominal stance, estimate minus truth. Payloads of 5 to 30 % of the base's mass are drawn from the seed. The mass is from
a scale with an error of {SCALE_ERROR:.1%} unless stated; `bayesian` takes 120 s on an A1, more on larger robots. A seed
draws the same share of payload and the same error of the scale for every robot. Lines with *no scale*, *no cable*
(estimated without a cable force) and *narrow leg priors* (the file's legs, with link masses right within 3 %) are estimated
from the recordings of `bayesian`; the other lines have runs of their own. *Model file*: errors of
the file, which lacks the payload. The moments of `paper` are compared with the whole robot's. A *target* is that of the line
above it. Bold: target missed. With perfect sensors (`ideal`), all intervals should contain the truth, and no check should
fail.""",
    (Table("runs", run, cases_of(COUNTS), show), choices.TABLE),
)

if __name__ == "__main__":
    main(PAGE)
