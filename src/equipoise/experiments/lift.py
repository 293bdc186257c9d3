"""Common parts of all lifts of two diagonal feet: rest before, end, and replanted feet after."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import FallError, MotionError
from equipoise.experiments.motion import Motion
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tilt import still_means
from equipoise.experiments.tipping import Pendulum
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.stance import Stance

_STEP_RATIO = 0.6  # height of a replanting step over that of a lift
_STILL_PARTS = 5
_UPRIGHT = float(np.cos(np.radians(25)))  # a standing robot leans less, also on a slope


@dataclass(frozen=True)
class LiftSettings:
    """Settings of a lift trial, for a robot of a certain size.

    Attributes:
        height: height of the first lift [m].
        growth: factor on the height after a lift without a tilt.
        max_lifts: number of lifts in a trial; the robot is balanced if none of them tilts.
        move_time, settle_time, rest_time, unload_time, lift_time, watch_time, lower_time: durations of the phases [s];
            a longer move takes longer; watch is the paper's t_thres.
        step_time: duration of a foot's motion up, and of that down, when feet are replanted [s].
        tilt_threshold: smallest rotation that counts as a tilt [rad].
        tilt_limit: lean of the CoM at which the tilt is certain and the feet are lowered [rad].
        stop_delay: delay from the end of a lift until the feet move, due to sampling, commands and drives [s].
        rate_time: time over which the lean is differentiated to predict the tipping [s].
        reached_tolerance: largest distance of joints from their targets (soft position control sags) [rad].
        still_speed: change of the base's angular velocity below which the robot is at rest [rad/s].
        max_settling: largest number of settling periods until the robot is at rest.
    """

    height: float
    growth: float = 1.6
    max_lifts: int = 3
    move_time: float = 0.4
    settle_time: float = 0.3
    rest_time: float = 0.3
    unload_time: float = 0.2
    lift_time: float = 0.15
    watch_time: float = 0.8
    lower_time: float = 0.4
    step_time: float = 0.08
    tilt_threshold: float = 0.01
    tilt_limit: float = 0.05
    stop_delay: float = 0.05
    rate_time: float = 0.016
    reached_tolerance: float = 0.25
    still_speed: float = 0.006
    max_settling: int = 10

    @classmethod
    def of(cls, stance: Stance, height: float) -> LiftSettings:
        """Return the settings of a lift by a height [m], with times for the robot's size."""
        usual = cls(height)
        return replace(usual, **{name: getattr(usual, name) * stance.scale.time for name in _SCALED})


_SCALED = (
    "move_time", "settle_time", "rest_time", "unload_time", "lift_time", "watch_time", "lower_time", "step_time",
)  # fmt: skip
"""Settings of a lift that scale with the robot's time."""


def tipping_from(standing: StandingRobot, still: Recording, diagonal: str) -> Pendulum:
    """Return the pendulum of the robot at rest on a diagonal.

    Raises:
        FallError: the robot is not upright.
    """
    rest = still_means(standing.robot, still)
    if rest.up_in_base[2] < _UPRIGHT:
        raise FallError(
            f"the robot leans by {np.degrees(np.arccos(rest.up_in_base[2])):.0f} deg on four feet: it has fallen, or the IMU "
            "is mounted in another orientation (give its pose as imu_rpy in the robot configuration)",
            (still,),
        )
    return Pendulum.of(standing.robot, rest.joint_position, rest.up_in_base, diagonal)


def tilt_limit(
    standing: StandingRobot, tipping: Pendulum, settings: LiftSettings, stop: tuple[float, float]
) -> TiltLimit:
    """Return the end condition of a lift: a certain tilt, or a predicted tilt beyond `stop` [rad]."""
    axis = tipping.axis_in_base @ np.array(standing.robot.imu_in_base.rotation)
    back, ahead = stop
    return TiltLimit(
        settings.tilt_limit,
        tuple(axis.tolist()),
        tuple(tipping.joints.tolist()),
        1 / tipping.rate,
        tipping.spin,
        (-back - tipping.lean, ahead - tipping.lean),
        settings.rate_time,
    )


def in_time(
    standing: StandingRobot, feet_in_base: FloatArray, lifted: FloatArray, settings: LiftSettings
) -> LiftSettings:
    """Return the settings with the actual lowering time, which joint speed limits may increase.

    Args:
        feet_in_base, lifted: (4, 3) feet in the base frame, down and up [m].
    """
    up = standing.motion().move_feet(lifted, settings.lift_time)
    slowed = Motion(standing.robot, up.control_period, up.target).move_feet(feet_in_base, settings.lower_time).slowed
    return settings if slowed == 1 else replace(settings, lower_time=slowed * settings.lower_time)


def come_to_rest(
    standing: StandingRobot, motion: Motion, settings: LiftSettings, when: str, rest_phase: str = Phase.REST
) -> Recording:
    """Play a motion, settle as `settle`, and rest in the phase `rest_phase`."""
    settled = settle(standing, motion, settings, when)
    return Recording.concatenate([settled, rest(standing, settings, rest_phase)])


def rest(standing: StandingRobot, settings: LiftSettings, phase: str = Phase.REST) -> Recording:
    """Hold the posture for the rest time."""
    return standing.play(standing.motion().phase(phase).hold(settings.rest_time))


def settle(standing: StandingRobot, motion: Motion, settings: LiftSettings, when: str) -> Recording:
    """Play a motion, and wait until the joints are near their targets and the base is still.

    Args:
        motion: motion, to which a phase "settle" is appended.
        when: description of the moment, for the error.

    Raises:
        MotionError: the robot did not come to rest near its targets.
    """
    parts = [standing.play(motion.phase(Phase.SETTLE).hold(settings.settle_time))]
    problem: str | None = None
    for _ in range(settings.max_settling):
        recording = Recording.concatenate(parts)
        problem = _not_at_rest(standing, recording, settings)
        if problem is None:
            return recording
        parts.append(standing.play(standing.motion().hold(settings.settle_time)))
    raise MotionError(
        f"the robot did not come to rest {when}: {problem}; remove obstacles, or increase the gains",
        (Recording.concatenate(parts),),
    )


def replant(motion: Motion, home: FloatArray, diagonal: str, settings: LiftSettings) -> None:
    """Step with each pair of feet once, in the nominal stance, so that feet are at their commanded positions.

    A robot that tipped onto its lifted feet drags them. Friction then holds the feet several millimetres (A1) from their
    targets. Stepping in the posture of the next trial would tip the robot as the trial does, with higher feet.
    """
    for standing in (DIAGONALS[diagonal], tuple(leg for leg in LEG_NAMES if leg not in DIAGONALS[diagonal])):
        raised = home.copy()
        raised[[leg not in standing for leg in LEG_NAMES], 2] += _STEP_RATIO * settings.height
        step_pair(motion, standing, raised, settings)


def step_pair(motion: Motion, standing: tuple[str, ...], raised: FloatArray, settings: LiftSettings) -> Motion:
    """Stand on some legs, step once with the others, and stand on all.

    Args:
        raised: (4, 3) foot positions in the base frame at the top of the step [m].
    """
    motion.shift_load(standing, settings.unload_time).step_feet(raised, settings.step_time)
    return motion.shift_load(LEG_NAMES, settings.unload_time)


def still_part(recording: Recording, settings: LiftSettings) -> Recording:
    """Return the end of a recording, in which a settled robot is still."""
    return recording.between(recording.joints.time[-1] - settings.rest_time, np.inf)


def _not_at_rest(standing: StandingRobot, recording: Recording, settings: LiftSettings) -> str | None:
    """Return the reason why the robot is not at rest at its targets at the end of a recording, or None."""
    tail = still_part(recording, settings)
    miss = np.abs(tail.joints.position.mean(axis=0) - standing.target.joint_position)
    worst = int(np.argmax(miss))
    if miss[worst] > settings.reached_tolerance:
        return f"joint {recording.joint_names[worst]!r} is {miss[worst]:.2f} rad from its target"
    # Means over parts of the tail average out the noise, and their differences do not depend on the gyroscope's bias.
    # An oscillating base also disturbs the accelerometer's vertical.
    parts = np.array_split(tail.imu.angular_velocity_in_imu, _STILL_PARTS)
    change = float(np.ptp([part.mean(axis=0) for part in parts], axis=0).max())
    if change > settings.still_speed:
        return f"its base still oscillates at {change:.3f} rad/s"
    return None
