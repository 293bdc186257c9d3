"""Filter for plausible samples: fresh, in order, finite, and not frozen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import CommunicationError, MotionError
from equipoise.platform.platform import RobotState
from equipoise.recording.encoder_steps import frozen_travel
from equipoise.robot.model import RobotModel
from equipoise.small_arrays import all_of, any_of

_FROZEN_TIME = 0.15  # [s] of identical samples
_FROZEN_MOVE = 0.03  # [rad] of target motion meanwhile; more with coarse encoders
_JUMP, _JUMP_SPEED, _FASTEST = 0.05, 2.0, 50.0  # [rad], times the joint's limit, [rad/s]: beyond, no joint moved


@dataclass
class SampleCounts:
    """Counts of the samples that arrived; `rejected` ones had a wrong checksum, length or sender."""

    fresh: int = 0
    repeated: int = 0
    out_of_order: int = 0
    missing: int = 0
    rejected: int = 0
    longest_silence: float = 0.0


class SampleFilter:
    """Filter that every sample passes first.

    Args:
        robot: model of the robot.
        control_period: time between commands [s].
        silence: longest time without a fresh sample [s].

    Attributes:
        counts: counts of samples so far.
    """

    def __init__(self, robot: RobotModel, control_period: float, silence: float) -> None:
        self._names, self._period, self._silence = robot.joint_names, control_period, silence
        self._fastest = np.minimum(_JUMP_SPEED * robot.velocity_limit, _FASTEST)
        self._last: RobotState | None = None
        self._handed: FloatArray | None = None  # of the last sample: the same object again is not a new sample
        self._counting = True
        self._joints = self._imu = -np.inf  # times of the newest samples [s]
        self._joints_without = self._imu_without = 0.0  # [s]
        self._why = "missing"
        self._since = np.zeros(len(robot.joint_names))  # [s] of unchanged encoder readings
        self._steps = np.full(len(robot.joint_names), np.inf)  # smallest step of each encoder so far [rad]
        self._imu_since = 0.0
        self._sent_low, self._sent_high = np.full((2, len(robot.joint_names)), [[np.inf], [-np.inf]])
        self._imu_target: FloatArray | None = None
        self._moved = 0.0
        self.counts = SampleCounts()

    def accept(
        self, arrived: Sequence[RobotState], target: FloatArray | None, tolerant: bool = False
    ) -> list[RobotState]:
        """Return the fresh samples of a control period in order, without repeated and late ones.

        Args:
            target: (nj,) position targets at the time [rad], or None if nothing was sent.
            tolerant: whether to leave out implausible samples instead of raising.

        Raises:
            MotionError: samples are not finite, frozen or jump, or none was in order for too long.
            CommunicationError: no sample arrived for too long.
        """
        joints, imu = self._joints, self._imu
        self._counting = target is not None  # a robot that is only read may give the same sample again
        try:
            fresh = [sample for sample in arrived if self._look(sample)]
        except MotionError:
            if not tolerant:
                raise
            return []
        if not arrived and self._counting:
            self._why, self.counts.missing = "missing", self.counts.missing + 1
        passed = self._period if self._counting else 0.0
        self._joints_without = 0.0 if self._joints != joints else self._joints_without + passed
        self._imu_without = 0.0 if self._imu != imu else self._imu_without + passed
        self.counts.longest_silence = max(self.counts.longest_silence, self._joints_without, self._imu_without)
        if not tolerant:
            if max(self._joints_without, self._imu_without) > self._silence:
                self._complain()
            if target is not None:
                self._check_frozen(target)
        return fresh

    def _look(self, sample: RobotState) -> bool:
        """Count a sample; return whether it is new."""
        last = self._last
        imu = sample.time if sample.imu_time is None else sample.imu_time
        new_joints, new_imu = sample.time > self._joints, imu > self._imu
        again, self._handed = sample.joint_position is self._handed, sample.joint_position
        if not (new_joints or new_imu):
            if not self._counting:
                return False
            self._why = "missing" if again else "repeated" if sample.time == self._joints else "out_of_order"
            setattr(self.counts, self._why, getattr(self.counts, self._why) + 1)
            return False
        self._check_numbers(sample)
        if last is not None and new_joints:
            step, moved = sample.time - self._joints, np.abs(sample.joint_position - last.joint_position)
            self._check_jump(sample.time, moved, step)
            self._since += step
            self._since *= moved == 0
            np.minimum(self._steps, moved, out=self._steps, where=moved > 0)
        if last is not None and new_imu:
            same = all_of(sample.angular_velocity_in_imu == last.angular_velocity_in_imu)
            same = same and all_of(sample.acceleration_in_imu == last.acceleration_in_imu)
            self._imu_since = self._imu_since + imu - self._imu if same else 0.0
        self._last = sample
        self._joints, self._imu = max(self._joints, sample.time), max(self._imu, imu)
        self.counts.fresh += 1
        return True

    def _check_numbers(self, sample: RobotState) -> None:
        joints = (sample.joint_position, sample.joint_velocity, sample.joint_torque)
        imu = (sample.angular_velocity_in_imu, sample.acceleration_in_imu)
        # A sum of squares is finite if all numbers are; the search for the other case is slow.
        squares = 0.0
        for values in (*joints, *imu):
            if values is not None:
                squares += values.dot(values)
        if math.isfinite(squares):
            return
        for sensor, values in zip(("encoder", "velocity", "torque"), joints, strict=True):
            if values is not None and not np.isfinite(values).all():
                joint = self._names[int(np.argmax(~np.isfinite(values)))]
                raise MotionError(f"the {sensor} reading of joint {joint!r} is not finite at t = {sample.time:.3f} s")
        sensor = "gyroscope" if not np.isfinite(sample.angular_velocity_in_imu).all() else "accelerometer"
        raise MotionError(f"the {sensor} reading is not finite at t = {sample.time:.3f} s")

    def _check_jump(self, time: float, moved: FloatArray, step: float) -> None:
        """Raise MotionError if an encoder moves faster than a joint can."""
        wild = moved > _JUMP + self._fastest * step
        if any_of(wild):
            joint = int(np.argmax(moved * wild))
            raise MotionError(
                f"the encoder of joint {self._names[joint]!r} jumped by {moved[joint]:.2f} rad in {step * 1000:.0f} ms at "
                f"t = {time:.3f} s"
            )

    def _check_frozen(self, target: FloatArray) -> None:
        """Raise MotionError if readings do not change while the targets do."""
        self._check_frozen_joints(target)
        if self._imu_since == 0.0 or self._imu_target is None:
            self._moved, self._imu_target = 0.0, target
            return
        self._moved = max(self._moved, float(np.abs(target - self._imu_target).max()))
        if self._imu_since > _FROZEN_TIME and self._moved > _FROZEN_MOVE:
            raise MotionError(
                f"the IMU is frozen: its readings have not changed for {self._imu_since:.2f} s while the robot moved"
            )

    def _check_frozen_joints(self, target: FloatArray) -> None:
        low, high, same = self._sent_low, self._sent_high, self._since > 0
        if not any_of(same):
            low[:] = high[:] = target
            return
        np.copyto(low, np.where(same, np.minimum(low, target), target))
        np.copyto(high, np.where(same, np.maximum(high, target), target))
        frozen = (self._since > _FROZEN_TIME) & (high - low > _FROZEN_MOVE)
        if any_of(frozen) and any_of(frozen := frozen & (high - low > frozen_travel(_FROZEN_MOVE, self._steps))):
            joint = int(np.argmax(frozen))
            raise MotionError(
                f"the encoder of joint {self._names[joint]!r} is frozen: its reading has not changed for "
                f"{self._since[joint]:.2f} s while its target moved by {high[joint] - low[joint]:.2f} rad"
            )

    def _complain(self) -> None:
        time = f"for {max(self._joints_without, self._imu_without) * 1000:.0f} ms"
        if self._joints_without <= self._silence:
            raise CommunicationError(f"no IMU sample has arrived {time}; joint samples have")
        if self._why == "missing":
            raise CommunicationError(
                f"no sample has arrived {time}: is the robot still on, and is the cable plugged in?"
            )
        fault = "samples are repeated" if self._why == "repeated" else "samples arrive out of order"
        raise MotionError(f"{fault}: no fresh sample {time}")
