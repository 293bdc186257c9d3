"""Lift trials as a search asks for them: where, how high, whether they are safe, and who is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, ReachError, SettingsError
from equipoise.experiments.lift import LiftSettings
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.posture import check_clear
from equipoise.experiments.tipping import Pendulum
from equipoise.paper.bracket import Bracket, TriedOffset
from equipoise.paper.lift_trial import LiftReading, lift_trial, read_lift_trial
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance

_BOUND = 0.06  # [m] on an A1
# Of the room to the edge of its feet, that a robot at a bound may be on its way to when it lands on its lifted feet. More than
# in a lift that is planned: a search goes to its bounds only where the CoM is near them.
_LANDING = 0.8
_LIFT_RATIO = 0.05
_SMALLEST_LIFT_RATIO, _LARGEST_LIFT_RATIO = 0.01, 0.3
# What settings may be: less or more than this is a slip of the finger.
_ALLOWED = (
    ("lower", -2.0, 2.0),
    ("upper", -2.0, 2.0),
    ("tolerance", 1e-4, 1.0),
    ("lift_height", 1e-3, 1.0),
    ("t_thres", 0.2, 10.0),  # shorter, no robot tips far enough to be seen
    ("speed", 0.1, 3.0),
)


@dataclass(frozen=True)
class ComSearchSettings:
    """How the CoM is searched. None stands for a value that fits the robot's size.

    Attributes:
        lower: lower search bound x_l of the offset along the base's x axis [m]; default -6 cm on an A1.
        upper: upper search bound x_u of that [m]; default 6 cm on an A1.
        tolerance: distance of the bounds at which the search ends [m].
        lift_height: height of the first lift [m]; default 5 % of the hip height.
        t_thres: time for which the robot is watched with two feet up [s]; default 0.8 s on an A1.
        speed: factor on how fast the robot moves between trials.
    """

    lower: float | None = None
    upper: float | None = None
    tolerance: float = 0.005
    lift_height: float | None = None
    t_thres: float | None = None
    speed: float = 1.0

    def __post_init__(self) -> None:
        for name, least, most in _ALLOWED:
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise SettingsError(f"{name} is {value}; it must be from {least} to {most}")
        if self.lower is not None and self.upper is not None:
            _check_order(self.lower, self.upper)

    def bounds(self, stance: Stance) -> tuple[float, float]:
        """x_l and x_u for a robot of this size [m]; raises SettingsError if there is nothing to search between them."""
        default = _BOUND * stance.scale.length
        lower = -default if self.lower is None else self.lower
        upper = default if self.upper is None else self.upper
        _check_order(lower, upper)
        if not self.tolerance < (upper - lower) / 2:
            raise SettingsError(
                f"the tolerance of {self.tolerance} m leaves nothing to search between {lower:.4f} and {upper:.4f} m"
            )
        return lower, upper

    def halvings(self, stance: Stance) -> int:
        """How often the bracket is halved until it is as small as the tolerance: at least once, as `bounds` sees to."""
        lower, upper = self.bounds(stance)
        return int(np.ceil(np.log2((upper - lower) / self.tolerance)))

    def bracket(self, stance: Stance) -> Bracket:
        """What a search on a robot of this size begins with; raises SettingsError as `bounds` does."""
        return Bracket(*self.bounds(stance), self.tolerance, lift_heights(self.lift(stance))[-1])

    def lift(self, stance: Stance) -> LiftSettings:
        """The lift trial for a robot of this size."""
        height = self.lift_height or _LIFT_RATIO * stance.hip_height
        if not _SMALLEST_LIFT_RATIO <= height / stance.hip_height <= _LARGEST_LIFT_RATIO:
            raise SettingsError(
                f"lift_height is {height} m; for hips {stance.hip_height:.3f} m high it must be from "
                f"{_SMALLEST_LIFT_RATIO * stance.hip_height:.4f} to {_LARGEST_LIFT_RATIO * stance.hip_height:.3f} m"
            )
        usual = LiftSettings.of(stance, height)
        return replace(
            usual,
            move_time=usual.move_time / self.speed,
            settle_time=usual.settle_time / self.speed,
            watch_time=self.t_thres or usual.watch_time,
            lower_time=usual.lower_time / self.speed,
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


class TrialRunner:
    """Does lift trials for a search: inverse kinematics, motion, and higher lifts where no tilt is seen."""

    def __init__(
        self, planted: PlantedRobot, stance: Stance, settings: ComSearchSettings, report: Report | None = None
    ) -> None:
        self.planted, self.stance, self.settings = planted, stance, settings
        self.heights = lift_heights(settings.lift(stance))
        self._rung = 0
        self._report = report

    def tilt_at(self, diagonal: str, x_m: float, bracket: Bracket, lifts: list[LiftReading]) -> TriedOffset:
        """Stand on a diagonal whose line is offset by x_m, lift the other feet, and tell which way the robot tips.

        Where no tilt is seen the lift is repeated higher, and later trials lift as high as it took to see one. If the
        highest shows none either, the robot is balanced.

        Args:
            diagonal: diagonal to stand on.
            x_m: offset of the support lines along the base's x axis [m].
            bracket: bracket that the offset lies in, for the progress report.
            lifts: list to append the lifts to.

        Raises:
            MotionError: no tilt was seen because the feet hardly left the floor.
        """
        if self._report is not None:
            left = max(1, int(np.ceil(np.log2(max(1.0, bracket.width / bracket.tolerance)))))
            self._report(SearchProgress(diagonal, x_m, bracket.lower, bracket.upper, len(lifts), len(lifts) + left))
        r_hat = shifted_feet(self.stance, x_m)  # Algorithm 1, lines 3 and 4
        for rung in range(self._rung, len(self.heights)):
            settings = replace(self.settings.lift(self.stance), height=self.heights[rung])
            recording = lift_trial(self.planted, diagonal, x_m, r_hat, settings)  # lines 5 to 12
            lifts.append(read_lift_trial(self.planted.robot, recording, self.stance.joint_position))
            _check_direction(lifts[-1])
            if lifts[-1].tilt.verdict != "balanced":
                self._rung = rung
                return lifts[-1].tried
        tilt = lifts[-1].tilt
        if not tilt.lifted:
            raise MotionError(
                f"no tilt was seen on {diagonal}, but the feet rose by only {tilt.rise * 1000:.1f} mm of the "
                f"{lifts[-1].trial.lift_height * 1000:.1f} mm that they were lifted: are they held, are the gains plausible?",
                tuple(lift.recording for lift in lifts),
            )
        return lifts[-1].tried


def check_search(robot: RobotModel, stance: Stance, settings: ComSearchSettings) -> None:
    """Refuse a search that cannot be done or is not safe, before anything moves.

    Raises:
        SettingsError: bounds, tolerance or lift height do not fit the robot.
        ReachError: a bound is out of reach, or the robot could tip over its own feet there.
    """
    height = settings.lift(stance).height
    for x in settings.bounds(stance):
        check_offset(robot, stance, x, height)


def check_offset(robot: RobotModel, stance: Stance, x_m: float, lift_height: float) -> None:
    """Raise ReachError if the legs do not reach an offset, or touch there, or the robot could tip over its own feet.

    By the model, and the pendulum of `tipping`: it must come to rest well inside them when it lands on its lifted feet.

    Args:
        robot: model of the robot.
        stance: nominal stance of the robot.
        x_m: offset of the support lines along the base's x axis [m].
        lift_height: height of the lifted feet [m].
    """
    feet = shifted_feet(stance, x_m)
    position = inverse_kinematics(robot, feet, stance.joint_position)
    check_clear(robot, position)
    for diagonal in DIAGONALS:
        tipping = Pendulum.of(robot, position, np.array([0.0, 0.0, 1.0]), diagonal)
        ahead = tipping.lean > 0
        reach, room = tipping.landing(lift_height)[ahead] * tipping.height, tipping.room[ahead]
        if reach > _LANDING * room:
            raise ReachError(
                f"with the support lines at {x_m * 1000:.0f} mm and a lift of {lift_height * 1000:.0f} mm the robot could "
                f"tip over its own feet: by the model they catch it {reach * 1000:.0f} mm beside the line on {diagonal}, "
                f"and {_LANDING * room * 1000:.0f} mm are safe; ask for narrower bounds or a lower lift"
            )


def lift_heights(settings: LiftSettings) -> list[float]:
    """Heights tried one after the other until a tilt is seen [m]; the robot that stands the last is balanced."""
    return [settings.height * settings.growth**rung for rung in range(settings.max_lifts)]


def _check_order(lower: float, upper: float) -> None:
    if not upper > lower:
        raise SettingsError(f"the search bounds are the wrong way round: upper {upper} m is not above lower {lower} m")


def shifted_feet(stance: Stance, offset: float) -> FloatArray:
    """(4, 3) feet in the base frame with the support lines shifted along x (Algorithm 1, lines 3 and 4) [m]."""
    return stance.feet_in_base + np.array([offset, 0, 0])


def _check_direction(lift: LiftReading) -> None:
    """A robot on a line can only turn about that line; an IMU that says otherwise is mounted turned."""
    tilt = lift.tilt
    if tilt.across_line > 2 * abs(tilt.about_line) and tilt.across_line > 0.04:
        raise MotionError(
            f"the robot stood on {lift.trial.diagonal} and turned across that line by {np.degrees(tilt.across_line):.1f} deg: "
            "the IMU seems mounted turned; give its pose under imu_rpy in a robot description",
            (lift.recording,),
        )
