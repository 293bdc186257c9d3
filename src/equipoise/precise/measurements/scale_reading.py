"""What a scale may have said: refused where no such robot weighs so much, questioned where its joints carry another weight."""

from __future__ import annotations

import warnings

from equipoise.errors import SettingsError
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import HEAVIEST
from equipoise.robot.statics import carried_mass

_LIGHTEST = 0.05  # [kg]
_OTHER_ROBOT = 10.0  # times the model file's mass, or a tenth of it: no load and no CAD file is so far off
_ODD = 1.6  # times what joint torques carry: three standard deviations of what they are believed to be off in common


def check_mass(mass: float) -> None:
    """Refuse a mass [kg] that no legged robot has.

    Raises:
        SettingsError: it is too large, most likely in grams, or too small.
    """
    if mass > HEAVIEST:
        raise SettingsError(
            f"a scale's mass of {mass:g} kg is more than any legged robot's; if it is in grams, give {mass / 1000:g}"
        )
    if not mass >= _LIGHTEST:
        raise SettingsError(f"a scale's mass is {mass:g} kg; it must be {_LIGHTEST:g} kg or more")


def check_mass_of(robot: RobotModel, mass: float) -> None:
    """Refuse a mass [kg] of another robot than the model file's.

    Raises:
        SettingsError: it is ten times the file's, or a tenth.
    """

    def fits(mass: float) -> bool:
        return 1 / _OTHER_ROBOT < mass / robot.mass < _OTHER_ROBOT

    if not fits(mass):
        like = f"; if it is in grams, give {mass / 1000:g}" if fits(mass / 1000) else ""
        raise SettingsError(
            f"a scale's mass of {mass:g} kg is another robot's: the model file of {robot.name!r} has {robot.mass:.4g} kg{like}"
        )


def question_mass(robot: RobotModel, mass: float, recording: Recording) -> None:
    """Warn, early in a run, of a mass [kg] far from what the joint torques carry in the rest before a lift."""
    rest = recording.phase(Phase.REST).joints
    if rest.torque is None:
        return
    carried = carried_mass(robot, rest.position.mean(axis=0), rest.torque.mean(axis=0))
    if not 1 / _ODD < mass / carried < _ODD:
        warnings.warn(
            f"the scale says {mass:g} kg, and joint torques carry {carried:.1f} kg; unless they are known to be so far off, "
            "end the run (Ctrl-C) and give the right --mass, or none",
            stacklevel=2,
        )
