"""Step 1 of the paper: the planar centre of mass by bisection (Algorithms 1 and 2).

The support line is moved by moving the body over planted feet: that puts the feet where the algorithm wants them in the
base frame without dragging them over the floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.errors import SettingsError
from equipoise.experiments.lift import LiftTrial
from equipoise.paper.bracket import check_end
from equipoise.paper.trial_runner import TrialRunner, check_search
from equipoise.robot.model import DIAGONALS


@dataclass(frozen=True, eq=False)
class SupportVector:
    """Where one diagonal's search ended.

    Attributes:
        diagonal: "FL_RR" or "FR_RL".
        lower, upper: the last bounds x_l and x_u [m]; equal if the robot stayed balanced there.
        trials: in the order they were done.
    """

    diagonal: str
    lower: float
    upper: float
    trials: tuple[LiftTrial, ...]

    @property
    def offset(self) -> float:
        """x_m: the offset at which the robot balances [m]."""
        return (self.lower + self.upper) / 2


def find_com(runner: TrialRunner) -> tuple[SupportVector, SupportVector]:
    """Algorithm 2, FindCOM: one support line per diagonal. Where they cross is `estimation.paper`'s line 5."""
    x_l, x_u = runner.settings.bounds(runner.stance)  # Algorithm 2, line 1
    check_search(runner.planted.robot, runner.stance, runner.settings)
    first = find_support_vector(runner, "FL_RR", x_u, x_l)  # line 3
    second = find_support_vector(runner, "FR_RL", x_u, x_l)  # line 4
    return first, second


def find_support_vector(runner: TrialRunner, diagonal: str, x_u: float, x_l: float) -> SupportVector:
    """Algorithm 1, FindSupportVector: the offset of one diagonal's support line that balances the robot.

    Line numbers are the paper's. Lines 3 to 12 are one call here: `TrialRunner.tilt_at` shifts the feet (3, 4), and
    `lift_trial` solves the inverse kinematics (5), moves until q is close to q_d (6-8), lifts the other diagonal's feet and
    waits for t_thres (9-12).

    Raises:
        BracketError: the robot tips the same way at both ends, also after widening once.
        ImuMountingError: at both ends it tips away from where its CoM must be.
        TrackingError: it did not come to rest where it was sent.
    """
    if diagonal not in DIAGONALS:
        raise SettingsError(f"no diagonal is called {diagonal!r}; they are {', '.join(DIAGONALS)}")
    if not x_u > x_l:
        raise SettingsError(f"the search bounds are the wrong way round: upper {x_u} m is not above lower {x_l} m")
    trials: list[LiftTrial] = []
    first_l, first_u = x_l, x_u
    while x_u - x_l > runner.settings.tolerance:  # line 1
        x_m = (x_l + x_u) / 2  # line 2
        tilt = runner.tilt_at(diagonal, x_m, x_l, x_u, trials)  # lines 3 to 12
        if tilt == "balanced":
            return SupportVector(diagonal, x_m, x_m, tuple(trials))
        if tilt == "forward":  # line 13: the CoM is ahead of the line
            x_l = x_m  # line 14
        else:
            x_u = x_m  # line 16
        if x_u - x_l <= runner.settings.tolerance and (first_l == x_l or first_u == x_u):
            x_l, x_u = check_end(runner, diagonal, x_l, x_u, first_l, first_u, trials)
            first_l, first_u = -np.inf, np.inf  # an end is tried, and the bracket widened, once
    return SupportVector(diagonal, x_l, x_u, tuple(trials))  # line 19
