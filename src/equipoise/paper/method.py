"""`PaperMethod`: CoM by bisection, I and C by sinusoidal excitation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from equipoise.conventions import AXES, FloatArray
from equipoise.errors import RecordingError
from equipoise.experiments.excitation import why_unreachable
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tilt import SupportPlane
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course, RehearsedPosture, excitation_postures, held_posture
from equipoise.paper.bracket import done, step
from equipoise.paper.com_search import find_com
from equipoise.paper.equations import AxisFit, commanded_plane, find_intersection, fit_axis
from equipoise.paper.evidence import SearchEvidence
from equipoise.paper.excitation import excitation_axis, why_not_standing
from equipoise.paper.iterations import com_by_iteration
from equipoise.paper.lift_trial import LiftReading, read_lift_trials
from equipoise.paper.reading import SearchReading
from equipoise.paper.settings import ComSearchSettings, PaperSettings
from equipoise.paper.trial_runner import TrialRunner, check_search, lift_heights, shifted_feet
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import ExcitationTrial, LiftTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, ExcitationEstimate, SupportLine, Trial, model_facts
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import carried_mass

# Heavier payloads, as a fraction of the robot's mass, cause errors of several millimetres. Joint friction alone causes
# mismatches of up to half as much on a `realistic` robot.
_MASS_MISMATCH = 0.15
_LIFT_TIME = 4.6  # [s] of one trial of the search, on an A1
_EXCITATIONS_TIME = 17.0  # [s] of the three excitations, on an A1


@dataclass(frozen=True)
class PaperMethod(PaperSettings, Method):
    """CoM by bisection (Algorithms 1 and 2), then I and C by excitations (equations 2 to 5).

    Its settings are those of `PaperSettings`.
    """

    name: ClassVar[str] = "paper"
    estimates: ClassVar[tuple[str, ...]] = ("com_x", "com_y")
    # Twice the default step changes the estimates by less than a tenth of their errors (`make bench-speed`). A longer
    # step would make contacts softer.
    timestep: ClassVar[float] = 1e-3

    def check(self, robot: RobotModel, stance: Stance) -> None:
        check_search(robot, stance, self.com_search)
        self.excitation.duration_for(stance)

    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Do step 1, the search, and step 2, the excitations."""

        def report_progress(doing: str, left: int) -> None:
            if report is not None:
                report(Progress(doing, len(recordings), len(recordings) + left))

        def report_search(diagonal: str, doing: str, halvings: int) -> None:
            other = self.com_search.halvings(stance) if diagonal == next(iter(DIAGONALS)) else 0
            report_progress(doing, halvings + other + len(AXES))

        find_com(TrialRunner(standing, stance, self.com_search, report_search))  # step 1
        for index, axis in enumerate(AXES):  # step 2
            report_progress(f"excitation about {axis}", len(AXES) - index)
            excitation_axis(standing, stance, axis, self.excitation)

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        halvings = self.com_search.halvings(stance)
        time = (
            2 * halvings * _LIFT_TIME * stance.scale.time / self.com_search.speed
            + _EXCITATIONS_TIME * stance.scale.time
        )
        postures = [
            *_searched_postures(robot, stance, self.com_search),
            *excitation_postures(robot, stance, self.excitation),
        ]
        return Course("lifts two diagonal feet repeatedly, then oscillates about three axes", time, tuple(postures))

    def expected_trials(self, stance: Stance) -> int:
        return 2 * self.com_search.halvings(stance) + len(AXES)

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> SearchReading:
        return SearchReading(robot, stance, recordings, self.com_search)

    def study_columns(self, result: Calibration, stance: Stance) -> Mapping[str, Any]:
        """Return the planar CoM after each halving [m]."""
        path = com_by_iteration(result, self.com_search.bracket(stance))
        return {"iteration_x": path[:, 0].tolist(), "iteration_y": path[:, 1].tolist()}

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """Compute the result from the recordings of a run of this method.

        Raises:
            RecordingError: they do not contain a complete search on both diagonals.
        """
        lifts = read_lift_trials(robot, recordings, stance.joint_position)
        lines: dict[str, SupportLine] = {}
        planes: list[SupportPlane] = []
        for diagonal in DIAGONALS:
            lines[diagonal], plane = _support_line(lifts, diagonal, stance, self)
            planes.append(plane)
        nominal = nominal_inertia(robot, stance.joint_position)
        x_c, y_c = find_intersection(planes, float(nominal.composite.com[2]))  # Algorithm 2, line 5
        com = np.array([x_c, y_c, nominal.composite.com[2]])
        excitations, fits, trials = estimate_excitations(robot, recordings, com, stance, self.excitation)
        return Calibration(
            method=self.name,
            **model_facts(robot, stance.joint_position),
            composite=Body.partial(nominal.composite, com_in_base=(float(x_c), float(y_c), None)),
            base=Body.partial(nominal.base),
            stance_effective=Body.partial(nominal.stance_effective),
            excitations=excitations,
            support_lines=lines,
            trials=(*(_trial(lift) for lift in lifts), *trials),
            settings=self.to_dict(),
            warnings=(
                *_weight_warning(robot, recordings),
                *(
                    f"excitation about {axis}: {excitation.note}"
                    for axis, excitation in excitations.items()
                    if excitation.note is not None
                ),
            ),
            evidence=SearchEvidence(tuple(recordings), fits, tuple(lift.tried for lift in lifts)),
        )


def _searched_postures(robot: RobotModel, stance: Stance, settings: ComSearchSettings) -> list[RehearsedPosture]:
    """Return the postures at both ends of the search with the highest lift."""
    height = lift_heights(settings.lift(stance))[-1]
    postures: list[RehearsedPosture] = []
    for diagonal, legs in DIAGONALS.items():
        for offset in settings.bounds(stance):
            feet = shifted_feet(stance, offset)
            feet[[leg not in legs for leg in LEG_NAMES], 2] += height
            name = f"lines at {offset * 1000:+.0f} mm: two feet up by up to {height * 1000:.0f} mm, on {diagonal}"
            postures.append(held_posture(robot, name, feet, stance.joint_position, legs, settings.halvings(stance)))
    return postures


def _weight_warning(robot: RobotModel, recordings: Sequence[Recording]) -> list[str]:
    """Return a warning if the mass from the joint torques at rest differs from the model's."""
    masses: list[float] = []
    for recording in recordings:
        if isinstance(recording.trial, LiftTrial) and not recording.refused:
            rest = recording.phase(Phase.REST).joints
            if rest.torque is not None:
                masses.append(carried_mass(robot, rest.position.mean(axis=0), rest.torque.mean(axis=0)))
    if not masses or abs(float(np.median(masses)) / robot.mass - 1) < _MASS_MISMATCH:
        return []
    return [
        f"the joint torques give a mass of about {np.median(masses):.1f} kg, the model {robot.mass:.1f} kg: the legs sag "
        "under the unmodelled load, and the centre of mass may be wrong by several millimetres"
    ]


def _support_line(
    lifts: list[LiftReading], diagonal: str, stance: Stance, settings: PaperMethod
) -> tuple[SupportLine, SupportPlane]:
    """Return a diagonal's support line, between the last trial that tipped forward and the last that tipped backward."""
    lifts = [lift for lift in lifts if lift.trial.diagonal == diagonal]
    bracket = reduce(step, [lift.tried for lift in lifts], settings.com_search.bracket(stance))
    if not done(bracket):
        tips = [sum(lift.tilt.verdict == verdict for lift in lifts) for verdict in ("forward", "backward", "balanced")]
        raise RecordingError(
            f"the recordings contain no complete search on {diagonal} with a tolerance of "
            f"{settings.com_search.tolerance * 1000:g} mm: of {len(lifts)} lifts {tips[0]} tip forward, {tips[1]} backward "
            f"and {tips[2]} stay balanced; check for missing recordings, or resume an interrupted run"
        )
    measured = bracket.plane if settings.feet == "measured" else None
    plane = measured or commanded_plane(stance, diagonal, bracket.middle)
    point, normal = (tuple(float(value) for value in vector) for vector in (plane.point, plane.normal))
    return SupportLine(bracket.middle, bracket.lower, bracket.upper, point, normal), plane  # pyright: ignore[reportArgumentType]


def _trial(lift: LiftReading) -> Trial:
    trial = lift.trial
    return Trial(
        trial.kind, trial.diagonal, trial.offset, trial.lift_height, lift.tilt.about_line, lift.tilt.verdict,
        lift.recording.duration,
    )  # fmt: skip


def estimate_excitations(
    robot: RobotModel,
    recordings: Sequence[Recording],
    com_at_stance: FloatArray,
    stance: Stance,
    settings: ExcitationSettings,
) -> tuple[dict[str, ExcitationEstimate], dict[str, AxisFit], list[Trial]]:
    """Fit I and C of each axis. If an axis was excited twice, the second, smaller excitation counts."""
    estimates: dict[str, ExcitationEstimate] = {}
    fits: dict[str, AxisFit] = {}
    trials: list[Trial] = []
    by_axis = {
        str(axis): recording
        for recording in recordings
        if isinstance(trial := recording.trial, ExcitationTrial) and recording.complete
        for axis in trial.frequencies
    }
    for axis in AXES:
        recording = by_axis.get(axis)
        if recording is None:
            reason = why_unreachable(robot, stance, axis, settings)
            note = f"skipped, not possible with all feet on the floor: {reason}" if reason else "not recorded"
            estimates[axis] = ExcitationEstimate(None, None, note=note)
            continue
        trials.append(Trial(ExcitationTrial.kind, axis, None, None, None, None, recording.duration))
        if recording.joints.torque is None:
            estimates[axis] = ExcitationEstimate(None, None, note="the robot reports no joint torques")
            continue
        try:
            fit = fits[axis] = fit_axis(robot, recording, axis, com_at_stance, stance.joint_position)
        except RecordingError as error:
            estimates[axis] = ExcitationEstimate(None, None, note=str(error))
            continue
        rotation = fit.sinusoid.amplitude / (2 * np.pi * fit.sinusoid.frequency)
        note = why_not_standing(robot, recording)
        if fit.inertia <= 0:
            note = f"the fitted moment of inertia, {fit.inertia:.3g} kg m2, is not positive; check the joint torques"
        estimates[axis] = ExcitationEstimate(fit.inertia, fit.damping, fit.sinusoid.frequency, rotation, note)
    return estimates, fits, trials
