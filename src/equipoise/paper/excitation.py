"""Step 2 of the paper: sinusoidal excitation of the base about one axis at a time, all four feet on the floor."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import Axis
from equipoise.experiments.excitation import (
    RAMP_PERIODS,
    SETTLE_TIME,
    amplitude_for,
    feet_during_excitation,
    why_unreachable,
)
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import ExcitationTrial
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_KNOTS = 9
_LAG_PERIODS = 0.5  # after the ramp, until the base follows steadily
_CHECK_STRIDE = 40  # samples from one check of the feet to the next
_SLIP_RATIO = 0.02  # of the stance's length: a larger change of the distance between feet is a slip or a lift


def excitation_axis(standing: StandingRobot, stance: Stance, axis: Axis, settings: ExcitationSettings) -> None:
    """Oscillate the base about one axis through the model's CoM, all four feet on the floor.

    If the feet move, the excitation is repeated with half the amplitude. An axis is skipped if `why_unreachable` returns a
    reason. The recordings have the phases "settle", "ramp", "excitation" and "end".
    """
    if why_unreachable(standing.robot, stance, axis, settings) is not None:
        return
    amplitude = amplitude_for(standing.robot, stance, axis, settings)
    recording = _play_excitation(standing, stance, axis, amplitude, settings)
    if why_not_standing(standing.robot, recording) is not None:
        _play_excitation(standing, stance, axis, amplitude / 2, settings)


def _play_excitation(
    standing: StandingRobot, stance: Stance, axis: Axis, amplitude: float, settings: ExcitationSettings
) -> Recording:
    frequency = settings.frequency_for(stance)
    duration = settings.duration_for(stance)
    ramp, lag = RAMP_PERIODS / frequency, _LAG_PERIODS / frequency
    total = duration + lag + 2 * ramp
    time = np.arange(round(total / standing.platform.control_period)) * standing.platform.control_period
    envelope = np.clip(np.minimum(time, total - time) / ramp, 0, 1)
    angle = amplitude * envelope * np.sin(2 * np.pi * frequency * time)
    motion = standing.motion().begin(ExcitationTrial(frequencies={axis: frequency}, amplitude=amplitude))
    motion.phase(Phase.SETTLE).move_feet(stance.feet_in_base, SETTLE_TIME).hold(SETTLE_TIME)
    begin = motion.time
    motion.phase(Phase.RAMP).follow(feet_during_excitation(standing.robot, stance, axis), _KNOTS, angle)
    motion.phase_at(Phase.EXCITATION, begin + ramp + lag).phase_at(Phase.END, begin + ramp + lag + duration)
    standing.play(motion.move_feet(stance.feet_in_base, SETTLE_TIME))
    return standing.finish()


def why_not_standing(robot: RobotModel, recording: Recording) -> str | None:
    """Return how the feet moved or lost their load, according to encoders and joint torques, or None if they did not."""
    steady = recording.phase(Phase.EXCITATION).joints
    torques = np.zeros_like(steady.position) if steady.torque is None else steady.torque
    feet, forces = feet_and_forces(robot, steady.position[::_CHECK_STRIDE], torques[::_CHECK_STRIDE])
    pairs = feet[:, :, None] - feet[:, None]
    spread = np.linalg.norm(pairs, axis=-1).std(axis=0).max()
    length = float(np.ptp(feet[0, :, 0]))
    if spread > _SLIP_RATIO * length:
        return f"the distances between the feet change by {spread * 1000:.1f} mm"
    if steady.torque is not None:
        loads = forces[:, :, 2]
        if loads.min() < 0.05 * loads.mean():
            return f"the smallest foot load is {loads.min():.1f} N, the mean {loads.mean():.1f} N"
    return None
