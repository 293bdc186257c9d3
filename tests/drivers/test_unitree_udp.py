"""The A1 and the Go1 over UDP: against a simulated robot in its own process, and against hand-made packets.

A busy machine delays commands and slows the simulated robot down: what is compared does not depend on when it happened.
"""

import socket
import sys
import time
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest
from emulator_processes import free_port, logged_modes, running_emulator
from hypothesis import given
from hypothesis import strategies as st
from robots import load_text, quadruped_urdf

from equipoise import nominal_stance, simulate
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.robot_clock import RobotClock, UnitSearch
from equipoise.drivers.unitree import udp as unitree_udp
from equipoise.drivers.unitree.form_search import FormSearch
from equipoise.drivers.unitree.motors import MOTORS
from equipoise.drivers.unitree.packet_formats import FORMS
from equipoise.drivers.unitree.packets import DAMAGES, SensorReadings
from equipoise.drivers.unitree.udp import open_connection
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.errors import CommunicationError, SettingsError
from equipoise.lab.emulators.options import UnitreeUdpOptions
from equipoise.lab.emulators.udp_packets import StatePacket, read_command
from equipoise.lab.emulators.unitree_udp import FaultyNetwork
from equipoise.platform.platform import JointCommand, Trajectory

ROBOTS = [(protocol, form) for protocol, forms in FORMS.items() for form in forms]
EACH_ROBOT = pytest.mark.parametrize(("protocol", "form"), ROBOTS, ids=map("-".join, ROBOTS))
FAULTS = ("--loss", 0.02, "--duplicate", 0.02, "--reorder", 0.02)


@contextmanager
def connected(robot, protocol, *flags, silence=5.0, form=None):
    """A platform on a simulated robot of its own, without sensor errors, and the robot's process."""
    port, form = free_port(), form or next(iter(FORMS[protocol]))
    flags = ("--protocol", protocol, "--form", form, "--port", port, "--sim-preset", "ideal", *flags)
    with running_emulator("unitree-udp", *flags) as emulator:
        settings = UnitreeUdpSettings(protocol, "127.0.0.1", port, local_port=free_port(), silence=silence)
        with HardwarePlatform(open_connection(robot, settings)) as platform:
            platform.read()
            yield platform, emulator


@pytest.fixture(scope="module")
def direct(a1):
    """The state of the same robot without a network between."""
    with simulate(a1, "ideal") as simulation:
        return simulation.platform.read()


class RawRobot:
    """The robot's socket in the tests' hands, and a link to it."""

    def __init__(self, robot, protocol="a1", speaks=None, tick=1e-3, **changed):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5.0)
        port = self.socket.getsockname()[1]
        self.settings = UnitreeUdpSettings(protocol, "127.0.0.1", port, local_port=free_port(), tick=tick, **changed)
        self.link = open_connection(robot, self.settings)
        self.computer = ("127.0.0.1", self.settings.local_port)
        self.packets = FORMS[protocol][speaks or next(iter(FORMS[protocol]))]
        self._packet = StatePacket(self.packets)

    def state(self, tick, position=0.0):
        """A sample's bytes."""
        still = np.zeros(MOTORS)
        up = np.array([0.0, 0.0, 9.81])
        return bytes(
            self._packet.write(SensorReadings(still + position, still, still, still + 30, np.zeros(3), up, tick))
        )

    def send(self, *packets):
        for packet in packets:
            self.socket.sendto(packet, self.computer)

    def samples(self, count):
        """Return received samples, until there are so many or five seconds have passed."""
        samples, until = [], time.monotonic() + 5.0
        while len(samples) < count and time.monotonic() < until:
            samples += self.link.receive()
            time.sleep(1e-3)
        return samples

    def asked(self, duration=0.0):
        """Return the datagrams received so far and within a time [s]."""
        received_data, until = [], time.monotonic() + duration
        self.socket.setblocking(False)
        while True:
            try:
                received_data.append(self.socket.recv(2048))
            except BlockingIOError:
                if time.monotonic() > until:
                    return received_data
                self.link.receive()
                time.sleep(1e-3)

    def close(self):
        self.link.close()
        self.socket.close()


def is_harmless(packets, data):
    """Return whether a packet in some form requests only an answer."""
    read = read_command(packets, data)
    return isinstance(read, JointCommand) and not any(getattr(read, name).any() for name in ("torque", "kp", "kd"))


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


@EACH_ROBOT
@pytest.mark.realtime
def test_the_first_sample_is_that_of_the_same_robot_without_a_network(a1, direct, protocol, form):
    tick = {"compressed": 1e-6, "scrambled": 1e-6}.get(form, 1e-3)
    begins = 2**32 - round(0.5 / tick)
    with connected(a1, protocol, "--first-tick", begins, "--tick", tick, form=form) as (platform, emulator):
        state = platform.read()
        assert np.abs(state.joint_position - direct.joint_position).max() < 2e-3
        assert np.abs(state.joint_torque - direct.joint_torque).max() < 0.05
        assert np.abs(state.joint_velocity).max() < 0.02
        assert np.abs(state.angular_velocity_in_imu).max() < 0.02
        assert np.abs(state.acceleration_in_imu - direct.acceleration_in_imu).max() < 0.1
        assert state.acceleration_in_imu[2] == pytest.approx(9.81, abs=0.1)
        assert (state.health.motor_temperature == 40).all()
        assert state.health.battery_charge == {"a1": None, "go1": 0.8}[protocol]
        samples = [state]
        while samples[-1].time < state.time + 0.5:
            time.sleep(0.01)
            platform.read()
            samples += platform.arrived
        times = np.array([sample.time for sample in samples])
        assert np.diff(times) == pytest.approx(2e-3, abs=1e-6)  # over the counter's end, none lost and none twice
        assert times[-1] > 2**32 * tick
        assert platform.learn() == {"form": form}
        assert not any("mode" in entry and entry["mode"] != "own stance" for entry in emulator.log)


def hold(platform, command, duration):
    """Samples of as much of the robot's time [s] under one command."""
    samples = [platform.read()]
    until = samples[0].time + duration
    while samples[-1].time < until:
        platform.step(command)
        samples += platform.arrived
    return samples


@pytest.mark.realtime
def test_each_command_reaches_its_own_joint(a1):
    with connected(a1, "a1") as (platform, _):
        home = np.array(nominal_stance(a1).joint_position)
        for joint in range(len(home)):
            before = hold(platform, JointCommand(home), 0.15)[-1].joint_torque
            kick = home.copy()
            kick[joint] += 0.1
            measured = np.array([sample.joint_torque for sample in hold(platform, JointCommand(kick), 0.03)]) - before
            at = np.argmax(np.abs(measured[:, joint]))
            assert np.argmax(np.abs(measured).max(axis=0)) == joint
            assert measured[at, joint] > 5.0  # 0.1 rad times kp, less what the delay takes


@pytest.mark.parametrize(("protocol", "form"), [("a1", "compressed"), ("go1", "scrambled")])
@pytest.mark.realtime
def test_gains_and_feed_forward_arrive_and_the_end_is_a_release(a1, protocol, form):
    home = np.array(nominal_stance(a1).joint_position)
    ones = np.ones_like(home)
    command = JointCommand(home, 0.1 * ones, 0.25 * np.arange(len(home)), 60 * ones, 2.5 * ones)
    with simulate(a1, "ideal") as simulation:
        for _ in range(500):
            expected = simulation.platform.step(command)
    with connected(a1, protocol, form=form) as (platform, emulator):
        assert platform.accepts == {"velocity", "torque", "gains"}
        state = hold(platform, command, 1.0)[-1]
        gains = emulator.wait_for("kp")
        assert (gains["kp"], gains["kd"]) == (60.0, 2.5)
        assert np.abs(state.joint_position - expected.joint_position).max() < 5e-3
        assert np.abs(expected.joint_position - home).max() > 0.02
        assert np.abs(state.joint_torque - expected.joint_torque).max() < 0.5
        damped = JointCommand(home, kp=0 * ones, kd=2 * ones)
        hold(platform, damped, 0.02)
    log = emulator.end()
    assert logged_modes(log) == ["own stance", "commanded", "damped", "released"]
    assert log[-1]["damaged"] == 0


@pytest.mark.realtime
def test_a_motion_is_recorded_as_without_a_network(a1):
    motion = leaning(a1)
    with simulate(a1, "ideal") as simulation:
        expected = simulation.platform.play(motion)
    with connected(a1, "a1") as (platform, _):
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
    """Means over the last tenth of a second, and the rotation of the base by the gyroscope."""
    last = recording.between(recording.joints.time[-1] - 0.1, np.inf)
    omega, steps = recording.imu.angular_velocity_in_imu, np.diff(recording.imu.time)
    return {
        "position": last.joints.position.mean(axis=0),
        "torque": last.joints.torque.mean(axis=0),
        "acceleration": last.imu.acceleration_in_imu.mean(axis=0),
        "turned": steps @ (omega[1:] + omega[:-1]) / 2,
    }


@pytest.mark.realtime
def test_over_a_bad_network_every_sample_is_recorded_once_and_in_order(a1, monkeypatch):
    with connected(a1, "go1", "--loss", 0.05, "--duplicate", 0.05, "--reorder", 0.05) as (platform, emulator):
        link, arrived = platform._connection, []
        receive = link.receive
        monkeypatch.setattr(link, "receive", lambda: noted(receive(), arrived))
        home = np.array(nominal_stance(a1).joint_position)
        times = platform.play(Trajectory(np.repeat(home[None], 1000, axis=0))).joints.time
        assert not any(link.counts[kind] for kind in DAMAGES)
    every = np.concatenate(arrived)
    steps = np.diff(np.unique(every)) / 2e-3
    assert np.allclose(steps, np.rint(steps), atol=1e-3)
    assert len(steps) < 0.98 * steps.sum()  # what was lost is not made up
    assert len(steps) < 0.97 * len(every)  # the others came twice
    newest = np.unique(np.maximum.accumulate([max(times) for times in arrived]))
    expected = newest[(times[1] - 1e-6 < newest) & (newest < times[-1] + 1e-6)]
    assert times[1:] == pytest.approx(expected, abs=1e-6)
    assert emulator.end()[-1]["damaged"] == 0


def noted(samples, times):
    """Samples, whose times are appended to a list, unless there are none."""
    times += [[sample.time for sample in samples]] * bool(samples)
    return samples


@pytest.mark.realtime
def test_a_robot_that_is_switched_off_is_noticed(a1):
    with connected(a1, "a1", silence=0.5) as (platform, emulator):
        home = np.array(nominal_stance(a1).joint_position)
        platform.step(JointCommand(home))
        emulator.kill()
        with pytest.raises(CommunicationError, match=r"unitree-a1 at 127.0.0.1:\d+ has been silent for 0.\d s"):
            platform.play(Trajectory(np.repeat(home[None], 5000, axis=0)))


# --- against hand-made packets


def test_a_robot_that_is_not_there_is_an_error(a1):
    settings = UnitreeUdpSettings("a1", "127.0.0.1", free_port(), local_port=free_port())
    with (
        HardwarePlatform(open_connection(a1, settings), patience=0.2) as platform,
        pytest.raises(CommunicationError, match=r"sent nothing for 0\.2 s"),
    ):
        platform.read()


def test_a_port_that_is_taken_is_an_error(a1, raw):
    robot = raw()
    with pytest.raises(
        CommunicationError, match=f"cannot listen on 127.0.0.1:{robot.settings.local_port}.*another program"
    ):
        open_connection(a1, robot.settings)


def test_a_network_without_a_way_to_the_robot_is_an_error(a1):
    nowhere = UnitreeUdpSettings("a1", "255.255.255.255", local_port=free_port())
    with pytest.raises(CommunicationError, match=r"cannot send to unitree-a1 at 255.255.255.255:8007"):
        open_connection(a1, nowhere)


def test_a_robot_that_cannot_be_reached_any_more_is_an_error(a1):
    elsewhere = UnitreeUdpSettings("a1", "255.255.255.255", local_address="127.0.0.1", local_port=free_port())
    link = open_connection(a1, elsewhere)
    try:
        with pytest.raises(CommunicationError, match=r"cannot send to unitree-a1 at 255.255.255.255:8007"):
            link.receive()
    finally:
        link.close()


def test_the_link_listens_at_the_address_that_leads_to_the_robot(raw):
    assert raw().link._socket.getsockname()[0] == "127.0.0.1"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one loopback address")
def test_what_is_sent_to_another_address_of_this_computer_does_not_reach_the_link(raw):
    for robot, elsewhere in ((raw(), "127.0.0.2"), (raw(local_address="127.0.0.3"), "127.0.0.1")):
        here = robot.settings.local_address or "127.0.0.1"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"for all", (elsewhere, robot.settings.local_port))
            stranger.sendto(b"for the link", (here, robot.settings.local_port))
        robot.link.receive()
        assert robot.link.counts["from elsewhere"] == 1


def test_other_legs_are_an_error(tmp_path):
    two_joints = load_text(tmp_path, quadruped_urdf(joints_per_leg=2))
    with pytest.raises(SettingsError, match="unitree-a1 has 12 joints, three per leg; 'robot' has 8"):
        open_connection(two_joints, UnitreeUdpSettings())


def test_commands_for_other_joints_are_an_error(raw):
    with pytest.raises(SettingsError, match=r"commands for 3 joints; unitree-a1 at .* has 12"):
        raw().link.send(JointCommand(np.zeros(3)))


@EACH_ROBOT
def test_a_robot_is_asked_without_torque_until_it_is_commanded(a1, raw, protocol, form):
    robot = raw(protocol=protocol, speaks=form)
    packets = robot.packets
    received_data = robot.asked(0.35 if form in ("struct", "scrambled") else 0.02)
    asked = next(read for data in received_data if isinstance(read := read_command(packets, data), JointCommand))
    assert all(any(is_harmless(known, data) for known in FORMS[protocol].values()) for data in received_data)
    robot.send(robot.state(2))
    robot.link.send(JointCommand(np.arange(float(MOTORS))))
    until = time.monotonic() + 5.0
    while not (sent := read_command(packets, robot.asked()[-1])).kp.any():
        assert time.monotonic() < until
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    assert sent.kp == pytest.approx(kp, abs=1 / 32)
    assert sent.kd == pytest.approx(kd, abs=1 / 16)
    assert not sent.velocity.any()
    legs = [a1.legs[name].joints for name in ("FR", "FL", "RR", "RL")]
    assert sent.position.tolist() == np.concatenate(legs).tolist()
    assert robot.asked(0.02) == []  # asks no more
    robot.link.release()
    after = [read_command(packets, data) for data in robot.asked()]
    assert len(after) == 5
    assert all(np.array_equal(packet.position, asked.position) for packet in after)


def test_who_does_not_answer_is_asked_in_one_form_after_the_other(raw):
    robot = raw()
    sizes = [len(data) for data in robot.asked(0.85)]
    changes = [size for size, last in zip(sizes, [None, *sizes], strict=False) if size != last]
    assert changes == [610, 730, 610, 730]


@EACH_ROBOT
def test_a_form_that_is_set_is_the_only_one(raw, protocol, form):
    robot = raw(protocol=protocol, form=form)
    received_data = robot.asked(0.4)
    assert len(received_data) > 20
    assert all(is_harmless(FORMS[protocol][form], data) for data in received_data)
    robot.link.send(JointCommand(np.zeros(MOTORS)))
    assert read_command(FORMS[protocol][form], robot.asked()[-1]).kp.all()


def test_who_commands_before_it_has_sensed_waits_for_an_answer_and_moves_nothing_without(raw, monkeypatch):
    monkeypatch.setattr(unitree_udp, "_PATIENCE", 0.4)
    robot = raw()
    with pytest.raises(CommunicationError, match=r"answered no packets \(compressed, struct\) in 0.4 s"):
        robot.link.send(JointCommand(np.zeros(MOTORS)))
    robot.link.release()
    forms = FORMS["a1"].values()
    received_data = robot.asked()
    assert {len(data) for data in received_data} == {610, 730}
    assert all(any(is_harmless(form, data) for form in forms) for data in received_data)
    robot = raw(speaks="struct")
    robot.send(robot.state(2))
    robot.link.send(JointCommand(np.zeros(MOTORS)))
    assert read_command(robot.packets, robot.asked()[-1]).kp.all()


def test_the_second_connection_learns_what_the_robot_answered(raw):
    robot = raw(speaks="struct")
    robot.send(robot.state(2))
    assert HardwarePlatform(robot.link).learn() == {"form": "struct"}


# --- which form a robot speaks


def states_in(protocol):
    """A state in each form, by name."""
    still, up = np.zeros(MOTORS), np.array([0.0, 0.0, 9.81])
    state = SensorReadings(still, still, still, still, np.zeros(3), up, 7)
    return {name: bytes(StatePacket(form).write(state)) for name, form in FORMS[protocol].items()}


def test_forms_are_asked_in_by_turns_with_a_pause_for_answers():
    search = FormSearch(FORMS["go1"], check=True)
    asked = [search.request_form(10 + moment / 128) for moment in range(3 * 32)]  # 32 of them are a turn, exactly
    quiet = [None] * sum(moment / 128 >= 0.2 for moment in range(32))
    turn = 32 - len(quiet)
    assert asked == [*["plain"] * turn, *quiet, *["scrambled"] * turn, *quiet, *["plain"] * turn, *quiet]


@pytest.mark.parametrize(
    ("protocol", "requested", "answered", "detected"),
    [
        ("a1", "compressed", "compressed", "compressed"),
        ("a1", "compressed", "struct", "struct"),
        ("a1", "struct", "compressed", "compressed"),
        ("go1", "plain", "plain", "plain"),
        ("go1", "plain", "scrambled", "scrambled"),
        ("go1", "scrambled", "scrambled", "scrambled"),
        ("go1", "scrambled", "plain", "scrambled"),  # a robot that ignored plain commands
    ],
)
def test_the_answer_determines_the_form(protocol, requested, answered, detected):
    search, now = FormSearch(FORMS[protocol], check=True), 10.0
    while search.request_form(now) != requested:
        now += 0.01
    search.add(b"something else", now)
    assert search.form is None
    search.add(states_in(protocol)[answered], now + 0.03)
    assert search.form == search.request_form(now + 99) == detected
    search.add(states_in(protocol)[{*FORMS[protocol]}.difference({detected}).pop()], now + 0.04)
    assert search.form == detected


def test_an_answer_from_before_the_turn_belongs_to_the_turn_before():
    search = FormSearch(FORMS["go1"], check=True)
    assert search.request_form(10.0) == "plain"
    assert search.request_form(10.3) == "scrambled"
    search.add(states_in("go1")["plain"], 10.28)
    assert search.form == "plain"


def test_who_talks_before_it_is_asked_speaks_the_likeliest_form():
    search = FormSearch(FORMS["go1"], check=True)
    search.add(states_in("go1")["plain"], 10.0)
    assert search.form == "plain"


def test_what_fits_no_form_is_damaged_as_in_the_form_that_it_fits_best():
    search = FormSearch(FORMS["a1"], check=True)
    for name, state in states_in("a1").items():
        assert search.read(state[:-1]) == "wrong length", name
        assert search.read(b"\xee" + state[1:]) == "wrong head", name
        assert search.read(state[:-1] + bytes([state[-1] ^ 1])) == "wrong checksum", name


# --- against hand-made packets again


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
        first, early = platform.read(), platform.arrived
        robot.send(robot.state(4, position=4.0))
        time.sleep(0.1)
        second, late = platform.read(), platform.arrived
    for state, arrived, positions in ((first, early, [2.0, 8.0, 6.0]), (second, late, [4.0])):
        assert (state.time, state.joint_position[0]) == (pytest.approx(0.008), 8.0)
        assert [sample.joint_position[0] for sample in arrived] == positions


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
    assert robot.link.counts == Counter(
        {"good": 1, "from elsewhere": 5, "wrong head": 1, "wrong checksum": 2, "wrong length": 4}
    )


def test_while_commands_are_sent_samples_make_room_for_newer_ones(raw):
    robot = raw(silence=10.0)  # on a busy machine they take longer than a second
    for tick in range(0, 2000, 2):
        robot.send(robot.state(tick))
        robot.link.send(JointCommand(np.zeros(MOTORS)))
    samples = robot.samples(64)
    assert [round(1000 * sample.time) for sample in samples] == list(range(2 * (1000 - 64), 2000, 2))
    assert robot.link.counts["unread"] == 1000 - 64


def test_samples_from_a_pause_of_the_reader_are_neither_used_nor_silence(raw):
    robot = raw(silence=0.15)
    robot.send(robot.state(2))
    assert len(robot.samples(1)) == 1
    robot.send(robot.state(4))
    time.sleep(0.2)
    assert robot.link.receive() == []
    assert robot.link.counts["unread"] == 1
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


@pytest.mark.parametrize("call", ["receive", "learn"])
def test_a_robot_that_sends_only_invalid_packets_has_another_error_than_a_silent_one(raw, monkeypatch, call):
    monkeypatch.setattr(unitree_udp, "_PATIENCE", 0.05)
    robot = raw()
    robot.send(robot.state(2)[:-1], b"\xee" + robot.state(2)[1:])
    time.sleep(0.1)
    with pytest.raises(
        CommunicationError, match=r"sends no valid packets.* 0 good, 1 of wrong length, 1 of wrong head"
    ):
        getattr(robot.link, call)()


def test_wrong_checksums_may_be_taken(raw):
    robot = raw(check=False)
    good = robot.state(6)
    robot.send(good[:-1] + bytes([good[-1] ^ 1]))
    assert [sample.time for sample in robot.samples(1)] == [pytest.approx(0.006)]


def test_samples_wait_for_the_unit_of_the_robots_clock_and_none_is_lost(raw):
    robot, samples, ticks = raw(tick=None), [], []
    begin = time.monotonic()
    while not samples:
        ticks.append(round(1e6 * (time.monotonic() - begin)))
        robot.send(robot.state(ticks[-1]))
        samples = robot.link.receive()
        time.sleep(2e-3)
        assert time.monotonic() - begin < 5.0
    assert robot.link.counts["good"] == len(ticks)
    assert [sample.time for sample in samples] == pytest.approx([1e-6 * tick for tick in ticks])
    assert samples[-1].received - samples[0].received > 0.2


def test_closing_twice_is_closing(raw):
    link = raw().link
    link.release()
    link.close()
    link.release()
    link.close()


def test_each_robot_has_its_own_local_port():
    assert [UnitreeUdpSettings(protocol).listens_on for protocol in FORMS] == [8080, 8090]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"protocol": "go2"}, "protocol is 'go2'; it must be one of a1, go1"),
        ({"address": "robot"}, "address is 'robot'; it must be an IPv4 address"),
        ({"local_address": "::1"}, "local_address is '::1'"),
        ({"port": 0}, "port is 0; it must be from 1 to 65535"),
        ({"local_port": 70000}, "local_port is 70000; it must be from 1 to 65535"),
        ({"tick": -1.0}, "tick is -1.0; it must be from 0 to 1"),
        ({"silence": 0.001}, "silence is 0.001"),
        ({"local_address": "0.0.0.0"}, "local_address is 0.0.0.0, which means all addresses"),
        ({"form": "plain"}, "form is 'plain'; for protocol 'a1' it must be one of compressed, struct"),
        ({"protocol": "go1", "form": "610"}, "form is '610'; for protocol 'go1' it must be one of plain, scrambled"),
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
    with pytest.raises(CommunicationError, match=r"1000 s in 1.0 s.* set tick \(1e-6"):
        clock.time(10**9 + 1_000_000, 6.0)


def test_a_clock_that_stands_still_is_noticed_or_left_aside():
    with pytest.raises(CommunicationError, match=r"0 s in 1\.5 s"):
        [clock.time(7, received) for clock in [RobotClock(1e-3)] for received in (5.0, 6.5)]
    without = RobotClock(0.0)
    assert [without.time(7, received) for received in (5.0, 6.5)] == [5.0, 6.5]


def counter_samples(unit, duration, loss=0.0, seed=0, speed=1.0, stalls=()):
    """Counters and arrivals of samples every 2 ms [s] over a network and a computer that are not punctual.

    `speed` is that of the robot's time, one for all or one a tenth of a second; at a stall's end is seen what came in it.
    """
    random = np.random.default_rng(seed)
    sampled = np.arange(2e-3, duration, 2e-3)
    passed = np.cumsum(
        2e-3 / np.broadcast_to(np.repeat(speed, 50)[: len(sampled)] if np.ndim(speed) else speed, len(sampled))
    )
    kept = random.random(len(sampled)) >= loss
    late = random.exponential(1e-3, len(sampled)) * (random.random(len(sampled)) < 0.2)
    counts, received = np.rint(sampled / unit)[kept], (77 + passed + late)[kept]
    for begin, end in stalls:
        received[(received >= 77 + begin) & (received < 77 + end)] = 77 + end
    order = np.argsort(received, kind="stable")
    return [((2**32 - 5000 + int(counts[at])) % 2**32, float(received[at])) for at in order]


def detected_unit(samples):
    search = UnitSearch()
    for count, received in samples:
        search.add(count, received)
        if search.unit is not None:
            return search.unit, received - 77
    return None, np.inf


@pytest.mark.parametrize("unit", [1e-3, 1e-6])
@given(seed=st.integers(0, 1000), loss=st.sampled_from([0.0, 0.1, 0.5]))
def test_the_unit_of_a_clock_is_detected_in_a_third_of_a_second_over_its_end_and_over_bad_networks(unit, seed, loss):
    detected, after = detected_unit(counter_samples(unit, 2.0, loss, seed))
    assert detected == unit
    assert after < 0.35


def test_a_computer_that_stalls_learns_the_unit_later():
    detected, after = detected_unit(counter_samples(1e-3, 3.0, stalls=[(0.05, 0.3), (0.35, 0.6), (0.65, 0.9)]))
    assert detected == 1e-3
    assert after < 1.5


@pytest.mark.parametrize("unit", [1e-3, 1e-6])
def test_a_simulated_robot_on_a_busy_machine_is_slow_but_its_clock_is_detected(unit):
    slow = np.random.default_rng(5).uniform(0.2, 0.6, 100)
    detected, after = detected_unit(counter_samples(unit, 5.0, speed=slow))
    assert detected == unit
    assert 1.9 < after < 2.5


@pytest.mark.parametrize(("unit", "rate"), [(2e-3, 500), (5e-4, 2000), (1e-4, 1e4), (1e9, 0), (1e-8, 1e8)])
def test_a_clock_in_an_unsupported_unit_is_refused(unit, rate):
    samples = counter_samples(unit, 4.0)
    with pytest.raises(
        CommunicationError, match=r"neither milliseconds nor microseconds: set tick, the seconds"
    ) as refused:
        detected_unit(samples)
    printed = float(str(refused.value).split("counts ")[1].split()[0])
    assert printed == pytest.approx(rate, rel=0.01)


def test_a_robot_whose_clock_does_not_advance_may_be_set_to_have_none(raw):
    robot = raw(tick=0.0)
    robot.send(robot.state(7), robot.state(7))
    samples = robot.samples(2)
    assert [sample.time for sample in samples] == [sample.received for sample in samples]


# --- the network of the simulated robot


@given(st.integers(0, 1000), st.sampled_from([0.0, 0.1, 1.0]), st.sampled_from([0.0, 0.2, 1.0]))
def test_a_network_that_mixes_up_and_repeats_loses_nothing(seed, duplicate, reorder):
    network = FaultyNetwork(UnitreeUdpOptions(duplicate=duplicate, reorder=reorder, network_seed=seed), 0)
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
    faults = UnitreeUdpOptions(loss=0.1, duplicate=0.2, reorder=0.3)
    network, sent = FaultyNetwork(faults, 0), [index.to_bytes(2, "big") for index in range(5000)]
    arrived = [packet for packet in sent for packet in network.carry(packet)]
    assert len(set(arrived)) == pytest.approx(0.9 * 5000, rel=0.03)
    assert len(arrived) == pytest.approx(0.9 * 1.2 * 5000, rel=0.03)
    overtaken = sum(packet < max(arrived[:at]) for at, packet in enumerate(arrived) if 0 < at < 2000)
    assert 0.1 < overtaken / 2000 < 0.4
    again = FaultyNetwork(faults, 0)
    assert [packet for packet in sent for packet in again.carry(packet)] == arrived


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"loss": 1.5}, r"loss is 1\.5; it must be from 0 to 1"),
        ({"port": 99999}, "port is 99999; it must be from 1 to 65535"),
    ],
)
def test_settings_of_an_emulator_have_ranges(setting, message):
    with pytest.raises(SettingsError, match=message):
        UnitreeUdpOptions(**setting)


@pytest.mark.parametrize("jump", [-3600.0, 3600.0])
def test_a_system_clock_that_is_set_moves_no_sample(raw, monkeypatch, jump):
    """The system notes arrivals by its own clock, which may be set between an arrival and the look at it."""
    robot, receive = raw(), unitree_udp.receive

    def stamped(opened, ahead):
        return receive(opened, ahead + jump)

    monkeypatch.setattr(unitree_udp, "receive", stamped)
    robot.send(*(robot.state(tick) for tick in range(1, 6)))
    (*_, last) = robot.samples(4)
    assert abs(time.monotonic() - last.received) < 5.0
