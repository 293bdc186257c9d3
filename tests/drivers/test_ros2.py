"""The ROS 2 driver against a simulated robot in a process of its own, over DDS on loopback."""

import json
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from emulator_processes import EmulatorProcess, running_emulator, unused_domain

pytest.importorskip("cyclonedds")

from equipoise import nominal_stance, simulate
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.ros2 import driver as ros2
from equipoise.drivers.ros2.driver import open_connection
from equipoise.drivers.ros2.ros2_settings import Ros2Settings
from equipoise.errors import CommunicationError, SettingsError
from equipoise.lab.emulators.ros2 import interpolated
from equipoise.platform.platform import JointCommand, Trajectory
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.statics import static_torques

pytestmark = pytest.mark.realtime
DOMAIN, EMPTY_DOMAIN = unused_domain(), unused_domain()
STIFFNESS = 120.0  # [Nm/rad] soft: legs sag by several hundredths of a radian
PATIENCE = 60.0  # [s] for a busy machine


class Peer:
    """A process and its log."""

    def __init__(self, *flags):
        command = [
            sys.executable,
            "-m",
            "equipoise",
            "lab",
            "emulate",
            "ros2",
            "--domain",
            str(DOMAIN),
            "--sim-preset",
            "ideal",
            *flags,
        ]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.entries = []
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        self.wait_for("ready")

    def _listen(self):
        for line in self.process.stdout:
            self.entries.append(json.loads(line))

    def wait_for(self, key):
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and self.process.poll() is None:
            if found := [line for line in list(self.entries) if key in line]:
                return found[-1][key]
            time.sleep(0.01)
        raise AssertionError(f"the emulator never logged {key}: {self.entries}")

    def end(self):
        self.process.kill()
        self.process.wait(timeout=PATIENCE)
        self._listener.join(PATIENCE)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def emulator():
    """Joints in an order of its own, an arm's among them, and an IMU that is slower than the joints."""
    running = Peer("--stiffness", str(STIFFNESS), "--permute", "3", "--extra-joints", "arm_joint", "--imu-rate", "200")
    yield running
    running.end()


@pytest.fixture
def connect(emulator, a1):
    """Makes platforms, one at a time as a domain is opened once in a process, and closes them after the test."""
    made = []

    def make(robot=a1, **settings):
        for platform in made:
            platform.close()
        order = tuple(emulator.wait_for("controlled"))
        known = {"domain": DOMAIN, "joint_order": order if robot is a1 else (), **settings}
        made.append(HardwarePlatform(open_connection(robot, Ros2Settings(**known))))
        return made[-1]

    yield make
    for platform in made:
        platform.close()


def hold(platform, target, seconds, torque=None):
    """Send one command for so much of the robot's time; the last state."""
    return samples(platform, target, seconds, torque)[-1]


def samples(platform, target, seconds, torque=None):
    """All states meanwhile, oldest first."""
    taken = [platform.read()]
    begin, until = taken[0].time, time.monotonic() + PATIENCE
    while taken[-1].time < begin + seconds and time.monotonic() < until:
        platform.step(JointCommand(target, torque=torque))
        taken += platform.arrived
    assert taken[-1].time >= begin + seconds
    return taken


def test_listening_moves_nothing(emulator, connect, a1):
    """First of all tests: nothing has been commanded yet."""
    platform = connect()
    for _ in range(20):
        state = platform.read()
        time.sleep(0.01)
    platform.close()
    time.sleep(0.1)
    assert not any("commanded" in line for line in emulator.entries)
    assert np.abs(state.joint_position - nominal_stance(a1).joint_position).max() < 0.15


def test_a_motion_is_what_the_direct_simulation_makes_of_it(emulator, connect, a1):
    """Before other tests move the feet."""
    stance = nominal_stance(a1).joint_position
    legs = np.tile([0.0, 0.1, -0.2], 4)
    shape = (1 - np.cos(np.linspace(0, np.pi, 250)))[:, None] / 2
    motion = Trajectory(np.vstack([stance + shape * legs, np.repeat((stance + legs)[None], 250, axis=0)]))
    platform = connect()
    hold(platform, stance, 0.5)
    assert emulator.wait_for("commanded")
    platform.play(motion)
    measured = hold(platform, stance + legs, 0.5)
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    gains = {"kp": np.full(12, STIFFNESS), "kd": np.full(12, kd * np.sqrt(STIFFNESS / kp))}
    with simulate(a1, "ideal") as simulation:
        for position in (*np.repeat(stance[None], 250, axis=0), *motion.position):
            direct = simulation.platform.step(JointCommand(position, **gains))
    np.testing.assert_allclose(measured.joint_position, direct.joint_position, atol=5e-3)
    np.testing.assert_allclose(measured.joint_torque, direct.joint_torque, atol=0.7)
    np.testing.assert_allclose(measured.acceleration_in_imu, direct.acceleration_in_imu, atol=0.1)


def test_feed_forward_torque_is_folded_into_the_target_of_a_soft_controller(connect, a1):
    """Before other tests move the feet."""
    target = nominal_stance(a1).joint_position
    torque = static_torques(a1, target, LEG_NAMES)
    knees = [leg.joints[-1] for leg in a1.legs.values()]

    def foot_compliance(platform):
        return np.abs(hold(platform, target, 0.7, torque).joint_position - target)[knees].mean()

    plain = connect()
    assert plain.accepts == frozenset()
    left_aside = foot_compliance(plain)
    folding = connect(stiffness=STIFFNESS)
    assert folding.accepts == {"torque"}
    assert left_aside > 0.03
    assert foot_compliance(folding) < 0.4 * left_aside


def test_joints_and_imu_are_measured_in_the_models_order_and_signs(connect, a1):
    platform = connect()
    target = nominal_stance(a1).joint_position
    state = hold(platform, target, 0.7)
    assert state.joint_position.shape == (12,)
    assert np.abs(state.joint_position - target).max() < 0.15
    # A position controller at rest has no more than its error to make a torque of.
    np.testing.assert_allclose(state.joint_torque, STIFFNESS * (target - state.joint_position), atol=1.5)
    assert np.abs(state.joint_torque).max() > 3
    assert np.abs(state.joint_velocity).max() < 0.2
    assert state.acceleration_in_imu[2] == pytest.approx(9.81, abs=0.3)
    assert np.abs(state.angular_velocity_in_imu).max() < 0.2
    assert state.health is None or "its clock runs" in state.health.fault


def test_joints_and_imu_keep_their_own_times_and_rates(connect):
    platform = connect()
    here = platform.read().joint_position
    recording = platform.play(Trajectory(np.repeat(here[None], 200, axis=0)))
    assert np.median(np.diff(recording.joints.time)) == pytest.approx(2e-3, abs=1e-9)
    assert np.median(np.diff(recording.imu.time)) == pytest.approx(5e-3, abs=1.1e-3)
    assert len(recording.imu.time) < 0.6 * len(recording.joints.time)
    assert (np.diff(recording.imu.time) > 0).all()
    assert len(recording.commands.time) == 200


@pytest.mark.parametrize("joint", [0, 4, 8, 11])
def test_commands_reach_the_joint_that_they_name(connect, a1, joint):
    """By the torque of the step, which no other joint has; how far it has come when is checked on a quiet machine only."""
    platform = connect()
    target = nominal_stance(a1).joint_position.copy()
    before = hold(platform, target, 0.4)
    target[joint] += 0.1
    after = samples(platform, target, 0.1)
    pushed = np.array([state.joint_torque for state in after]) - before.joint_torque
    assert np.argmax(pushed.max(axis=0)) == joint
    assert pushed[:, joint].max() > 0.04 * STIFFNESS
    assert after[-1].joint_position[joint] > before.joint_position[joint] + 0.02


def test_trajectories_command_as_arrays_do(connect, a1):
    platform = connect(command_type="joint_trajectory", joint_order=())
    assert platform.control_period == pytest.approx(0.01)
    target = nominal_stance(a1).joint_position.copy()
    before = hold(platform, target, 0.5).joint_position
    target[5] += 0.1
    moved = hold(platform, target, 0.1).joint_position - before
    assert np.argmax(np.abs(moved)) == 5


def test_a_trajectory_controller_that_starts_where_the_joints_sag_to_holds_them_more_softly(connect, a1):
    """The reason for the default zero of `time_from_start`."""
    target = nominal_stance(a1).joint_position
    knees = [leg.joints[-1] for leg in a1.legs.values()]

    def foot_compliance(time_from_start):
        platform = connect(command_type="joint_trajectory", time_from_start=time_from_start)
        return np.abs(hold(platform, target, 0.8).joint_position - target)[knees].mean()

    at_once, gradually = foot_compliance(0.0), foot_compliance(0.01)
    print(at_once, gradually)
    assert gradually > 1.3 * at_once


def test_times_of_arrival_stand_in_for_stamps(connect):
    platform = connect(stamps="arrival")
    state = platform.read()
    assert abs(state.time - time.monotonic()) < 5
    assert state.received <= state.time


def test_release_lets_the_robot_stay_where_it_is(connect, a1):
    target = nominal_stance(a1).joint_position + 0.05 * np.tile([0, 1, -1], 4)
    platform = connect()
    before = hold(platform, target, 0.5).joint_position
    platform.close()
    platform.close()
    time.sleep(0.5)
    after = connect().read().joint_position
    # A soft controller that is asked for where it sags to sags by as much again.
    assert np.abs(after - before).max() < 0.12


def test_other_joints_than_the_models_are_named(connect, two_jointed, monkeypatch):
    monkeypatch.setattr(ros2, "_PATIENCE", 0.5)
    with pytest.raises(SettingsError, match=r"/joint_states lacks the model's .*it has .*'arm_joint'"):
        connect(two_jointed).read()


def test_a_topic_without_a_publisher_is_named(connect, monkeypatch):
    monkeypatch.setattr(ros2, "_PATIENCE", 2.0)
    with pytest.raises(CommunicationError, match=f"no publisher of Imu on /imu in ros2 domain {DOMAIN} on lo"):
        connect(imu_topic="/imu").read()


def test_an_empty_domain_is_reported(a1, monkeypatch):
    monkeypatch.setattr(ros2, "_PATIENCE", 0.3)
    link = open_connection(a1, Ros2Settings(domain=EMPTY_DOMAIN))
    with (
        HardwarePlatform(link) as platform,
        pytest.raises(
            CommunicationError, match="no publisher of JointState on /joint_states and no publisher of Imu on"
        ),
    ):
        platform.read()


def test_commands_without_subscribers_are_not_sent(connect, monkeypatch):
    platform = connect(command_topic="/no_subscriber/commands")
    here = platform.read().joint_position
    monkeypatch.setattr(ros2, "_PATIENCE", 0.0)
    with pytest.raises(
        CommunicationError,
        match=r"no controller subscribes to /no_subscriber/commands in ros2 domain .* list_controllers",
    ):
        platform.step(JointCommand(here))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"command_type": "velocity"},
            "command_type is 'velocity'; it must be one of float64_multi_array, joint_trajectory",
        ),
        ({"stamps": "now"}, "stamps is 'now'; it must be one of header, arrival"),
        ({"command_rate": -1.0}, r"command_rate is -1\.0; it must be a finite number, zero or more"),
        ({"stiffness": float("nan")}, "stiffness is nan"),
        ({"time_from_start": float("inf")}, "time_from_start is inf"),
        ({"imu_topic": "imu"}, "imu_topic is 'imu'; it must begin with '/'"),
        ({"joint_state_topic": ""}, "joint_state_topic is ''"),
    ],
)
def test_settings_are_checked(wrong, message):
    with pytest.raises(SettingsError, match=message):
        Ros2Settings(**wrong)


def test_defaults_are_the_usual_controllers():
    array, trajectory = Ros2Settings(), Ros2Settings(command_type="joint_trajectory")
    assert (array.commands_to, array.rate) == ("/forward_position_controller/commands", 500)
    assert (trajectory.commands_to, trajectory.rate) == ("/joint_trajectory_controller/joint_trajectory", 100)
    assert Ros2Settings(command_topic="/x", command_rate=250.0).commands_to == "/x"
    assert Ros2Settings(command_rate=250.0).rate == 250


@pytest.mark.parametrize("twice", [False, True])
def test_a_controllers_order_holds_each_joint_once(a1, twice):
    names = (*a1.joint_names, a1.joint_names[0]) if twice else ("knee", *a1.joint_names[1:])
    fault = "a joint is listed twice" if twice else f"'{a1.joint_names[0]}', 'knee' in only one of them"
    with pytest.raises(SettingsError, match=f"joint_order must list each joint of the model once: {fault}"):
        open_connection(a1, Ros2Settings(domain=EMPTY_DOMAIN, joint_order=names))


def test_the_emulators_trajectory_controller_goes_straight_through_the_points():
    line = np.array([10.0, 11.0, 12.0]), np.array([[0.0, 0.0], [1.0, 2.0], [1.0, 0.0]])
    assert interpolated(10.0, *line).tolist() == [0, 0]
    assert interpolated(10.25, *line).tolist() == [0.25, 0.5]
    assert interpolated(11.5, *line).tolist() == [1, 1]
    assert interpolated(99.0, *line).tolist() == [1, 0]
    assert interpolated(10.0, np.array([10.0, 10.0]), np.array([[0.0], [3.0]])).tolist() == [3]


def test_a_robot_that_falls_silent_shows_by_the_age_of_its_samples(emulator, connect):
    """Last: it ends the emulator."""
    platform = connect()
    platform.read()
    emulator.end()
    time.sleep(0.3)
    platform.read()
    state = platform.read()
    assert time.monotonic() - state.received > 0.2


OTHER_JOINTS = """
import sys, time
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.ros2.ros_messages import JointState, dds_topic
domain = DdsDomain(int(sys.argv[1]), "lo")
states = domain.outbox(dds_topic("/joint_states"), JointState)
print('{"ready": true}', flush=True)
while True:
    states.send(JointState(name=["finger"], position=[0.1]))
    time.sleep(2e-3)
"""


def test_two_writers_of_the_models_joints_are_two_robots_and_one_of_other_joints_is_not(a1):
    domain = unused_domain()
    robot = "--domain", domain, "--sim-preset", "ideal"
    with (
        running_emulator("ros2", *robot) as first,
        running_emulator("", domain, code=OTHER_JOINTS),
        HardwarePlatform(open_connection(a1, Ros2Settings(interface="lo", domain=domain))) as platform,
    ):
        for _ in range(100):
            platform.read()
        second, until = EmulatorProcess("ros2", *robot), time.monotonic() + PATIENCE
        try:
            with pytest.raises(CommunicationError, match="two robots write on /") as caught:  # noqa: PT012
                while time.monotonic() < until:
                    platform.read()
        finally:
            second.end()
        assert f"(process {first._process.pid} on " in str(caught.value)
        assert "own ROS_DOMAIN_ID" in str(caught.value)
