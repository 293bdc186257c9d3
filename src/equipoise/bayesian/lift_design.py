"""Design of a lift trial: support line, height, duration, and rotation of the body or swing of the lifted feet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from equipoise.bayesian.safe_lift import safe_stop, search_covariance
from equipoise.conventions import Axis, FloatArray, Swing
from equipoise.errors import ReachError
from equipoise.experiments.lift import LiftSettings
from equipoise.experiments.posture import check_posture, feet_in_posture
from equipoise.experiments.tipping import Pendulum
from equipoise.recording.trials import meanwhile
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

# On an A1; lengths scale with the stance's size, times with its clock.
_LIFT = 0.024  # [m]
_OFFSET = 0.006  # [m] from CoM to support line: the robot tips within the time on two feet
_TILT_LIMIT = 0.06  # [rad]
_STILL = 0.004  # [rad/s]; a base that oscillates at 6 mrad/s moves the accelerometer's vertical by a milliradian
_WATCH_TIME = 0.35  # [s] on two feet of a passive lift
_TURN_TIME = 1 / 3  # [s] of one rotation of the body and back, or of the lifted feet's swing
_SWING = 0.07  # [m] amplitude of the lifted feet's swing, before the envelope of `amounts`
AMPLITUDES: dict[Axis, float] = {"roll": 0.10, "pitch": 0.05, "yaw": 0.06}
"""Amplitudes of the body's rotation on two feet, before the envelope of `amounts` [rad]; larger ones lift feet off."""
_AXES: dict[Axis, FloatArray] = {"roll": np.eye(3)[0], "pitch": np.eye(3)[1], "yaw": np.eye(3)[2]}
_DIRECTIONS: dict[Swing, FloatArray] = {"ahead": np.eye(3)[0], "aside": np.eye(3)[1]}


@dataclass(frozen=True)
class LiftDesign:
    """One lift trial of the Bayesian method.

    Attributes:
        posture: posture of the base with all feet on the floor.
        diagonal: diagonal to stand on.
        side: side of the support line relative to the CoM: 1 ahead, -1 behind, 0 under it.
        turn: axis of the body's rotation about its CoM on two feet, or None.
        swing: swing direction of the lifted feet, or None.
    """

    posture: BodyPosture
    diagonal: str
    side: int
    turn: Axis | None = None
    swing: Swing | None = None

    @property
    def passive(self) -> bool:
        """True if the robot only tips."""
        return self.turn is None and self.swing is None

    @property
    def meanwhile(self) -> str:
        """Description of the motion on two feet."""
        return meanwhile(self.turn, self.swing)

    def amplitude(self, stance: Stance) -> float:
        """Return the amplitude, before the envelope, of the motion on two feet: rotation [rad], swing [m], zero if passive."""
        if self.turn is not None:
            return AMPLITUDES[self.turn]
        return 0.0 if self.swing is None else _SWING * stance.scale.length

    def amounts(self, stance: Stance, control_period: float) -> FloatArray:
        """Return the (n,) displacements at each control period: once to and fro, from rest to rest."""
        count = round(_TURN_TIME * stance.scale.time / control_period)
        phase = np.arange(1, count + 1) / count
        return self.amplitude(stance) * np.sin(2 * np.pi * phase) * np.sin(np.pi * phase)

    def feet(self, lifted: FloatArray, com: FloatArray, amount: float) -> FloatArray:
        """Return the (4, 3) feet in the base frame [m] at a displacement, from those of a passive lift."""
        if self.turn is not None:
            return (lifted - com) @ np.array(pin.exp3(_AXES[self.turn] * amount)) + com
        feet = lifted.copy()
        if self.swing is not None:
            in_air = [leg not in DIAGONALS[self.diagonal] for leg in LEG_NAMES]
            feet[in_air] += amount * _DIRECTIONS[self.swing] @ self.posture.rotation
        return feet


def lift_settings(stance: Stance) -> LiftSettings:
    """Return the heights and times of the lifts."""
    clock = stance.scale.time
    return replace(
        LiftSettings.of(stance, _LIFT * stance.scale.length),
        move_time=0.3 * clock,
        settle_time=0.12 * clock,
        rest_time=0.3 * clock,
        unload_time=0.12 * clock,
        lift_time=0.12 * clock,
        watch_time=_WATCH_TIME * clock,
        lower_time=0.15 * clock,
        step_time=0.07 * clock,
        tilt_limit=_TILT_LIMIT,
        stop_delay=0.04 * clock,
        rate_time=0.016 * clock,
        still_speed=_STILL,
        max_settling=25,
    )


def offset_of(stance: Stance, side: int) -> float:
    """Return the signed distance of the support line from the CoM [m]."""
    return side * _OFFSET * stance.scale.length


def lift_feet(
    stance: Stance, com: FloatArray, design: LiftDesign, height: float, drift: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the (4, 3) feet in the base frame [m], on the floor and lifted.

    Args:
        drift: distance of the CoM ahead of its commanded position [m].
    """
    feet = feet_in_posture(stance, com, design.posture, design.diagonal, offset_of(stance, design.side) + drift)
    lifted = feet.copy()
    in_air = [leg not in DIAGONALS[design.diagonal] for leg in LEG_NAMES]
    lifted[in_air] += height * design.posture.rotation[2]
    return feet, lifted


class LiftChecks:
    """Checks of the lifts of one robot; results that do not depend on turn and swing are cached.

    Args:
        com_covariance: (3, 3) covariance of the CoM in the base frame, scaled to two standard deviations [m2]; default
            `search_covariance`.
    """

    def __init__(
        self, robot: RobotModel, stance: Stance, com: FloatArray, com_covariance: FloatArray | None = None
    ) -> None:
        self._robot, self._stance, self._com = robot, stance, com
        self._com_covariance = search_covariance(stance) if com_covariance is None else com_covariance
        self._settings = lift_settings(stance)
        self._cache: dict[tuple[str, LiftDesign], FloatArray | ReachError] = {}

    def check(self, design: LiftDesign) -> None:
        """Raise ReachError if a lift is not within reach, joint torque limits and the safe tilt."""
        passive = replace(design, turn=None, swing=None)
        standing = self._cached(self._standing_joints, passive)
        _, lifted = lift_feet(self._stance, self._com, design, self._settings.height)
        amplitude = design.amplitude(self._stance)
        for amount in (0.0,) if design.passive else (amplitude, -amplitude):
            feet = design.feet(lifted, self._com, amount)
            check_posture(self._robot, self._stance, feet, DIAGONALS[design.diagonal], near=standing)
        self._cached(self._safe_tilt, passive)

    def _cached(self, compute: Callable[[LiftDesign], FloatArray], design: LiftDesign) -> FloatArray:
        """Return the cached result of a computation, or raise its cached error."""
        key = compute.__name__, design
        if key not in self._cache:
            try:
                self._cache[key] = compute(design)
            except ReachError as error:
                self._cache[key] = error
        found = self._cache[key]
        if isinstance(found, ReachError):
            raise found
        return found

    def _standing_joints(self, design: LiftDesign) -> FloatArray:
        """Return the (nj,) joint positions over the line on four feet [rad]."""
        feet, _ = lift_feet(self._stance, self._com, design, self._settings.height)
        return check_posture(self._robot, self._stance, feet)

    def _safe_tilt(self, design: LiftDesign) -> FloatArray:
        """Return the (2,) safe tilt backward and forward [rad]."""
        up, settings = design.posture.rotation[2], self._settings
        feet, _ = lift_feet(self._stance, self._com, design, settings.height)
        height = float(self._com @ up - (feet @ up).mean())
        half_width = float(np.abs(self._stance.feet_in_base[:, 1]).mean())
        if height <= 0:
            raise ReachError(
                f"the centre of mass is {-height * 1000:.0f} mm below the feet: check the masses of the model"
            )
        if settings.height > half_width:
            raise ReachError(
                f"a lift height of {settings.height * 1000:.0f} mm is too large for feet {half_width * 2000:.0f} mm apart: "
                "choose a wider stance"
            )
        tipping = Pendulum.of(self._robot, self._cached(self._standing_joints, design), up, design.diagonal)
        return np.array(safe_stop(tipping, settings, self._stance, self._com_covariance))
