"""The routine: experiments on a robot, estimates from their recordings, and the two joined."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from equipoise.errors import UnconfirmedMassError
from equipoise.experiments.progress import Progress
from equipoise.experiments.stand import move_to, stand_up
from equipoise.method.method import Method
from equipoise.platform.platform import Platform
from equipoise.precise.method import Precise
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance


def calibrate(
    platform: Platform,
    robot: RobotModel,
    method: Method | None = None,
    keep: Callable[[Recording], None] | None = None,
    report: Callable[[Progress], None] | None = None,
    told: Callable[[], bool] | None = None,
    confirm: Callable[[str], bool] | None = None,
) -> Calibration:
    """Run a calibration on a robot and estimate from what it felt.

    The robot may stand or lie when it begins; it ends where it began.

    Args:
        platform: robot, real or simulated.
        robot: model of the robot.
        method: method with its settings; default: `Precise()`.
        keep: function that gets every recording as soon as it is complete, and the last, broken one if the routine ends
            early.
        report: function that is called before every trial, and before the estimate.
        told: function that says whether somebody at the robot has said that what was asked is done, as turning it; it must not
            wait. None: nobody is there.
        confirm: function that asks the operator to confirm a given mass, from a sentence with both masses, while the robot
            stands. None: there is no operator, and such a mass raises.

    Raises:
        UnconfirmedMassError: the given mass disagrees with the joint torques of the standing robot, and is not confirmed.
        MotionError: the robot could not do, or did not do, what was asked.
    """
    method = method or Precise()
    stance = nominal_stance(robot)
    recordings: list[Recording] = []

    def store(recording: Recording) -> None:
        recordings.append(recording)
        if keep is not None:
            keep(recording)

    method.check(robot, stance)
    planted, feet_at_end = stand_up(platform, robot, stance)
    planted.keep, planted.told = store, told
    try:
        _confirm_mass(method.mass_in_doubt(planted, stance), confirm)
        method.run(planted, stance, recordings, report)
        move_to(planted, feet_at_end)
    except BaseException:
        unfinished = planted.take()
        if unfinished is not None and keep is not None:
            keep(unfinished.broken_off())
        raise
    if report is not None:
        report(Progress("estimating", len(recordings), len(recordings) + 1))
    return method.estimate(robot, recordings, stance)


def _confirm_mass(doubt: MassComparison | None, confirm: Callable[[str], bool] | None) -> None:
    if doubt is not None and not (confirm is not None and confirm(doubt.sentence)):
        raise UnconfirmedMassError(
            f"{doubt.sentence}; no foot was lifted. Weigh the robot again, or give no mass; if the mass is "
            "right (torque constants may be off by so much), confirm it: --confirm-mass (in Python confirm_mass=True)",
            doubt,
            {"mass_comparison": doubt.to_dict()},
        )


def check(robot: RobotModel, method: Method) -> None:
    """Refuse settings that do not fit a robot, before anything moves; `calibrate` begins with this.

    Raises:
        SettingsError: a setting does not fit the robot's size.
        ReachError: a posture is out of reach or not safe.
    """
    method.check(robot, nominal_stance(robot))


def estimate(robot: RobotModel, recordings: Sequence[Recording], method: Method | None = None) -> Calibration:
    """What the recordings of a calibration say. Moves nothing and needs no platform.

    Args:
        robot: model of the robot that was recorded.
        recordings: recordings of one run, in order; broken ones (of an interrupted trial) are passed over.
        method: method of the run; default: `Precise()`.

    Raises:
        RecordingError: they do not hold what the method needs.
    """
    method = method or Precise()
    return method.estimate(robot, recordings, nominal_stance(robot))
