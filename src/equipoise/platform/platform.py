"""The seam between experiments and robots: four methods, and what never changes about the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.recording import Event, Recording


@dataclass(frozen=True, eq=False)
class JointCommand:
    """Command of the joints for the next control period. None leaves a value to the platform.

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
        """Return whether the joints only resist being moved."""
        return self.kp is not None and not self.kp.any()

    @classmethod
    def damping(cls, position: FloatArray, kd: FloatArray | float) -> JointCommand:
        """Return the command with which joints only resist being moved, with a velocity gain [Nm s/rad]."""
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
        """Return the command that stays where this one leads."""
        return self if self.velocity is None else replace(self, velocity=None)


ACCEPTS_EVERYTHING = frozenset({"velocity", "torque", "gains"})
"""`accepts` of a platform that uses all that a command can hold."""

TURNS = "turn"
"""In `accepts`: in a motion's phase "turn" the platform itself turns the robot to face the other way."""


@dataclass(frozen=True, eq=False)
class Health:
    """Condition of the robot. A value that the robot does not report is None.

    Attributes:
        motor_temperature: (nj,) motor temperatures in the model's joint order [deg C].
        battery_voltage: voltage of the battery [V].
        battery_charge: charge of the battery, from 0, empty, to 1, full.
        fault: fault that the robot itself reports, in its own words.
    """

    motor_temperature: FloatArray | None = None
    battery_voltage: float | None = None
    battery_charge: float | None = None
    fault: str | None = None


@dataclass(frozen=True, eq=False)
class RobotState:
    """Readings of the robot's sensors at one moment. A value that the robot does not report is None.

    Attributes:
        time: time by the robot's clock [s].
        joint_position: (nj,) joint positions by the encoders, in the model's joint order [rad].
        joint_velocity: (nj,) joint velocities [rad/s].
        joint_torque: (nj,) joint torques as the motors report them [Nm].
        angular_velocity_in_imu: (3,) angular velocity of the IMU in its own frame, by the gyroscope [rad/s].
        acceleration_in_imu: (3,) specific force in the IMU frame, by the accelerometer; +g upward at rest [m/s2].
        imu_time: time of gyroscope and accelerometer, where it is not `time` [s].
        received: time of arrival by this computer's monotonic clock [s]; None in simulation, where nothing is late.
        health: temperatures, battery and faults, as far as the robot reports them.
        request: request of the robot's remote control: "" none, "damp" or "lie down".
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
    """An open-loop motion: one command per control period.

    Attributes:
        position: (n, nj) joint position targets [rad].
        velocity: (n, nj) feed-forward velocities [rad/s], or None.
        torque: (n, nj) feed-forward torques [Nm], or None.
        events: events to note in the recording; times count from the start of the motion [s].
        limp: whether the joints are only to resist being moved, where gains can be sent.
        kp: (nj,) position gains all through the motion [Nm/rad], or None: the platform's own.
        kd: (nj,) velocity gains all through the motion [Nm s/rad], or None: the platform's own.
        trial: id of the trial that the motion is a part of, for its log; None: it is a part of none.
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
        if self.position.ndim != 2 or len(self.position) == 0 or not np.isfinite(self.position).all():
            raise SettingsError(f"a trajectory needs (n, nj) finite positions, got shape {self.position.shape}")
        for name in ("velocity", "torque"):
            array = getattr(self, name)
            if array is not None and (array.shape != self.position.shape or not np.isfinite(array).all()):
                raise SettingsError(f"trajectory {name} must be finite and of shape {self.position.shape}")
        for name in ("kp", "kd"):
            gains = getattr(self, name)
            if gains is not None and (gains.shape != self.position.shape[1:] or not (gains >= 0).all()):
                raise SettingsError(f"trajectory {name} must be {self.position.shape[1]} numbers of zero or more")

    @classmethod
    def of(cls, command: JointCommand) -> Trajectory:
        """Return a motion of one control period."""
        velocity, torque = (None if each is None else each[None] for each in (command.velocity, command.torque))
        return cls(command.position[None], velocity, torque, kp=command.kp, kd=command.kd)

    def command(self, index: int) -> JointCommand:
        """The command of one control period."""
        velocity = None if self.velocity is None else self.velocity[index]
        torque = None if self.torque is None else self.torque[index]
        kp = np.zeros(self.position.shape[1]) if self.limp else self.kp
        return JointCommand(self.position[index], velocity, torque, kp, self.kd)


class Platform(Protocol):
    """A robot, real or simulated. Use it as a context manager: leaving it ends safely.

    Attributes:
        control_period: time between commands [s].
        joint_names: names of the joints, in the order of every joint vector.
        accepts: those of "velocity", "torque" and "gains" that it uses of commands, the others are ignored; and "turn" if
            the platform turns the robot in a motion's phase of that name.
    """

    @property
    def control_period(self) -> float: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...

    @property
    def accepts(self) -> frozenset[str]: ...

    def read(self) -> RobotState:
        """Sense without commanding."""
        ...

    def step(self, command: JointCommand) -> RobotState:
        """Send a command, let one control period pass, and sense."""
        ...

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play an open-loop motion. Sample k of the recording is sensed as command k is sent.

        `stop` is tested at every sample on hardware, and every few samples in simulation; the motion ends where it is met.

        Raises:
            MotionInterrupted: Ctrl-C; carries the recording so far.
        """
        ...

    def close(self) -> None:
        """End safely: the robot is left with its motors in a safe state. May be called twice."""
        ...


class MotionInterrupted(KeyboardInterrupt):
    """Ctrl-C during a motion. The recording up to then is kept in `recording` (None if it held no sample)."""

    def __init__(self, recording: Recording | None) -> None:
        super().__init__("interrupted")
        self.recording = recording
