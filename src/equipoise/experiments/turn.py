"""Rotation of a lying robot by 180 deg, by the operator or by the simulator.

The joints are damped without position control. The motion ends when the operator confirms. The gyroscope is recorded
throughout, and later decisions depend on the recording alone.
"""

from __future__ import annotations

import math

from equipoise.errors import MotionError, SettingsError
from equipoise.experiments.motion import Target
from equipoise.experiments.stand import before_stops
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.platform.platform import TURNS, TiltLimit
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.stance import Stance, lies

_PATIENCE = 120.0  # [s] for the operator
_SIMULATED = 2.0  # [s] for a simulator


def check_turn(standing: StandingRobot) -> None:
    """Raise SettingsError if neither simulator nor operator can turn the robot."""
    if TURNS not in standing.platform.accepts and standing.operator_done is None:
        raise SettingsError(
            "an operator has to turn the robot and confirm it: give `operator_done` to calibrate(), or omit `rotate_halfway`"
        )


def be_turned(standing: StandingRobot, stance: Stance) -> Recording:
    """Wait until the lying robot was turned. Phase: turn.

    Raises:
        MotionError: the operator did not confirm in time, or the robot no longer lies.
    """
    by_itself = TURNS in standing.platform.accepts
    said = None if by_itself else TiltLimit(math.inf, (0.0, 0.0, 0.0), stop_requested=standing.operator_done)
    motion = standing.motion().phase(Phase.TURN).hold_limp(_SIMULATED if by_itself else _PATIENCE)
    recording = standing.play(motion, said)
    if not by_itself and (recording.commands is None or recording.commands.time.size == motion.count):
        raise MotionError(
            f"the rotation of the robot was not confirmed within {_PATIENCE:.0f} s; resume the run with an operator present",
            (recording,),
        )
    here = before_stops(standing.robot, recording.joints.position[-1])
    if not lies(standing.robot, stance, here):
        raise MotionError(
            "the robot no longer lies: its legs hang or stand. Put it on its belly before you confirm the rotation",
            (recording,),
        )
    standing.start_from(Target.lying(standing.robot, here))
    return recording
