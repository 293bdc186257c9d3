"""Emulator of a robot with ROS 2 topics: joint state broadcaster, IMU broadcaster and controllers.

    equipoise lab emulate ros2 --robot unitree_a1 --domain 1 --stiffness 100 --imu-rate 200 --permute 3
    equipoise lab emulate ros2 --domain 1 --stack quadruped_ros2_control --start lying

ROS is not needed: the process publishes and subscribes as the controllers do. Like them it has no watchdog and holds the last
command.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.ros2.ros_messages import (
    Float64MultiArray,
    Header,
    Imu,
    JointState,
    JointTrajectory,
    Quaternion,
    Time,
    Vector3,
    dds_topic,
)
from equipoise.lab.emulators.faults import ActiveFaults
from equipoise.lab.emulators.options import Ros2Options
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_STIFF = 10.0  # default stiffness over the model's kp
_INTERFACES = ("position", "velocity", "effort", "kp", "kd")


class Impedance:
    """Command interfaces of hardware with gains: each keeps the last value, initially zero.

    Args:
        domain: domain of the topics.
        options: topics and states of the controllers.
        controlled: names of joints in the controllers' order.
        order: (nj,) index of each of the model's joints in `controlled`.
        hold: initial values by interface; empty: none.
    """

    def __init__(
        self,
        domain: DdsDomain,
        options: Ros2Options,
        controlled: list[str],
        order: NDArray[np.intp],
        hold: dict[str, FloatArray],
    ) -> None:
        pattern, self._order = options.impedance_topic, order
        self._active = [row for row, name in enumerate(_INTERFACES) if name not in options.idle]
        self._values = np.zeros((len(_INTERFACES), len(controlled)))  # in the controllers' order
        for name, values in hold.items():
            self._values[_INTERFACES.index(name), order] = values
        if "{interface}" in pattern:
            rows = {name: (row, slice(None)) for row, name in enumerate(_INTERFACES) if name not in options.unloaded}
            places, mark = rows, "{interface}"
        else:
            places, mark = {name: (slice(None), place) for place, name in enumerate(controlled)}, "{joint}"
        self._inboxes = [
            (domain.inbox(dds_topic(pattern.replace(mark, name)), Float64MultiArray), place)
            for name, place in places.items()
        ]

    def take(self, accept: Callable[[bool], bool]) -> None:
        """Process the messages that arrived. `accept` is called with true for messages of the right size."""
        for inbox, place in self._inboxes:
            for _, message in inbox.take():
                if accept(len(message.data) == self._values[place].size):
                    values = self._values.copy()
                    values[place] = message.data
                    self._values[self._active] = values[self._active]

    def command(self) -> JointCommand:
        return JointCommand(*self._values[:, self._order])


class Ros2Wire:
    """Robot side: broadcasters and controllers of a controller manager.

    Args:
        robot: model of the simulated robot.
        options: topics and controllers.
        log: function that logs an entry.
    """

    def __init__(self, robot: RobotModel, options: Ros2Options, log: Callable[..., None]) -> None:
        self._names, self._log = robot.joint_names, log
        self._options = options = options.as_stack()
        gains = _gains(robot, options)
        self._kp, self._kd = (np.full(len(self._names), gain) for gain in gains)
        self._target = nominal_stance(robot).joint_position if options.start == "standing" else None
        published = list(self._names + options.extra_joints)
        controlled = list(self._names)
        if options.permute:
            draw = np.random.default_rng(options.permute)
            draw.shuffle(published)
            draw.shuffle(controlled)
        self._published, self._controlled = published, controlled
        self._day = time.time_ns() if options.clock == "day" else 0
        self._state: RobotState | None = None
        self._trajectory: tuple[FloatArray, FloatArray] | None = None  # times and positions of its points
        self.received = self.refused = 0
        domain = self._domain = DdsDomain(options.domain, options.interface)
        self._integral_torque, self._integrated_at = np.zeros(len(self._names)), 0.0
        self._impedance: Impedance | None = None
        if options.impedance_topic:
            held = {} if self._target is None else {"position": self._target, "kp": self._kp, "kd": self._kd}
            order = np.array([controlled.index(name) for name in self._names])
            self._impedance = Impedance(domain, options, controlled, order, held)
        else:
            self._arrays = domain.inbox(dds_topic(options.array_topic), Float64MultiArray)
            self._trajectories = domain.inbox(dds_topic(options.trajectory_topic), JointTrajectory)
        self._joint_box = domain.outbox(dds_topic(options.joint_state_topic), JointState)
        self._imu_box = domain.outbox(dds_topic(options.imu_topic), Imu)
        log(published=published, controlled=controlled, kp=gains[0], kd=gains[1])

    def commands(self) -> list[JointCommand]:
        """Return the command of the controllers, which they repeat in every period."""
        if self._impedance is not None:
            self._impedance.take(self._accept)
            return [self._impedance.command()]
        for _, array in self._arrays.take():
            self._take_array(array)
        for _, trajectory in self._trajectories.take():
            self._take_trajectory(trajectory)
        if self._trajectory is not None and self._state is not None:
            self._target = interpolated(self._state.time, *self._trajectory)
        return [] if self._target is None else [self._towards(self._target)]

    def publish(self, state: RobotState, faults: ActiveFaults) -> None:
        del faults  # messages have neither keys nor checksums
        before, self._state = (-1.0 if self._state is None else self._state.time), state
        if _due(before, state.time, self._options.joint_rate):
            self._joint_box.send(self._joint_state(state))
        if _due(before, state.time, self._options.imu_rate):
            self._imu_box.send(self._imu(state))

    def close(self) -> None:
        self._log(received=self.received, refused=self.refused)
        self._domain.close()

    def _accept(self, whether: bool) -> bool:
        """Count a command, and log the first."""
        self.refused += not whether
        self.received += whether
        if whether and self.received == 1:
            self._log(commanded=True)
        return whether

    def _towards(self, target: FloatArray) -> JointCommand:
        if self._options.integral and self._state is not None:
            step, self._integrated_at = self._state.time - self._integrated_at, self._state.time
            torque = self._integral_torque + self._options.integral * step * (target - self._state.joint_position)
            limit = self._options.most_integral
            self._integral_torque = np.clip(torque, -limit, limit)
        return JointCommand(target, torque=self._integral_torque, kp=self._kp, kd=self._kd)

    def _take_array(self, message: Any) -> None:
        if not self._accept(len(message.data) == len(self._controlled)):
            return
        self._trajectory = None
        self._target = self._in_model_order(self._controlled, message.data)

    def _take_trajectory(self, message: Any) -> None:
        """Process a trajectory of all joints that begins at once. Other trajectories are not emulated."""
        all_joints = set(message.joint_names) == set(self._names)
        if not self._accept(all_joints and bool(message.points)) or self._state is None:
            return
        starts = [point.time_from_start for point in message.points]
        times = self._state.time + np.array([0.0, *(start.sec + 1e-9 * start.nanosec for start in starts)])
        positions = [self._in_model_order(message.joint_names, point.positions) for point in message.points]
        desired = self._target if self._options.interpolate_from_desired_state else None
        start = self._state.joint_position if desired is None else desired
        self._trajectory = times, np.array([start, *positions])

    def _in_model_order(self, names: list[str], values: list[float]) -> FloatArray:
        return np.array([values[names.index(name)] for name in self._names])

    def _joint_state(self, state: RobotState) -> Any:
        velocity = None if "velocity" in self._options.unreported else state.joint_velocity
        torque = None if "effort" in self._options.unreported else state.joint_torque
        return JointState(
            self._header(state, ""),
            self._published,
            self._as_published(state.joint_position),
            [] if velocity is None else self._as_published(velocity),
            [] if torque is None else self._as_published(torque),
        )

    def _as_published(self, values: FloatArray) -> list[float]:
        by_name = dict(zip(self._names, values.tolist(), strict=True))
        return [by_name.get(name, 0.0) for name in self._published]

    def _imu(self, state: RobotState) -> Any:
        unavailable = [-1.0] + 8 * [0.0]  # there is no orientation filter
        return Imu(
            self._header(state, "imu_link"),
            Quaternion(w=1.0),
            unavailable,
            Vector3(*state.angular_velocity_in_imu.tolist()),
            linear_acceleration=Vector3(*state.acceleration_in_imu.tolist()),
        )

    def _header(self, state: RobotState, frame: str) -> Any:
        return Header(Time(*divmod(self._day + round(1e9 * state.time), 10**9)), frame)


def _due(before: float, now: float, rate: float) -> bool:
    """Return true if an event of a given rate [Hz] is due between two times [s]."""
    return np.floor(now * rate + 1e-6) > np.floor(before * rate + 1e-6)


def interpolated(now: float, times: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the (nj,) targets of a trajectory at a robot time [rad]: after the last point, those of the last point.

    Args:
        times: (n,) increasing robot times of its points [s].
        positions: (n, nj) joint positions at its points [rad].
    """
    joints = range(positions.shape[1])
    return np.array([np.interp(now, times, positions[:, joint]) for joint in joints])


def _gains(robot: RobotModel, options: Ros2Options) -> tuple[float, float]:
    """Return kp and kd of the position control, the same for all joints."""
    kp, kd = robot.gains(nominal_stance(robot).hip_height)
    stiffness = options.stiffness or (kp if options.impedance_topic else _STIFF * kp)
    return stiffness, options.damping or kd * float(np.sqrt(stiffness / kp))  # the same damping ratio
