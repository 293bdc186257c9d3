"""Result of the response test of joints and gyroscope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin


@dataclass(frozen=True)
class ResponseTest:
    """Result of a response test that the robot passed.

    Attributes:
        joints: number of joints that responded one by one while the robot lay; 0 if it stood or had no room.
        axes: axes about which the base turned over four feet: "roll", "pitch", "yaw".
        residual: difference between predicted and measured rotations of the base, RMS, as a fraction of the rotations.
        measured_rpy: measured orientation of the IMU in the base frame, roll pitch yaw [rad].
        std: standard deviation of the measured orientation about its least certain axis [rad].
        model_rpy: orientation of the IMU according to the model [rad].
        uses_measurement: True if the run uses the measured orientation; False if it uses the model's.
    """

    COMPUTED: ClassVar = ("angle",)
    joints: int
    axes: tuple[str, ...]
    residual: float
    measured_rpy: tuple[float, float, float]
    std: float
    model_rpy: tuple[float, float, float]
    uses_measurement: bool = False

    @property
    def angle(self) -> float:
        """Angle between the measured orientation and the model's [rad]."""
        measured, model = (pin.rpy.rpyToMatrix(np.array(rpy)) for rpy in (self.measured_rpy, self.model_rpy))
        return float(np.arccos(np.clip((np.trace(measured.T @ model) - 1) / 2, -1, 1)))

    @property
    def orientation(self) -> str:
        """Measured orientation of the IMU, with its standard deviation."""
        angles = " ".join(f"{np.degrees(angle) + 0.0:.1f}" for angle in self.measured_rpy)
        return f"the IMU is measured at roll pitch yaw {angles} deg (std {np.degrees(self.std):.1f} deg)"

    @property
    def message(self) -> str:
        """Number of joints that responded, measured orientation of the IMU, and orientation in use."""
        joints = (
            f"{self.joints} joints responded one by one"
            if self.joints
            else "no joint was tested alone, because the robot stood or had no room"
        )
        used = "the measured orientation is used" if self.uses_measurement else "the model's is used"
        return (
            f"Response test: {joints}; turns in {', '.join(self.axes)} have a residual of {self.residual:.1%}; "
            f"{self.orientation}, {np.degrees(self.angle):.1f} deg from the model's: {used}"
        )
