"""The routine: experiments on a robot, estimates from their recordings, and the two joined."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from equipoise.calibration.settings import CalibrationSettings
from equipoise.experiments.progress import Progress
from equipoise.experiments.stand import move_to, stand_up
from equipoise.paper import method as paper
from equipoise.platform.platform import Platform
from equipoise.precise import method as precise
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.static import method as static

__all__ = ["CalibrationSettings", "Progress", "calibrate", "check", "estimate"]

_RUN = {"precise": precise.run, "paper": paper.run, "static": static.run}
_ESTIMATE = {"precise": precise.estimate, "paper": paper.estimate, "static": static.estimate}


def calibrate(
    platform: Platform,
    robot: RobotModel,
    settings: CalibrationSettings | None = None,
    keep: Callable[[Recording], None] | None = None,
    report: Callable[[Progress], None] | None = None,
) -> Calibration:
    """Run a calibration on a robot and estimate from what it felt.

    The robot may stand or lie when it begins; it ends where it began.

    Args:
        platform: the robot, real or simulated.
        robot: what is known about it.
        settings: what to do; default: the precise method.
        keep: called with every recording as soon as it is complete, and with the last, broken one if the routine ends early.
        report: called before every trial.

    Raises:
        MotionError: the robot could not do, or did not do, what was asked.
    """
    settings = settings or CalibrationSettings()
    stance = nominal_stance(robot)
    recordings: list[Recording] = []

    def store(recording: Recording) -> None:
        recordings.append(recording)
        if keep is not None:
            keep(recording)

    _check(robot, stance, settings)
    planted, feet_at_end = stand_up(platform, robot, stance)
    planted.keep = store
    try:
        _RUN[settings.method](planted, stance, settings, recordings, report)
        move_to(planted, feet_at_end)
    except BaseException:
        unfinished = planted.take()
        if unfinished is not None and keep is not None:
            keep(unfinished.broken_off())
        raise
    return _ESTIMATE[settings.method](robot, recordings, settings, stance)


def check(robot: RobotModel, settings: CalibrationSettings) -> None:
    """Refuse settings that do not fit a robot, before anything moves; `calibrate` begins with this.

    Raises:
        SettingsError: a setting does not fit the robot's size.
        ReachError: a posture is out of reach or not safe.
    """
    _check(robot, nominal_stance(robot), settings)


def _check(robot: RobotModel, stance: Stance, settings: CalibrationSettings) -> None:
    if settings.method == "paper":
        paper.check(robot, stance, settings)
    elif settings.method == "precise":
        precise.check(robot, stance, settings)


def estimate(
    robot: RobotModel, recordings: Sequence[Recording], settings: CalibrationSettings | None = None
) -> Calibration:
    """What the recordings of a calibration say. Moves nothing and needs no platform.

    Args:
        robot: what is known about the robot that was recorded.
        recordings: those of one run, in order; broken ones (of an interrupted trial) are passed over.
        settings: those of the run.

    Raises:
        RecordingError: they do not hold what the method needs.
    """
    settings = settings or CalibrationSettings()
    return _ESTIMATE[settings.method](robot, recordings, settings, nominal_stance(robot))
