"""Settings of each emulator, without the packages that its protocol needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from equipoise.drivers.platform_settings import check_range
from equipoise.drivers.unitree.udp_settings import Protocol
from equipoise.errors import SettingsError
from equipoise.lab.emulators.emulated_robot import EmulatorSettings

_TRAJECTORIES_TO_TORQUES: dict[str, Any] = {
    "trajectory_topic": "/joint_group_effort_controller/joint_trajectory",
    "stiffness": 100.0, "damping": 1.0, "integral": 0.2, "most_integral": 2.5, "joint_rate": 250.0,
}  # fmt: skip
_STACKS: dict[str, dict[str, Any]] = {
    "champ": {**_TRAJECTORIES_TO_TORQUES, "imu_rate": 50.0},
    "unitree-go2-ros2": {**_TRAJECTORIES_TO_TORQUES, "imu_rate": 100.0},
    "quadruped_ros2_control": {
        "impedance_topic": "/{interface}_controller/commands", "imu_topic": "/imu_sensor_broadcaster/imu",
    },
}  # fmt: skip
"""Settings of public simulations, from their files; the last one uses the controllers of docs/hardware/ros2.md instead."""


@dataclass(frozen=True)
class UnitreeDdsOptions(EmulatorSettings):
    """Emulate a Go2 or B2 on DDS; log one JSON object per line.

    Attributes:
        domain: number of the DDS domain, on "lo".
        sport_mode: the robot's own controller, which holds the motors at the beginning.
        first_tick: first count of its clock [ms], which wraps at 2^32.
        bare: zero ticks and checksums and no motion_switcher service, as in the public simulator.
    """

    start: Literal["standing", "lying"] = "lying"
    domain: int = 1
    sport_mode: bool = True
    first_tick: int = 1_000_000
    bare: bool = False

    def __post_init__(self) -> None:
        check_range(self, "domain", 0, 232)


@dataclass(frozen=True)
class UnitreeUdpOptions(EmulatorSettings):
    """Emulate an A1 or Go1 on UDP; log one JSON object per line.

    Attributes:
        protocol: robot of the protocol.
        address: address of its socket.
        port: port of its socket.
        form: packet format; default: the most likely one.
        first_tick: first count of its clock, which wraps at 2^32.
        tick: time step of its clock [s]; 0 stops the clock.
        loss: share of packets that the network loses, in both directions.
        duplicate: share of packets that arrive twice.
        reorder: share of packets that others overtake.
        network_seed: seed of the network's faults.
    """

    protocol: Protocol = "a1"
    address: str = "127.0.0.1"
    port: int = 8007
    form: str | None = None
    first_tick: int = 0
    tick: float = 1e-3
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    network_seed: int = 0

    def __post_init__(self) -> None:
        check_range(self, "port", 1, 65535)
        check_range(self, "tick", 0, math.inf)
        for name in ("loss", "duplicate", "reorder"):
            check_range(self, name, 0, 1)


@dataclass(frozen=True)
class Ros2Options(EmulatorSettings):
    """Emulate a robot with ROS 2 topics; log one JSON object per line.

    Attributes:
        stack: software to emulate: "champ", "unitree-go2-ros2" or "quadruped_ros2_control"; sets the defaults of the other
            settings.
        interface: network interface.
        domain: number of the domain, its ROS_DOMAIN_ID.
        joint_state_topic: topic of the joint states.
        imu_topic: topic of the IMU.
        array_topic: topic of the forwarding controller.
        trajectory_topic: topic of the joint trajectory controller.
        impedance_topic: topics of impedance controllers, with "{interface}" or "{joint}" as a placeholder. Joints are then
            limp until gains arrive, and other topics are ignored. Empty: position control.
        idle: command interfaces with inactive controllers.
        unloaded: command interfaces without a controller.
        stiffness: stiffness of the joints' position control [Nm/rad]; 0: ten times the model's kp.
        damping: damping of the joints' position control [Nm s/rad]; 0: the model's damping ratio.
        integral: integral gain of the joint trajectory controller [Nm/(rad s)].
        most_integral: largest torque of the integral gain [Nm].
        joint_rate: rate of JointState messages [Hz]; at most the simulation's 500.
        imu_rate: rate of Imu messages [Hz]; at most the simulation's 500.
        permute: seed of the orders of joints in messages and controllers; 0: the model's order.
        extra_joints: names of additional published joints, at zero.
        unreported: quantities that the joints do not report: "velocity", "effort", or both.
        clock: clock of the stamps: time since the start of the simulation, or this computer's time of day.
        interpolate_from_desired_state: the joint trajectory controller's parameter of this name.
    """

    stack: Literal["", "champ", "unitree-go2-ros2", "quadruped_ros2_control"] = ""
    interface: str = "lo"
    domain: int = 1
    joint_state_topic: str = "/joint_states"
    imu_topic: str = "/imu/data"
    array_topic: str = "/forward_position_controller/commands"
    trajectory_topic: str = "/joint_trajectory_controller/joint_trajectory"
    impedance_topic: str = ""
    idle: tuple[str, ...] = ()
    unloaded: tuple[str, ...] = ()
    stiffness: float = 0.0
    damping: float = 0.0
    integral: float = 0.0
    most_integral: float = 0.0
    joint_rate: float = 500.0
    imu_rate: float = 500.0
    permute: int = 0
    extra_joints: tuple[str, ...] = ()
    unreported: tuple[Literal["velocity", "effort"], ...] = ()
    clock: Literal["simulation", "day"] = "simulation"
    interpolate_from_desired_state: bool = False

    def __post_init__(self) -> None:
        check_range(self, "domain", 0, 232)
        topic = self.impedance_topic
        if topic and "{interface}" not in topic and "{joint}" not in topic:
            raise SettingsError(f"impedance_topic is {topic!r}; it must contain {{interface}} or {{joint}}")
        for name in ("stiffness", "damping", "integral", "most_integral"):
            check_range(self, name, 0, math.inf)
        for name in ("joint_rate", "imu_rate"):
            check_range(self, name, 1, 500)

    def as_stack(self) -> Ros2Options:
        """Return the settings with the stack's values in place of defaults."""
        plain, stack = Ros2Options(), _STACKS.get(self.stack, {})
        return replace(self, **{name: v for name, v in stack.items() if getattr(self, name) == getattr(plain, name)})
