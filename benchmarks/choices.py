"""Table of the page `accuracy`: standard deviation against robot time, for choices of motions that could be the default."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import product
from unittest import mock

import numpy as np
from rows import Row, Table
from simulated import SCALE_ERROR, cases_of, judged, loaded, robot_called
from tables import column, coverage, figures, markdown, relative, rms

from equipoise import BayesianMethod, Method, calibrate
from equipoise.bayesian import lift_design
from equipoise.bayesian.planning.nominal import nominal_candidates
from equipoise.method.combined import CombinedMethod
from equipoise.motors.method import Motors
from equipoise.user_cache import VARIABLE

SEEDS = 2
DURATIONS = (60, 90, 120, 180)  # [s], without the swings of the legs in the air
GOAL, GOAL_TIME = (3.8, 2.0, 1.7), 120  # [%] standard deviations of Ixx, Iyy, Izz at a duration [s]
METHODS: dict[str, Method] = {
    "default": BayesianMethod(),
    "no excitation, more lifts": BayesianMethod(excitation=False),
    "turned halfway": BayesianMethod(rotate_halfway=True),
    "lifted feet swing": BayesianMethod(swings=True),
    "lifted feet swing, then all legs in the air": CombinedMethod(BayesianMethod(swings=True), Motors()),
}


DESIGNS: dict[str, Sequence[tuple[object, str, object]]] = {
    "support line 3 mm from the CoM": [(lift_design, "_OFFSET", 0.003)],
    "support line 10 mm from the CoM": [(lift_design, "_OFFSET", 0.010)],
    "windows to 0.10 rad or 0.45 s": [(lift_design, "_TILT_LIMIT", 0.10), (lift_design, "_WATCH_TIME", 0.45)],
}
CHOICES = (*METHODS, *DESIGNS)


@contextmanager
def designed(choice: str) -> Generator[None]:
    """Change the design of lifts; plans are neither taken from the cache nor kept in it."""
    with ExitStack() as changed:
        changed.enter_context(mock.patch.dict(os.environ, {VARIABLE: ""}))
        for change in DESIGNS.get(choice, ()):
            changed.enter_context(mock.patch.object(*change))
        changed.callback(nominal_candidates.cache_clear)
        nominal_candidates.cache_clear()
        yield


def run(choice: str, duration: int, seed: int) -> Row:
    """Return the row of a calibration of an A1 in `stress`."""
    robot = robot_called("unitree_a1")
    simulation, mass = loaded(robot, "stress", seed)
    method = (
        METHODS.get(choice, BayesianMethod()).having({"duration": float(duration)}).weighed(mass, SCALE_ERROR * mass)
    )
    with designed(choice), simulation:
        result = calibrate(simulation.platform, robot, method)
        return judged(result.with_truth(simulation.truth))


def show(rows: list[Row]) -> Iterator[str]:
    yield "## Standard deviation against robot time"
    yield ""
    yield (
        f"An A1 in `stress`, {SEEDS} runs of each line with the same payloads. Posterior standard deviations, root mean "
        "square. The default's lifts: support line 6 mm from the CoM, windows to 0.06 rad or 0.35 s. Target: "
        f"Ixx, Iyy, Izz {figures(GOAL)} % at {GOAL_TIME} s."
    )
    yield ""
    lines: list[list[str]] = []
    for choice, duration in product(CHOICES, DURATIONS):
        of = [row for row in rows if row["case"][:2] == [choice, duration]]
        if of:
            sd, most = rms(relative(of, "sd")), np.array(GOAL if duration == GOAL_TIME else (np.inf,) * 3)
            lines.append([
                choice, f"{column(of, 'robot_time').mean():.0f}", str(len(of)), figures(sd[1:4]),
                figures(sd[4:7], most=most), coverage(of),
            ])  # fmt: skip
    head = ("choice", "robot time [s]", "n", "std of CoM x, y, z [mm]", "std of Ixx, Iyy, Izz [%]", "coverage")
    yield from markdown(head, lines)


TABLE = Table("choices", run, cases_of(dict.fromkeys(product(CHOICES, DURATIONS), SEEDS)), show)
