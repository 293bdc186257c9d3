"""A Go2's link against one standing robot in a process of its own, over DDS on loopback.

Tests without this robot are in test_unitree_dds.py, so that it ends with the last test that needs it.
"""

import signal
import time

import numpy as np
import pytest
from scipy.interpolate import interp1d

pytest.importorskip("cyclonedds")

from dds_robots import connected, excitation, hold, other_commander, running

from equipoise import nominal_stance, simulate
from equipoise.drivers.unitree.low_level import COMMAND
from equipoise.errors import CommunicationError, MotionError, SettingsError
from equipoise.platform.platform import JointCommand, Trajectory

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def standing(tmp_path_factory):
    """It stands, only this process holds its motors, and its clock is about to wrap around."""
    with running(
        tmp_path_factory, "--start", "standing", "--no-sport-mode", "--first-tick", str(2**32 - 2500)
    ) as emulator:
        yield emulator


@pytest.fixture(scope="module")
def linked(standing, a1):
    with connected(standing, a1) as platform:
        yield platform


@pytest.fixture(scope="module")
def target(a1):
    return nominal_stance(a1).joint_position


def test_samples_of_the_standing_robot(linked, a1, target):
    with simulate(a1, "ideal") as simulation:
        direct = simulation.platform.read()
    state = hold(linked, target)
    assert np.allclose(state.joint_position, direct.joint_position, atol=0.01)
    assert np.allclose(state.joint_velocity, 0, atol=0.05)
    assert np.allclose(state.joint_torque, direct.joint_torque, atol=1.0)
    assert np.abs(direct.joint_torque).max() > 3  # so that signs are seen
    assert np.allclose(state.acceleration_in_imu, direct.acceleration_in_imu, atol=0.1)
    assert np.linalg.norm(state.acceleration_in_imu) == pytest.approx(9.81, abs=0.1)
    assert np.allclose(state.angular_velocity_in_imu, 0, atol=0.05)
    later = hold(linked, target)
    assert later.time > state.time
    assert time.monotonic() > later.received > state.received
    assert np.array_equal(state.health.motor_temperature, np.full(12, 40.0))
    assert state.health.battery_voltage == pytest.approx(29.4)
    assert state.health.battery_charge == pytest.approx(0.8)
    assert state.health.fault is None


def test_a_motion_is_the_one_of_the_direct_simulation(linked, a1):
    motion = excitation(a1)
    here = Trajectory(np.repeat(motion.position[:1], 200, axis=0))
    with simulate(a1, "ideal") as simulation:
        simulation.platform.play(here)
        direct = simulation.platform.play(motion)
    linked.play(here)
    recording = linked.play(motion)
    position, torque, turning, pushed = alike(recording, direct)
    assert (position < 0.015, torque < 1.5, turning > 0.9, pushed > 0.9) == 4 * (True,), (
        position,
        torque,
        turning,
        pushed,
    )
    steps = np.diff(recording.joints.time) / 2e-3
    assert np.allclose(steps, np.round(steps), atol=1e-3)  # by its clock, whatever arrived when
    assert np.median(steps) == pytest.approx(1)


def alike(linked, direct):
    """Median differences of joint positions and torques, and correlations of the IMU's readings about and along x and y.

    Moments are those when the commands were sent, and the link's delay later that fits best: 4 ms, more on a busy machine.
    """
    return min((alike_after(linked, direct, delay) for delay in np.arange(0, 0.05, 2e-3)), key=lambda found: found[0])


def alike_after(linked, direct, delay):
    at = linked.commands.time + delay
    pairs = [
        (interp1d(stream.time, getattr(stream, name), axis=0, fill_value="extrapolate")(at), getattr(other, name))
        for stream, other, names in (
            (linked.joints, direct.joints, ("position", "torque")),
            (linked.imu, direct.imu, ("angular_velocity_in_imu", "acceleration_in_imu")),
        )
        for name in names
    ]
    apart = [float(np.median(np.abs(one - other))) for one, other in pairs[:2]]
    correlation = [min(np.corrcoef(one[:, axis], other[:, axis])[0, 1] for axis in (0, 1)) for one, other in pairs[2:]]
    return *apart, *correlation


def test_gains_and_feed_forward_arrive(standing, linked, a1, target):
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    ones, order = np.ones(12), np.arange(12)
    hold(linked, target, 0.1)
    assert [standing.logged("kp")[-1], standing.logged("kd")[-1]] == pytest.approx([kp, kd], abs=1e-3)
    for pushed in ({"torque": 0.05 * kp * ones}, {"velocity": 0.05 * kp / kd * ones}):  # as a target further on
        before = hold(linked, target).joint_position
        moved = hold(linked, target, **pushed).joint_position - before
        assert 0.02 < moved.mean() < 0.15
    hold(linked, target, 0.1, kp=80 + order, kd=2.5 * ones)
    standing.wait_for(kp=85.5, kd=2.5)
    hold(linked, target)


def test_damaged_commands_are_ignored(standing, linked, target):
    hold(linked, target, 0.1)
    link = linked._connection
    link._record["motor_cmd"]["q"][:12] += 0.5
    data = COMMAND.encoded(link._record)
    damaged = link._sample(data[:-1] + bytes([data[-1] ^ 1]))
    for _ in range(30):
        link._commands.send(damaged)
        time.sleep(2e-3)
    standing.wait_for(ignored="damaged")
    assert np.allclose(linked.read().joint_position, target, atol=0.15)


def test_a_silent_robot_is_noticed(standing, linked, target):
    hold(linked, target, 0.1)
    standing.process.send_signal(signal.SIGSTOP)
    try:
        with pytest.raises(CommunicationError, match=r"unitree-go2 on lo has been silent for 0\.\d s"):
            hold(linked, target, 5)
    finally:
        standing.process.send_signal(signal.SIGCONT)
    time.sleep(0.2)
    assert hold(linked, target, 0.1).joint_position.shape == (12,)


def test_commands_for_another_number_of_joints_are_refused(linked, target):
    hold(linked, target, 0.1)
    with pytest.raises(SettingsError, match="commands for 3 joints; unitree-go2 on lo has 12"):
        linked.step(JointCommand(np.zeros(3)))


def keep_commanding(link, position, duration):
    """Send and receive for a while [s]."""
    until = time.monotonic() + duration
    while time.monotonic() < until:
        link.send(JointCommand(position))
        link.receive()
        time.sleep(2e-3)


def test_a_commander_that_begins_in_mid_run_is_noticed_at_once_and_named(standing, linked, target):
    hold(linked, target, 0.1)
    link = linked._connection
    with other_commander(standing) as (command, process):
        keep_commanding(link, target, 0.2)
        command()
        begun = time.monotonic()
        with pytest.raises(MotionError, match=f"process {process.pid} on .* sent .* commands on rt/lowcmd") as caught:
            keep_commanding(link, target, 1.0)
        assert caught.value.other_commander
        noticed = time.monotonic() - begun
    assert noticed < 0.05
    time.sleep(0.1)
    link._others.take()
    assert hold(linked, target, 0.2).joint_position.shape == (12,)
