"""The A1 and the Go1 over UDP: against a simulated robot in its own process, and against hand-made packets.

A busy machine delays commands and slows the simulated robot down: what is compared does not depend on when it happened.
"""

import dataclasses
import socket
import time
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from peer_processes import free_port, in_real_time, running_peer, stalls_told
from robots import load_text, quadruped_urdf

from equipoise import nominal_stance, simulate
from equipoise.errors import CommunicationError, SettingsError
from equipoise.peers.unitree_udp import FaultyNetwork, NetworkFaults
from equipoise.platforms import unitree_udp
from equipoise.platforms.hardware import HardwarePlatform
from equipoise.platforms.platform import JointCommand, Trajectory
from equipoise.platforms.robot_clock import RobotClock
from equipoise.platforms.unitree_formats import FORMATS, GO1
from equipoise.platforms.unitree_packets import Damage, LowState, StatePacket, read_command
from equipoise.platforms.unitree_udp import UnitreeUdpSettings, open_link
from equipoise.robot.unitree_motors import MOTORS

PROTOCOLS = pytest.mark.parametrize("protocol", list(FORMATS))
FAULTS = ("--loss", 0.02, "--duplicate", 0.02, "--reorder", 0.02)


@contextmanager
def connected(robot, protocol, *flags, silence=5.0):
    """A platform on a simulated robot of its own, without sensor errors, and the robot's process."""
    port = free_port()
    with running_peer("unitree_udp", "--protocol", protocol, "--port", port, "--noise", "ideal", *flags) as peer:
        settings = UnitreeUdpSettings(protocol, "127.0.0.1", port, local_port=free_port(), silence=silence)
        with HardwarePlatform(open_link(robot, settings)) as platform:
            platform.read()
            with stalls_told(platform, peer):
                yield platform, peer


@pytest.fixture(scope="module")
def direct(a1):
    """The state of the same robot without a network between."""
    with simulate(a1, "ideal") as simulation:
        return simulation.platform.read()


class RawRobot:
    """The robot's socket in the tests' hands, and a link to it."""

    def __init__(self, robot, protocol="a1", **changed):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5.0)
        port = self.socket.getsockname()[1]
        self.settings = UnitreeUdpSettings(protocol, "127.0.0.1", port, local_port=free_port(), **changed)
        self.link = open_link(robot, self.settings)
        self.computer = ("127.0.0.1", self.settings.local_port)
        self._packet = StatePacket(FORMATS[protocol])

    def state(self, tick, position=0.0):
        """A sample's bytes."""
        still = np.zeros(MOTORS)
        up = np.array([0.0, 0.0, 9.81])
        return bytes(self._packet.write(LowState(still + position, still, still, still + 30, np.zeros(3), up, tick)))

    def send(self, *packets):
        for packet in packets:
            self.socket.sendto(packet, self.computer)

    def samples(self, count):
        """What the link hands over, until it is so many samples or five seconds have passed."""
        samples, until = [], time.monotonic() + 5.0
        while len(samples) < count and time.monotonic() < until:
            samples += self.link.receive()
            time.sleep(1e-3)
        return samples

    def close(self):
        self.link.close()
        self.socket.close()


@pytest.fixture
def raw(a1):
    """Makes raw robots, and closes them."""
    made = []

    def make(**settings):
        made.append(RawRobot(a1, **settings))
        return made[-1]

    yield make
    for robot in made:
        robot.close()


# --- against the simulated robot


@PROTOCOLS
@in_real_time
def test_the_first_sample_is_that_of_the_same_robot_without_a_network(a1, direct, protocol):
    with connected(a1, protocol, "--first-tick", 2**32 - 20) as (platform, peer):
        state = platform.read()
        assert np.abs(state.joint_position - direct.joint_position).max() < 2e-3
        assert np.abs(state.joint_torque - direct.joint_torque).max() < 0.05
        assert np.abs(state.joint_velocity).max() < 0.02
        assert np.abs(state.angular_velocity).max() < 0.02
        assert np.abs(state.acceleration - direct.acceleration).max() < 0.1
        assert state.acceleration[2] == pytest.approx(9.81, abs=0.1)
        assert (state.health.motor_temperature == 40).all()
        assert state.health.battery_charge == {"a1": None, "go1": 0.8}[protocol]
        samples = [state]
        while samples[-1].time < state.time + 0.2:
            time.sleep(0.01)
            latest = platform.read()
            samples += (*latest.earlier, latest)
        times = np.array([sample.time for sample in samples])
        assert np.diff(times) == pytest.approx(2e-3, abs=1e-6)  # over the counter's end, none lost and none twice
        assert times[-1] > 2**32 * 1e-3
        assert not any("mode" in entry and entry["mode"] != "own stance" for entry in peer.log)


def hold(platform, command, duration):
    """Samples of as much of the robot's time [s] under one command."""
    samples = [platform.read()]
    until = samples[0].time + duration
    while samples[-1].time < until:
        state = platform.step(command)
        samples += [*state.earlier, state]
    return samples


@in_real_time
def test_each_command_reaches_its_own_joint(a1):
    with connected(a1, "a1") as (platform, _):
        home = np.array(nominal_stance(a1).joint_position)
        for joint in range(len(home)):
            before = hold(platform, JointCommand(home), 0.15)[-1].joint_torque
            kick = home.copy()
            kick[joint] += 0.1
            felt = np.array([sample.joint_torque for sample in hold(platform, JointCommand(kick), 0.03)]) - before
            at = np.argmax(np.abs(felt[:, joint]))
            assert np.argmax(np.abs(felt).max(axis=0)) == joint
            assert felt[at, joint] > 5.0  # 0.1 rad times kp, less what the delay takes


@PROTOCOLS
@in_real_time
def test_gains_and_feed_forward_arrive_and_the_end_is_a_release(a1, protocol):
    home = np.array(nominal_stance(a1).joint_position)
    ones = np.ones_like(home)
    command = JointCommand(home, 0.1 * ones, 0.25 * np.arange(len(home)), 60 * ones, 2.5 * ones)
    with simulate(a1, "ideal") as simulation:
        for _ in range(500):
            expected = simulation.platform.step(command)
    with connected(a1, protocol) as (platform, peer):
        assert platform.accepts == {"velocity", "torque", "gains"}
        state = hold(platform, command, 1.0)[-1]
        gains = peer.wait_for("kp")
        assert (gains["kp"], gains["kd"]) == (60.0, 2.5)
        assert np.abs(state.joint_position - expected.joint_position).max() < 5e-3
        assert np.abs(expected.joint_position - home).max() > 0.02
        assert np.abs(state.joint_torque - expected.joint_torque).max() < 0.5
        damped = JointCommand(home, kp=0 * ones, kd=2 * ones)
        hold(platform, damped, 0.02)
    log = peer.end()
    modes = dict.fromkeys(entry["mode"] for entry in log if "mode" in entry)
    assert [mode for mode in modes if mode != "silence"] == ["own stance", "commanded", "damped", "released"]
    assert log[-1]["damaged"] == 0


@PROTOCOLS
@in_real_time
def test_a_motion_is_recorded_as_without_a_network(a1, protocol):
    motion = leaning(a1)
    with simulate(a1, "ideal") as simulation:
        expected = simulation.platform.play(motion)
    with connected(a1, protocol) as (platform, _):
        recording = platform.play(motion)
        assert recording.joint_names == a1.joint_names
        assert np.array_equal(recording.commands.position, motion.position)
        path = expected.joints.position
        aside = [np.abs(path - position).max(axis=1).min() for position in recording.joints.position]
        assert max(aside) < 0.02
        there, expected_there = at_the_end(recording), at_the_end(expected)
        # Feet slip a little, and by how much depends on when exactly they are moved.
        tolerances = {"position": 0.01, "torque": 0.7, "acceleration": 0.1, "turned": 0.02}
        for name, tolerance in tolerances.items():
            assert np.abs(there[name] - expected_there[name]).max() < tolerance, name
        assert np.abs(expected_there["turned"])[:2].min() > 0.03  # it did roll and pitch
        assert np.abs(expected_there["acceleration"])[:2].min() > 0.3


def leaning(robot):
    """Down with the right feet and up with the hind ones, slowly, and a while there."""
    home = np.array(nominal_stance(robot).joint_position)
    lean = {"FL": (0.05, 0.02), "FR": (0.05, -0.1), "RL": (-0.05, 0.1), "RR": (-0.05, 0.02)}
    there = home.copy()
    for leg, (hip, knee) in lean.items():
        there[list(robot.legs[leg].joints)] += [hip, -knee / 2, knee]
    share = np.concatenate([(1 - np.cos(np.linspace(0, np.pi, 500))) / 2, np.ones(300)])
    return Trajectory(home + share[:, None] * (there - home))


def at_the_end(recording):
    """Means over the last tenth of a second, and by how much the gyroscope says that the base has turned."""
    last = recording.between(recording.joints.time[-1] - 0.1, np.inf)
    omega, steps = recording.imu.angular_velocity, np.diff(recording.imu.time)
    return {
        "position": last.joints.position.mean(axis=0),
        "torque": last.joints.torque.mean(axis=0),
        "acceleration": last.imu.acceleration.mean(axis=0),
        "turned": steps @ (omega[1:] + omega[:-1]) / 2,
    }


@in_real_time
def test_over_a_bad_network_every_sample_is_recorded_once_and_in_order(a1):
    with connected(a1, "go1", "--loss", 0.05, "--duplicate", 0.05, "--reorder", 0.05) as (platform, peer):
        home = np.array(nominal_stance(a1).joint_position)
        recording = platform.play(Trajectory(np.repeat(home[None], 1000, axis=0)))
        arrived = platform._link.counts
        steps = np.diff(recording.joints.time)
        assert (steps > 0).all()
        assert np.allclose(steps / 2e-3, np.rint(steps / 2e-3), atol=1e-3)
        taken = steps.sum() / 2e-3
        assert 0.8 * taken < len(steps) < 0.98 * taken
        assert arrived.samples > 1.03 * len(steps)  # the others came twice or late
        assert not arrived.damaged
    assert peer.end()[-1]["damaged"] == 0


def test_a_robot_that_is_switched_off_is_noticed(a1):
    with connected(a1, "a1", silence=0.5) as (platform, peer):
        home = np.array(nominal_stance(a1).joint_position)
        platform.step(JointCommand(home))
        peer.kill()
        with pytest.raises(CommunicationError, match=r"unitree-a1 at 127.0.0.1:\d+ has been silent for 0.\d s"):
            platform.play(Trajectory(np.repeat(home[None], 5000, axis=0)))


# --- against hand-made packets


def test_a_robot_that_is_not_there_is_an_error(a1):
    settings = UnitreeUdpSettings("a1", "127.0.0.1", free_port(), local_port=free_port())
    with (
        HardwarePlatform(open_link(a1, settings), patience=0.2) as platform,
        pytest.raises(CommunicationError, match=r"sent nothing for 0\.2 s"),
    ):
        platform.read()


def test_a_port_that_is_taken_is_an_error(a1, raw):
    robot = raw()
    with pytest.raises(
        CommunicationError, match=f"cannot listen on 0.0.0.0:{robot.settings.local_port}.*another program"
    ):
        open_link(a1, robot.settings)


def test_a_network_without_a_way_to_the_robot_is_an_error(a1):
    link = open_link(a1, UnitreeUdpSettings("a1", "255.255.255.255", local_port=free_port()))
    try:
        with pytest.raises(CommunicationError, match=r"cannot send to unitree-a1 at 255.255.255.255:8007"):
            link.receive()
    finally:
        link.close()


def test_other_legs_are_an_error(tmp_path):
    two_joints = load_text(tmp_path, quadruped_urdf(joints_per_leg=2))
    with pytest.raises(SettingsError, match="unitree-a1 has 12 joints, three a leg; 'robot' has 8"):
        open_link(two_joints, UnitreeUdpSettings())


def test_commands_for_other_joints_are_an_error(raw):
    with pytest.raises(SettingsError, match=r"commands for 3 joints; unitree-a1 at .* has 12"):
        raw().link.send(JointCommand(np.zeros(3)))


@PROTOCOLS
def test_a_robot_is_asked_without_torque_until_it_is_commanded(a1, raw, protocol):
    robot, packets = raw(protocol=protocol), FORMATS[protocol]
    for _ in range(3):
        robot.link.receive()
        time.sleep(2e-3)
    asked = read_command(packets, robot.socket.recv(2048))
    assert not any(getattr(asked, name).any() for name in ("torque", "kp", "kd"))
    robot.link.send(JointCommand(np.arange(float(MOTORS))))
    until = time.monotonic() + 5.0
    while not (sent := read_command(packets, robot.socket.recv(2048))).kp.any():
        assert time.monotonic() < until
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    assert sent.kp == pytest.approx(kp, abs=1 / 32)
    assert sent.kd == pytest.approx(kd, abs=1 / 16)
    assert not sent.velocity.any()
    legs = [a1.legs[name].joints for name in ("FR", "FL", "RR", "RL")]
    assert sent.position.tolist() == np.concatenate(legs).tolist()
    for _ in range(3):
        robot.link.receive()  # asks no more
        time.sleep(2e-3)
    robot.link.release()
    after = [read_command(packets, robot.socket.recv(2048)) for _ in range(5)]
    assert all(np.array_equal(packet.position, asked.position) for packet in after)


def test_samples_come_in_the_order_of_their_arrival_late_and_double_ones_too(raw):
    robot = raw()
    before = time.monotonic()
    robot.send(*[robot.state(tick) for tick in (2, 4, 8, 6, 8)])
    samples = robot.samples(5)
    assert [round(1000 * sample.time) for sample in samples] == [2, 4, 8, 6, 8]
    received = [sample.received for sample in samples]
    assert before <= received[0] <= received[-1] <= time.monotonic()
    assert received == sorted(received)


def test_a_late_sample_is_never_the_newest(a1, raw):
    robot = raw()
    with HardwarePlatform(robot.link) as platform:
        robot.send(*[robot.state(tick, position=tick) for tick in (2, 8, 6)])
        time.sleep(0.1)
        first = platform.read()
        robot.send(robot.state(4, position=4.0))
        time.sleep(0.1)
        second = platform.read()
    for state, earlier in ((first, [2.0, 6.0]), (second, [4.0])):
        assert (state.time, state.joint_position[0]) == (pytest.approx(0.008), 8.0)
        assert [sample.joint_position[0] for sample in state.earlier] == earlier


def test_strangers_and_damaged_packets_are_counted_and_left_out(raw):
    robot = raw()
    good, random = robot.state(2), np.random.default_rng(1)
    other_level = b"\xee" + good[1:]
    flipped = good[:100] + bytes([good[100] ^ 4]) + good[101:]
    rubbish = [random.bytes(size) for size in (0, 1, 730, 1400)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        for packet in (good, *rubbish):
            stranger.sendto(packet, robot.computer)
    robot.send(other_level, flipped, flipped, *rubbish, good)
    assert [sample.time for sample in robot.samples(1)] == [pytest.approx(0.002)]
    counts = robot.link.counts
    assert (counts.samples, counts.strangers, counts.unread) == (1, 5, 0)
    assert counts.damaged == {Damage.HEAD: 1, Damage.CHECKSUM: 2, Damage.LENGTH: 4}


def test_while_commands_are_sent_samples_make_room_for_newer_ones(raw):
    robot = raw()
    for tick in range(0, 2000, 2):
        robot.send(robot.state(tick))
        robot.link.send(JointCommand(np.zeros(MOTORS)))
    samples = robot.samples(512)
    assert [round(1000 * sample.time) for sample in samples] == list(range(2 * (1000 - 512), 2000, 2))
    assert robot.link.counts.unread == 1000 - 512


def test_what_waited_while_nobody_looked_is_no_news_and_no_silence(raw):
    robot = raw(silence=0.15)
    robot.send(robot.state(2))
    assert len(robot.samples(1)) == 1
    robot.send(robot.state(4))
    time.sleep(0.2)
    assert robot.link.receive() == []
    assert robot.link.counts.unread == 1
    robot.send(robot.state(6))
    assert [sample.time for sample in robot.samples(1)] == [pytest.approx(0.006)]


def test_samples_tell_when_they_arrived_not_when_they_were_asked_for(raw):
    robot = raw()
    robot.send(robot.state(2))
    robot.samples(1)
    before, after = [], []
    for tick in (4, 6, 8):
        time.sleep(0.03)
        before.append(time.monotonic())
        robot.send(robot.state(tick))
        after.append(time.monotonic())
    time.sleep(0.03)
    received = np.array([sample.received for sample in robot.samples(3)])
    assert (received > np.array(before) - 1e-3).all()
    assert (received < np.array(after) + 5e-3).all()


def test_a_robot_that_cannot_be_understood_is_told_from_a_silent_one(raw, monkeypatch):
    monkeypatch.setattr(unitree_udp, "_PATIENCE", 0.05)
    robot = raw()
    robot.send(robot.state(2)[:-1], b"\xee" + robot.state(2)[1:])
    time.sleep(0.1)
    with pytest.raises(CommunicationError, match=r"cannot be understood.* 0 good, 1 of wrong length, 1 of wrong head"):
        robot.link.receive()


def test_wrong_checksums_may_be_taken(raw):
    robot = raw(check=False)
    good = robot.state(6)
    robot.send(good[:-1] + bytes([good[-1] ^ 1]))
    assert [sample.time for sample in robot.samples(1)] == [pytest.approx(0.006)]


def test_a_go1_whose_kd_counts_otherwise(raw):
    robot = raw(protocol="go1", kd_counts=32.0, scrambled=False)
    robot.link.send(JointCommand(np.zeros(MOTORS), kd=np.full(MOTORS, 2.0)))
    plain = dataclasses.replace(GO1, scrambled=False)
    assert read_command(plain, robot.socket.recv(2048)).kd.tolist() == [4.0] * MOTORS  # to who counts 16


def test_closing_twice_is_closing(raw):
    link = raw().link
    link.release()
    link.close()
    link.release()
    link.close()


def test_each_robot_has_its_own_local_port():
    assert [UnitreeUdpSettings(protocol).listens_on for protocol in FORMATS] == [8080, 8090]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"protocol": "go2"}, "protocol is 'go2'; it is one of a1, go1"),
        ({"address": "robot"}, "address is 'robot', no IPv4 address"),
        ({"local_address": "::1"}, "local_address is '::1'"),
        ({"port": 0}, "port is 0; it must be from 1 to 65535"),
        ({"local_port": 70000}, "local_port is 70000; it must be from 1 to 65535"),
        ({"tick": -1.0}, "tick is -1.0; it must be from 0 to 1"),
        ({"silence": 0.001}, "silence is 0.001"),
        ({"kd_counts": 0.0}, "kd_counts is 0.0"),
    ],
)
def test_settings_that_cannot_be_are_refused(wrong, message):
    with pytest.raises(SettingsError, match=message):
        UnitreeUdpSettings(**wrong)


# --- the robot's clock


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(-1000, 100_000), max_size=30))
def test_the_clock_unwraps_whatever_order_samples_come_in(first, steps):
    clock, count = RobotClock(1e-3), first
    assert clock.time(first, 0.0) == pytest.approx(first / 1000)
    for step in steps:
        count += step
        assert clock.time(count % 2**32, 0.0) == pytest.approx(count / 1000)


def test_a_clock_in_another_unit_is_noticed():
    clock = RobotClock(1e-3)
    clock.time(10**9, 5.0)
    clock.time(10**9 + 900_000, 5.9)
    with pytest.raises(CommunicationError, match=r"1000 s ahead in 1.0 s.* set tick \(1e-6"):
        clock.time(10**9 + 1_000_000, 6.0)


def test_a_clock_that_stands_still_is_noticed_or_left_aside():
    with pytest.raises(CommunicationError, match=r"0 s ahead in 1\.5 s"):
        [clock.time(7, received) for clock in [RobotClock(1e-3)] for received in (5.0, 6.5)]
    without = RobotClock(0.0)
    assert [without.time(7, received) for received in (5.0, 6.5)] == [5.0, 6.5]


# --- the network of the simulated robot


@given(st.integers(0, 1000), st.sampled_from([0.0, 0.1, 1.0]), st.sampled_from([0.0, 0.2, 1.0]))
def test_a_network_that_mixes_up_and_repeats_loses_nothing(seed, duplicate, reorder):
    network = FaultyNetwork(NetworkFaults(duplicate=duplicate, reorder=reorder, network_seed=seed), 0)
    sent = [bytes([index]) for index in range(100)]
    arrived = [packet for packet in sent for packet in network.carry(packet)]
    assert set(sent[:-4]) <= set(arrived) <= set(sent)
    assert max(arrived.count(packet) for packet in sent) <= 2
    if not reorder:
        assert arrived == sorted(arrived)
    if duplicate == 0:
        assert len(set(arrived)) == len(arrived)
    if duplicate == 1 and not reorder:
        assert len(arrived) == 200


def test_shares_of_packets_are_lost_doubled_and_overtaken():
    faults = NetworkFaults(loss=0.1, duplicate=0.2, reorder=0.3)
    network, sent = FaultyNetwork(faults, 0), [index.to_bytes(2, "big") for index in range(5000)]
    arrived = [packet for packet in sent for packet in network.carry(packet)]
    assert len(set(arrived)) == pytest.approx(0.9 * 5000, rel=0.03)
    assert len(arrived) == pytest.approx(0.9 * 1.2 * 5000, rel=0.03)
    overtaken = sum(packet < max(arrived[:at]) for at, packet in enumerate(arrived) if 0 < at < 2000)
    assert 0.1 < overtaken / 2000 < 0.4
    again = FaultyNetwork(faults, 0)
    assert [packet for packet in sent for packet in again.carry(packet)] == arrived


def test_a_share_is_a_share():
    with pytest.raises(SettingsError, match=r"loss is 1\.5; it is a share"):
        NetworkFaults(loss=1.5)
