"""ROS 2 stacks that take gains, and known stacks by name: against a simulated robot in a process of its own."""

import time
from dataclasses import replace

import numpy as np
import pytest
from emulator_processes import running_emulator, unused_domain

pytest.importorskip("cyclonedds")

from equipoise import nominal_stance, simulate
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.ros2 import driver
from equipoise.drivers.ros2.command_topics import controllers_of
from equipoise.drivers.ros2.driver import open_connection
from equipoise.drivers.ros2.ros2_settings import IMPEDANCE, STACKS, Ros2Settings
from equipoise.drivers.ros2.ros_messages import Float64MultiArray, encoded_array
from equipoise.errors import CommunicationError, MotionError, SettingsError
from equipoise.guard.guard import Guard
from equipoise.lab.emulators import ros2 as emulator
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand, Trajectory
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.statics import static_torques

STACK = "quadruped_ros2_control"
BY_JOINT = "/{joint}_controller/commands"
QUICK = ("--sim-preset", "ideal", "--stack", STACK)


def connected(robot, domain, **settings):
    return HardwarePlatform(open_connection(robot, Ros2Settings(**{"domain": domain, "stack": STACK, **settings})))


def stepped(platform, command, seconds):
    """The state after a command that is sent for so much of the robot's time."""
    state = platform.read()
    until = state.time + seconds
    while state.time < until:
        state = platform.step(command)
    return state


def encoded(robot, command, **settings):
    """Return the values of a command by topic, in the order of sending."""
    messages = controllers_of(robot, Ros2Settings(stack=STACK, **settings)).encode(command)
    return {topic: Float64MultiArray.deserialize(bytes(message.data)).data for topic, message in messages.items()}


def test_an_array_is_to_the_byte_what_cyclonedds_makes_of_it():
    for values in ([1.5], [0.1, -2.0, 3e300]):
        assert encoded_array(values).data == bytes(Float64MultiArray(data=values).serialize())


def test_each_interface_receives_all_joints_in_the_controllers_order_and_stiffness_last(a1):
    order = a1.joint_names[::-1]
    rows = np.arange(60.0).reshape(5, 12)
    got = encoded(a1, JointCommand(*rows), joint_order=order)
    assert list(got) == [f"/{name}_controller/commands" for name in IMPEDANCE]
    assert list(got.values()) == rows[:, ::-1].tolist()


def test_each_joint_receives_all_interfaces(a1):
    rows = np.arange(60.0).reshape(5, 12)
    got = encoded(a1, JointCommand(*rows), command_topic=BY_JOINT)
    assert got == {f"/{name}_controller/commands": rows[:, j].tolist() for j, name in enumerate(a1.joint_names)}


def test_what_a_command_leaves_out_is_nothing_but_gains_which_are_the_models(a1):
    got = encoded(a1, JointCommand(np.ones(12)))
    values = dict(zip(IMPEDANCE, got.values(), strict=True))
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    assert values["velocity"] == values["effort"] == 12 * [0.0]
    assert (values["kp"], values["kd"]) == (12 * [kp], 12 * [kd])


def test_joints_that_go_limp_keep_the_position_that_they_were_sent_last(a1):
    """A watchdog knows none, and topics overtake each other: stiffness would pull them there for a moment."""
    zeros = np.zeros(12)
    assert "/position_controller/commands" not in encoded(a1, JointCommand(zeros, kp=zeros))


def test_a_stack_fills_in_empty_settings_only():
    assert Ros2Settings(stack=STACK).imu_topic == "/imu_sensor_broadcaster/imu"
    assert Ros2Settings(stack=STACK, imu_topic="/imu/data").imu_topic == "/imu/data"
    assert (Ros2Settings().imu_topic, Ros2Settings().command_type) == ("/imu/data", "float64_multi_array")
    with pytest.raises(SettingsError, match=f"stack is 'chmp'; it must be one of {', '.join(STACKS)}, or empty"):
        Ros2Settings(stack="chmp")


@pytest.mark.parametrize("name", STACKS)
def test_the_simulated_stack_has_the_topics_that_the_driver_sends_to(name):
    settings, simulated = Ros2Settings(stack=name), emulator.Ros2Options(stack=name).as_stack()
    assert settings.imu_topic == simulated.imu_topic
    assert settings.commands_to == (simulated.impedance_topic or simulated.trajectory_topic)
    assert settings.stiffness == simulated.stiffness


@pytest.mark.parametrize("pattern", ["/commands", "/{joint}/{interface}"])
def test_topics_of_impedance_are_named_by_interface_or_joint(pattern):
    with pytest.raises(SettingsError, match=r"for impedance it must contain either '\{interface\}' or '\{joint\}'"):
        Ros2Settings(stack=STACK, command_topic=pattern)


@pytest.mark.realtime
@pytest.mark.parametrize("pattern", ["", BY_JOINT])
def test_all_of_a_command_moves_the_robot_as_the_direct_simulation(a1, pattern):
    """Soft gains and the torques that hold the robot: each interface matters."""
    domain, target = unused_domain(), nominal_stance(a1).joint_position
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    command = JointCommand(
        target, np.zeros(12), static_torques(a1, target, LEG_NAMES), np.full(12, 0.5 * kp), np.full(12, 2 * kd)
    )
    with simulate(a1, "ideal") as simulation:
        direct = stepped(simulation.platform, command, 1.0)
    flags = ("--permute", "3", *(("--impedance-topic", pattern) if pattern else ()))
    with running_emulator("ros2", "--domain", domain, *QUICK, *flags) as robot:
        order = tuple(robot.wait_for("controlled")["controlled"])
        with connected(a1, domain, command_topic=pattern, joint_order=order) as platform:
            assert platform.accepts == ACCEPTS_EVERYTHING
            measured = stepped(platform, command, 1.0)
            np.testing.assert_allclose(measured.joint_position, direct.joint_position, atol=3e-3)
            np.testing.assert_allclose(measured.joint_torque, direct.joint_torque, atol=0.4)
        assert robot.wait_for("mode", "released")


@pytest.mark.realtime
def test_the_doctor_reports_a_limp_robot_under_position_control_and_missing_controllers(a1, monkeypatch):
    monkeypatch.setattr(driver, "_PATIENCE", 1.0)
    domain = unused_domain()
    with running_emulator("ros2", "--domain", domain, *QUICK, "--start", "lying", "--unloaded", "kd") as robot:

        def found(**settings):
            with connected(a1, domain, **settings) as platform:
                platform.read()
                time.sleep(0.3)
                return {one.name: one for one in platform.check_takeover()}

        gains = found()
        assert gains["controllers"].fine is False
        assert "no controller subscribes to /kd_controller/commands; calibrate will fail" in gains["controllers"].value
        assert gains["stiffness"].fine
        positions = found(command_type="float64_multi_array", command_topic="/position_controller/commands")
        assert positions["controllers"].fine
        assert positions["stiffness"].fine is False
        assert "command_type=impedance" in positions["stiffness"].advice
        with (
            connected(a1, domain) as platform,
            pytest.raises(CommunicationError, match="no controller subscribes to /kd_controller/commands in ros2"),
        ):
            platform.step(JointCommand(platform.read().joint_position))
        assert not any("commanded" in line for line in robot.log)


@pytest.mark.realtime
def test_gains_that_are_never_taken_end_the_first_motion(a1):
    """A loaded, inactive controller subscribes: only the joints show that it does not act."""
    domain = unused_domain()
    with running_emulator("ros2", "--domain", domain, *QUICK, "--start", "lying", "--idle", "kp"):
        time.sleep(1.2)  # limp as it is, it sinks
        platform, stance = connected(a1, domain), nominal_stance(a1).joint_position
        with Guard(platform, a1) as guard:
            here = np.clip(guard.read().joint_position, a1.lower_limit, a1.upper_limit)
            motion = Trajectory(here + np.linspace(0, 0.5, 500)[:, None] * (stance - here))
            # Legs that sank may lie across each other: then the way up is refused before that.
            with pytest.raises(MotionError, match=r"does it use the commanded gains|would touch link"):
                guard.play(motion)


def test_a_trajectory_controllers_integral_grows_to_its_limit(a1):
    wire = emulator.Ros2Wire(a1, emulator.Ros2Options(stack="champ", domain=unused_domain()), lambda **_: None)
    wire._target = np.ones(12)
    try:
        with simulate(a1, "ideal") as simulation:
            state = simulation.platform.read()
            error = 1.0 - state.joint_position
            wire.commands()
            for moment, expected in ((1.0, 0.2 * error), (1e6, 2.5 * np.sign(error))):
                wire.publish(replace(state, time=moment), 0)
                [command] = wire.commands()
                np.testing.assert_allclose(command.torque, expected, atol=1e-9)
    finally:
        wire.close()
