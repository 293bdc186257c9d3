"""Settings of the connection to a ROS 2 robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

from equipoise.errors import SettingsError

IMPEDANCE = ("position", "velocity", "effort", "kp", "kd")
"""Command interfaces of a joint under impedance control, as ros2_control names them, in the order of the messages."""
# Default topic and rate [Hz] of each type of command: a trajectory costs its controller more.
_USUAL = {
    "float64_multi_array": ("/forward_position_controller/commands", 500.0),
    "joint_trajectory": ("/joint_trajectory_controller/joint_trajectory", 100.0),
    "impedance": ("/{interface}_controller/commands", 500.0),
}
_TRAJECTORIES_TO_TORQUES = {
    "command_type": "joint_trajectory",
    "command_topic": "/joint_group_effort_controller/joint_trajectory",
    "stiffness": 100.0,
}
STACKS: dict[str, dict[str, str | float]] = {
    "champ": _TRAJECTORIES_TO_TORQUES,
    "unitree-go2-ros2": _TRAJECTORIES_TO_TORQUES,
    "quadruped_ros2_control": {"command_type": "impedance", "imu_topic": "/imu_sensor_broadcaster/imu"},
}
"""Settings of public software for quadrupeds, from their files of 2026; used for settings that are left out."""
_ELSE: dict[str, str | float] = {"command_type": "float64_multi_array", "imu_topic": "/imu/data"}
_STAMPS = ("header", "arrival")


@dataclass(frozen=True)
class Ros2Settings:
    """Settings of the connection to a ROS 2 robot.

    Attributes:
        interface: network interface of this computer; "lo" limits ROS to this computer (docs/hardware/ros2.md).
        domain: number of the robot's domain, its ROS_DOMAIN_ID.
        peers: addresses for discovery of the robot, in addition to multicast.
        accept_cyclonedds: version of cyclonedds to use although robots, or others on the domain, run another.
        stack: name of the robot's software, "champ", "unitree-go2-ros2" or "quadruped_ros2_control"; its files then give
            the settings below that are empty or zero.
        joint_state_topic: topic of sensor_msgs/JointState.
        imu_topic: topic of sensor_msgs/Imu, with Gazebo often "/imu"; empty: "/imu/data".
        command_type: kind of command, "float64_multi_array" (positions), "joint_trajectory" or "impedance" (positions,
            velocities, efforts, kp and kd); empty: positions.
        command_topic: topic of commands; empty: the default name of such a controller. For impedance a pattern of topics:
            "{interface}" stands for the command interface of a controller for all joints, "{joint}" for the joint of a
            controller for all of its interfaces.
        joint_order: joint names in the controllers' order; empty: the model's order. A trajectory names its joints.
        command_rate: rate of commands [Hz]; 0: 500 commands or 100 trajectories a second.
        time_from_start: time of the one point of a trajectory [s]; 0: at once, as a forwarding controller.
        stiffness: stiffness of a soft position controller [Nm/rad], to convert feed-forward torques to position offsets;
            0: the controller is stiff, and torques are ignored.
        stamps: source of times, "header": the robot's, which are a simulation's in Gazebo; "arrival": this computer's.
    """

    interface: str = "lo"
    domain: int = 0
    peers: tuple[str, ...] = ()
    accept_cyclonedds: str = ""
    stack: str = ""
    joint_state_topic: str = "/joint_states"
    imu_topic: str = ""
    command_type: str = ""
    command_topic: str = ""
    joint_order: tuple[str, ...] = ()
    command_rate: float = 0.0
    time_from_start: float = 0.0
    stiffness: float = 0.0
    stamps: str = "header"

    def __post_init__(self) -> None:
        self._fill_in()
        for name, values in (("command_type", tuple(_USUAL)), ("stamps", _STAMPS)):
            if getattr(self, name) not in values:
                raise SettingsError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(values)}")
        for name in ("command_rate", "time_from_start", "stiffness"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise SettingsError(f"{name} is {getattr(self, name)}; it must be a finite number, zero or more")
        for name in ("joint_state_topic", "imu_topic", "command_topic"):
            topic = getattr(self, name)
            if not topic.startswith("/") and (topic or name != "command_topic"):
                raise SettingsError(f"{name} is {topic!r}; it must begin with '/', as in '/joint_states'")
        if self.command_type == "impedance" and ("{interface}" in self.commands_to) == ("{joint}" in self.commands_to):
            raise SettingsError(
                f"command_topic is {self.command_topic!r}; for impedance it must contain either '{{interface}}' or "
                "'{joint}', as in '/{interface}_controller/commands'"
            )

    @property
    def commands_to(self) -> str:
        """Topic of the commands; for impedance the pattern of its topics."""
        return self.command_topic or _USUAL[self.command_type][0]

    @property
    def rate(self) -> float:
        """Rate of commands [Hz]."""
        return self.command_rate or _USUAL[self.command_type][1]

    def _fill_in(self) -> None:
        """Fill in empty settings from the stack's."""
        if self.stack and self.stack not in STACKS:
            raise SettingsError(f"stack is {self.stack!r}; it must be one of {', '.join(STACKS)}, or empty")
        for name, value in {**_ELSE, **STACKS.get(self.stack, {})}.items():
            object.__setattr__(self, name, getattr(self, name) or value)
