"""Interface between experiments and robots: four methods, and the robot's constants."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.recording import Event, Recording
from equipoise.small_arrays import all_of, any_of


@dataclass(frozen=True, eq=False)
class JointCommand:
    """Joint command for the next control period. None leaves a value to the platform.

    Attributes:
        position: (nj,) position targets in the model's joint order [rad].
        velocity: (nj,) feed-forward velocities [rad/s].
        torque: (nj,) feed-forward torques [Nm].
        kp: (nj,) position gains [Nm/rad].
        kd: (nj,) velocity gains [Nm s/rad].
    """

    position: FloatArray
    velocity: FloatArray | None = None
    torque: FloatArray | None = None
    kp: FloatArray | None = None
    kd: FloatArray | None = None

    @property
    def limp(self) -> bool:
        """Return whether the joints only resist motion."""
        return self.kp is not None and not any_of(self.kp != 0)

    @classmethod
    def damping(cls, position: FloatArray, kd: FloatArray | float) -> JointCommand:
        """Return a command with which joints only resist motion, with a velocity gain [Nm s/rad]."""
        return cls(
            position, kp=np.zeros_like(position), kd=np.broadcast_to(np.asarray(kd, dtype=float), position.shape)
        )

    def table(self, kp: FloatArray | float, kd: FloatArray | float) -> FloatArray:
        """Return (5, nj) positions, velocities, torques, kp and kd.

        Args:
            kp, kd: gains where the command has none [Nm/rad], [Nm s/rad]; velocities and torques are zero there.
        """
        zeros = np.zeros_like(self.position)
        given = (self.position, self.velocity, self.torque, self.kp, self.kd)
        own = (zeros, zeros, zeros, zeros + kp, zeros + kd)
        return np.array([default if row is None else row for row, default in zip(given, own, strict=True)])

    def held(self) -> JointCommand:
        """Return the command that holds this one's position."""
        return self if self.velocity is None else replace(self, velocity=None)


ACCEPTS_EVERYTHING = frozenset({"velocity", "torque", "gains"})
"""`accepts` of a platform that uses all values of a command."""

TURNS = "turn"
"""Value in `accepts` of a platform that turns the robot by 180 degrees itself in a motion's phase "turn"."""


@dataclass(frozen=True, eq=False)
class Health:
    """Condition of the robot. A value that the robot does not report is None.

    Attributes:
        motor_temperature: (nj,) motor temperatures in the model's joint order [deg C].
        battery_voltage: voltage of the battery [V].
        battery_charge: charge of the battery, from 0, empty, to 1, full.
        fault: fault that the robot itself reports, in words.
    """

    motor_temperature: FloatArray | None = None
    battery_voltage: float | None = None
    battery_charge: float | None = None
    fault: str | None = None


@dataclass(frozen=True, eq=False)
class RobotState:
    """Readings of the robot's sensors at one moment. A value that the robot does not report is None.

    Attributes:
        time: time on the robot's clock [s].
        joint_position: (nj,) joint positions from the encoders, in the model's joint order [rad].
        joint_velocity: (nj,) joint velocities [rad/s].
        joint_torque: (nj,) joint torques as the motors report them [Nm].
        angular_velocity_in_imu: (3,) angular velocity of the IMU in its own frame, from the gyroscope [rad/s].
        acceleration_in_imu: (3,) specific force in the IMU frame, from the accelerometer; +g upward at rest [m/s2].
        imu_time: time of gyroscope and accelerometer, if it is not `time` [s].
        received: time of arrival on this computer's monotonic clock [s]; None in simulation.
        health: temperatures, battery and faults.
        request: request of the robot's remote control: "" (none), "damp" or "lie down".
    """

    time: float
    joint_position: FloatArray
    joint_velocity: FloatArray | None
    joint_torque: FloatArray | None
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    imu_time: float | None = None
    received: float | None = None
    health: Health | None = None
    request: str = ""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Open-loop motion: one command per control period.

    Attributes:
        position: (n, nj) joint position targets [rad].
        velocity: (n, nj) feed-forward velocities [rad/s], or None.
        torque: (n, nj) feed-forward torques [Nm], or None.
        events: events for the recording; times count from the start of the motion [s].
        limp: whether the joints only resist motion, if gains can be sent.
        kp: (nj,) position gains throughout the motion [Nm/rad], or None: the platform's own.
        kd: (nj,) velocity gains throughout the motion [Nm s/rad], or None: the platform's own.
        trial: id of the motion's trial, for the log; None: it belongs to no trial.
    """

    position: FloatArray
    velocity: FloatArray | None = None
    torque: FloatArray | None = None
    events: tuple[Event, ...] = ()
    limp: bool = False
    kp: FloatArray | None = None
    kd: FloatArray | None = None
    trial: int | None = None

    def __post_init__(self) -> None:
        if self.position.ndim != 2 or len(self.position) == 0 or not all_of(np.isfinite(self.position)):
            raise SettingsError(f"a trajectory needs (n, nj) finite positions, got shape {self.position.shape}")
        for name in ("velocity", "torque"):
            array = getattr(self, name)
            if array is not None and (array.shape != self.position.shape or not all_of(np.isfinite(array))):
                raise SettingsError(f"trajectory {name} must be finite and of shape {self.position.shape}")
        for name in ("kp", "kd"):
            gains = getattr(self, name)
            if gains is not None and (gains.shape != self.position.shape[1:] or not all_of(gains >= 0)):
                raise SettingsError(f"trajectory {name} must be {self.position.shape[1]} numbers of zero or more")

    @classmethod
    def of(cls, command: JointCommand) -> Trajectory:
        """Return a motion of one control period."""
        velocity, torque = (None if each is None else each[None] for each in (command.velocity, command.torque))
        return cls(command.position[None], velocity, torque, kp=command.kp, kd=command.kd)

    def command(self, index: int) -> JointCommand:
        """Return the command of one control period."""
        velocity = None if self.velocity is None else self.velocity[index]
        torque = None if self.torque is None else self.torque[index]
        kp = np.zeros(self.position.shape[1]) if self.limp else self.kp
        return JointCommand(self.position[index], velocity, torque, kp, self.kd)


class Platform(Protocol):
    """Real or simulated robot. Use it as a context manager: leaving it ends safely.

    Attributes:
        control_period: time between commands [s].
        joint_names: names of the joints, in the order of every joint vector.
        accepts: the values that it uses of a command besides positions: "velocity", "torque", "gains"; and "turn" if the
            platform turns the robot in a motion's phase of that name.
    """

    @property
    def control_period(self) -> float: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...

    @property
    def accepts(self) -> frozenset[str]: ...

    def read(self) -> RobotState:
        """Return the state without commanding."""
        ...

    def step(self, command: JointCommand) -> RobotState:
        """Send a command, let one control period pass, and return the state."""
        ...

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play an open-loop motion. Sample k of the recording is measured when command k is sent.

        `stop` is tested at every sample on hardware, and every few samples in simulation; the motion ends once it is met.

        Raises:
            MotionInterrupted: Ctrl-C; carries the recording so far.
        """
        ...

    def close(self) -> None:
        """Leave the motors in a safe state. May be called twice."""


class MotionInterrupted(KeyboardInterrupt):
    """Ctrl-C during a motion. `recording` holds the samples so far, or None without samples."""

    def __init__(self, recording: Recording | None) -> None:
        super().__init__("interrupted")
        self.recording = recording
