"""Lift trials as a search asks for them: where, how high, whether they are safe, and who is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import ImuMountingError, ReachError, SettingsError
from equipoise.estimation.paper import commanded_plane
from equipoise.estimation.tilt import Verdict
from equipoise.experiments.lift import LiftSettings, LiftTrial, grown, lift_trial
from equipoise.experiments.planted import PlantedRobot
from equipoise.recordings.recording import Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import DIAGONALS
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]

# Sizes that were tried on an A1 and scale with the hip height (lengths) or its square root (times).
_REFERENCE_HEIGHT = 0.312
_BOUND = 0.06
# A robot that tips onto its lifted feet must come to rest on them: its CoM must be this much farther inside its feet than
# the speed that it has by then would carry it.
_TIP_OVER_FACTOR = 1.5
_LIFT_RATIO = 0.05


@dataclass(frozen=True)
class ComSearchSettings:
    """How the CoM is searched. None stands for a value that fits the robot's size.

    Attributes:
        lower, upper: search bounds x_l and x_u of the offset along the base's x axis [m]; default -+ 6 cm on an A1.
        tolerance: the search ends when the bounds are this close [m].
        lift_height: of the first lift [m]; default 5 % of the hip height.
        t_thres: how long the robot is watched with two feet up [s]; default 0.8 s on an A1.
        speed: factor on how fast the robot moves between trials.
    """

    lower: float | None = None
    upper: float | None = None
    tolerance: float = 0.005
    lift_height: float | None = None
    t_thres: float | None = None
    speed: float = 1.0

    def __post_init__(self) -> None:
        lower, upper = self.lower, self.upper
        if lower is not None and upper is not None and not upper > lower:
            raise SettingsError(
                f"the search bounds are the wrong way round: upper {upper} m is not above lower {lower} m"
            )
        for name in ("tolerance", "lift_height", "t_thres", "speed"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise SettingsError(f"{name} is {value}; it must be positive")

    def bounds(self, stance: Stance) -> tuple[float, float]:
        """x_l and x_u for a robot of this size [m]."""
        default = _BOUND * stance.hip_height / _REFERENCE_HEIGHT
        lower = -default if self.lower is None else self.lower
        upper = default if self.upper is None else self.upper
        if not upper > lower:
            raise SettingsError(
                f"the search bounds are the wrong way round: upper {upper} m is not above lower {lower} m"
            )
        return lower, upper

    def lift(self, stance: Stance) -> LiftSettings:
        """The lift trial for a robot of this size."""
        clock = float(np.sqrt(stance.hip_height / _REFERENCE_HEIGHT))
        usual = LiftSettings(height=0.0)
        return LiftSettings(
            height=self.lift_height or _LIFT_RATIO * stance.hip_height,
            move_time=usual.move_time * clock / self.speed,
            settle_time=usual.settle_time * clock / self.speed,
            rest_time=usual.rest_time * clock,
            unload_time=usual.unload_time * clock,
            lift_time=usual.lift_time * clock,
            watch_time=self.t_thres or usual.watch_time * clock,
            lower_time=usual.lower_time * clock / self.speed,
            step_time=usual.step_time * clock,
        )


@dataclass(frozen=True)
class SearchProgress:
    """What a search is doing: the trial about to be done, and the bracket."""

    diagonal: str
    offset: float
    lower: float
    upper: float
    trials_done: int
    trials_expected: int


Report = Callable[[SearchProgress], None]
Keep = Callable[[Recording], None]


class TrialRunner:
    """Does lift trials for a search: inverse kinematics, motion, and higher lifts where no tilt is seen."""

    def __init__(
        self, planted: PlantedRobot, stance: Stance, settings: ComSearchSettings, keep: Keep, report: Report | None
    ) -> None:
        self.planted, self.stance, self.settings = planted, stance, settings
        self.lift = settings.lift(stance)
        self._keep, self._report = keep, report

    def tilt_at(self, diagonal: str, x_m: float, x_l: float, x_u: float, trials: list[LiftTrial]) -> Verdict:
        """Stand on a diagonal whose line is offset by x_m, lift the other feet, and tell which way the robot tips.

        Where no tilt is seen the lift is repeated higher, and later trials lift as high as it took to see one. If the
        highest shows none either, the robot is balanced.

        Args:
            diagonal: to stand on.
            x_m: offset of the support lines [m].
            x_l, x_u: the bracket that it lies in, for the progress report [m].
            trials: to append to.
        """
        if self._report is not None:
            left = max(0, int(np.ceil(np.log2(max(1.0, (x_u - x_l) / self.settings.tolerance)))))
            self._report(SearchProgress(diagonal, x_m, x_l, x_u, len(trials), len(trials) + max(1, left)))
        r_hat = shifted_feet(self.stance, x_m)  # Algorithm 1, lines 3 and 4
        lift = self.lift
        for _ in range(lift.max_lifts):
            trial = lift_trial(self.planted, diagonal, x_m, r_hat, lift)  # lines 5 to 12
            trials.append(trial)
            self._keep(trial.recording)
            _check_direction(trial)
            if trial.tilt.verdict != "balanced":
                self.lift = lift
                break
            lift = grown(lift)
        return trials[-1].tilt.verdict

    def check_reach(self, x_m: float) -> None:
        """Raise ReachError if the legs do not reach an offset, or the robot could tip over its own four feet there.

        By the model: a CoM at a distance d from the line falls through an angle a (the lift over the lifted foot's
        distance) and gains the speed sqrt(2 g d a), with which an inverted pendulum of height h travels up to
        sqrt(2 h d a) against gravity. There must be room for that between the CoM and the feet's front or rear edge.
        """
        robot, stance = self.planted.robot, self.stance
        feet = shifted_feet(stance, x_m)
        inverse_kinematics(robot, feet, stance.joint_position)
        com = composite_parameters(robot, stance.joint_position).com
        room = min(float(feet[:, 0].max() - com[0]), float(com[0] - feet[:, 0].min()))
        height = float(com[2] - feet[:, 2].mean())
        for diagonal in DIAGONALS:
            plane = commanded_plane(feet, diagonal)
            arm = max(abs(plane.distance_to(foot)) for foot in feet)
            travel = float(np.sqrt(2 * height * abs(plane.distance_to(com)) * self.lift.height / arm))
            if room < _TIP_OVER_FACTOR * travel:
                raise ReachError(
                    f"with the support lines at {x_m * 1000:.0f} mm the robot could tip over its own feet: by the model its "
                    f"centre of mass is {room * 1000:.0f} mm inside them, and {_TIP_OVER_FACTOR * travel * 1000:.0f} mm are "
                    "safe; ask for narrower bounds"
                )


def shifted_feet(stance: Stance, offset: float) -> FloatArray:
    """(4, 3) feet in the base frame with the support lines shifted along x (Algorithm 1, lines 3 and 4) [m]."""
    return stance.feet_in_base + np.array([offset, 0, 0])


def _check_direction(trial: LiftTrial) -> None:
    """A robot on a line can only turn about that line; an IMU that says otherwise is mounted turned."""
    tilt = trial.tilt
    if tilt.across_line > 2 * abs(tilt.about_line) and tilt.across_line > 0.04:
        raise ImuMountingError(
            f"the robot stood on {trial.diagonal} and turned across that line by {np.degrees(tilt.across_line):.1f} deg: "
            "the IMU seems mounted turned; give its pose under imu_rpy in a robot description",
            (trial.recording,),
        )
