"""A robot that lies is turned to face the other way: by somebody who then says so, or by its simulator.

Its joints only resist being moved meanwhile. It is one motion, which ends when somebody says so: the gyroscope is recorded
all the time, and what is decided afterwards depends on the recording alone.
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

_PATIENCE = 120.0  # [s] for somebody who turns it
_SIMULATED = 2.0  # [s] that a simulator takes


def check_turn(standing: StandingRobot) -> None:
    """Refuse where nobody is there to turn the robot (SettingsError)."""
    if TURNS not in standing.platform.accepts and standing.told is None:
        raise SettingsError(
            "somebody has to turn the robot and say when it is done, and nobody is asked: give `told` to calibrate(), or "
            "leave the turn out"
        )


def be_turned(standing: StandingRobot, stance: Stance) -> Recording:
    """Wait until the lying robot was turned. Phase: turn.

    Raises:
        MotionError: nobody said in time that it was, or it does not lie any more.
    """
    by_itself = TURNS in standing.platform.accepts
    said = None if by_itself else TiltLimit(math.inf, (0.0, 0.0, 0.0), told=standing.told)
    motion = standing.motion().phase(Phase.TURN).hold_limp(_SIMULATED if by_itself else _PATIENCE)
    recording = standing.play(motion, said)
    if not by_itself and (recording.commands is None or recording.commands.time.size == motion.count):
        raise MotionError(
            f"nobody said within {_PATIENCE:.0f} s that the robot was turned; resume the run when somebody is there",
            (recording,),
        )
    here = before_stops(standing.robot, recording.joints.position[-1])
    if not lies(standing.robot, stance, here):
        raise MotionError(
            "the robot does not lie any more: its legs hang or stand. Put it on its belly before you say that it is turned",
            (recording,),
        )
    standing.start_from(Target.lying(standing.robot, here))
    return recording
