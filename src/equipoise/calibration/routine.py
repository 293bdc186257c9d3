"""Calibration routine: experiments on a robot, estimates from their recordings, and both together."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from equipoise.bayesian.method import BayesianMethod
from equipoise.errors import SettingsError
from equipoise.experiments.progress import Progress
from equipoise.experiments.response import check_base, check_joints
from equipoise.experiments.response_test import ResponseTest
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard.report import GuardReport
from equipoise.json_form import to_json
from equipoise.method.method import Method
from equipoise.platform.platform import Platform
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.result.findings import Check
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_BAD_SAMPLES = 0.01  # largest fraction of the samples


def calibrate(
    platform: Platform,
    robot: RobotModel,
    method: Method | None = None,
    keep: Callable[[Recording], None] | None = None,
    report: Callable[[Progress], None] | None = None,
    operator_done: Callable[[], bool] | None = None,
    confirm: Callable[[str], bool] | None = None,
    on_response: Callable[[ResponseTest], None] | None = None,
) -> Calibration:
    """Run a calibration on a robot and estimate its parameters from the recordings.

    The robot may stand or lie initially, and returns to that posture at the end.

    Args:
        platform: robot, real or simulated.
        robot: model of the robot.
        method: method with its settings; default: `BayesianMethod()`.
        keep: function that gets every recording as soon as it is complete, and the incomplete last one if the routine
            ends early.
        report: function that is called before every trial, and before the estimate.
        operator_done: function that returns True once the operator has confirmed a request, such as turning the robot;
            it must not wait. None without an operator.
        confirm: function that asks the operator a question while the robot stands, and returns True for yes. It is
            called if a given mass disagrees with the joint torques, or a measured orientation of the IMU with the
            model's. None without an operator; both cases then raise.
        on_response: function that gets the result of the response test, before the first trial. None: no response test,
            as in simulation.

    Raises:
        SettingsError: the given mass disagrees with the joint torques of the standing robot, and is not confirmed.
        MotionError: joints or gyroscope do not respond as the model predicts (no foot was lifted), or a motion failed.
    """
    method = method or BayesianMethod()
    experiment = perform(platform, robot, method, keep, report, operator_done, confirm, on_response)
    return experiment.estimate(method, report)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Completed experiment.

    Attributes:
        robot: model of the robot, with the orientation of the IMU that is used.
        recordings: recordings in order.
        facts: facts for the result's provenance.
    """

    robot: RobotModel
    recordings: list[Recording]
    facts: dict[str, Any]

    def estimate(self, method: Method, report: Callable[[Progress], None] | None = None) -> Calibration:
        """Estimate the parameters from the recordings, without the robot."""
        if report is not None:
            report(Progress("estimating", len(self.recordings), len(self.recordings) + 1))
        return method.estimate(self.robot, self.recordings, nominal_stance(self.robot)).with_provenance(**self.facts)


def perform(
    platform: Platform,
    robot: RobotModel,
    method: Method,
    keep: Callable[[Recording], None] | None = None,
    report: Callable[[Progress], None] | None = None,
    operator_done: Callable[[], bool] | None = None,
    confirm: Callable[[str], bool] | None = None,
    on_response: Callable[[ResponseTest], None] | None = None,
) -> Experiment:
    """Run the experiments of a calibration. Arguments and errors are those of `calibrate`."""
    stance = nominal_stance(robot)
    recordings: list[Recording] = []

    def store(recording: Recording) -> None:
        recordings.append(recording)
        if keep is not None:
            keep(recording)

    method.check(robot, stance)
    joints = 0 if on_response is None else check_joints(platform, robot, stance)
    standing, feet_at_end = stand_up(platform, robot, stance)
    standing.keep, standing.operator_done = store, operator_done
    facts: dict[str, Any] = {}
    try:
        if on_response is not None:
            response = check_base(standing, stance, joints, confirm)
            robot = standing.robot  # methods replace it by models with other masses later
            on_response(response)
            facts["response_test"] = to_json(response)
        _confirm_mass(method.compare_mass(standing, stance), confirm)
        method.run(standing, stance, recordings, report)
        move_to(standing, feet_at_end)
    except BaseException:
        unfinished = standing.take()
        if unfinished is not None and keep is not None:
            keep(unfinished.broken_off())
        raise
    return Experiment(robot, recordings, facts)


def with_guard_report(result: Calibration, report: GuardReport) -> Calibration:
    """Return a result with the guard's report, and a check of the received samples."""
    counts = report.samples
    bad = counts.rejected + counts.repeated + counts.out_of_order
    share = bad / max(counts.fresh + bad, 1)
    message = (
        f"{bad} of {counts.fresh + bad} samples ({share:.1%}) were rejected: {counts.rejected} with a wrong checksum, length "
        f"or sender, {counts.repeated} repeated, {counts.out_of_order} out of order"
    )
    if report.unchecked:
        message += "; checksums were not checked, as set for the platform"
    if share > _BAD_SAMPLES:
        message += f". The limit is {_BAD_SAMPLES:.0%}: check the cable, and other senders to this computer"
    checks = sorted([*result.checks, Check("samples", share <= _BAD_SAMPLES, message)], key=lambda check: check.passed)
    return dataclasses.replace(result, checks=tuple(checks)).with_provenance(guard=to_json(report))


def _confirm_mass(doubt: MassComparison | None, confirm: Callable[[str], bool] | None) -> None:
    question = "Mass in doubt: {}. Mass and inertia scale with the given mass. Is it correct?"
    if doubt is not None and not (confirm is not None and confirm(question.format(doubt.message))):
        raise SettingsError(
            f"{doubt.message}; no foot was lifted. Weigh the robot again, or omit the mass; if the mass is "
            "correct (torque constants may be this wrong), confirm it: --confirm-mass (in Python confirm_mass=True)",
            details={"mass_comparison": to_json(doubt)},
        )


def check(robot: RobotModel, method: Method) -> None:
    """Check the settings of a method against a robot, as `calibrate` does first.

    Raises:
        SettingsError: a setting does not suit the robot.
        ReachError: a posture is out of reach or not safe.
    """
    method.check(robot, nominal_stance(robot))


def estimate(robot: RobotModel, recordings: Sequence[Recording], method: Method | None = None) -> Calibration:
    """Estimate the parameters from the recordings of a calibration, without a platform.

    Args:
        robot: model of the recorded robot.
        recordings: recordings of one run, in order; incomplete ones (of an interrupted trial) are ignored.
        method: method of the run; default: `BayesianMethod()`.

    Raises:
        RecordingError: the recordings are not sufficient.
    """
    method = method or BayesianMethod()
    return method.estimate(robot, recordings, nominal_stance(robot))
