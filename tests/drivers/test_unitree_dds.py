"""A Go2's link against a simulated robot in a process of its own, over DDS on loopback."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import closing, contextmanager

import numpy as np
import pytest
from emulator_processes import logged_modes, unused_domain
from scipy.interpolate import interp1d

pytest.importorskip("cyclonedds")

from equipoise import nominal_stance, simulate
from equipoise.cli import main
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree import sport
from equipoise.drivers.unitree.dds import open_connection
from equipoise.drivers.unitree.dds_settings import UnitreeB2Settings, UnitreeDdsSettings
from equipoise.drivers.unitree.dds_types import Request, Response
from equipoise.drivers.unitree.low_level import STATE, Message
from equipoise.errors import CommunicationError, MotionError, SettingsError
from equipoise.platform.platform import JointCommand, Trajectory

pytestmark = pytest.mark.realtime
PATIENCE = 60.0  # [s] for an emulator to start on a busy machine


class Peer:
    """A process with a simulated robot, and what it wrote."""

    def __init__(self, process, path, domain, flags):
        self.process, self.path, self.domain, self.flags = process, path, domain, flags

    def fault(self, **fault):
        """Give it a fault, as `equipoise.lab.emulators.faults` describes it."""
        self.process.stdin.write(json.dumps(fault) + "\n")
        self.process.stdin.flush()

    def logged(self, key=None):
        """All entries, or the values under a key."""
        entries = [json.loads(line) for line in self.path.read_text().splitlines() if line.endswith("}")]
        return entries if key is None else [entry[key] for entry in entries if key in entry]

    def wait_for(self, patience=PATIENCE, **what):
        """Wait for an entry."""
        until = time.monotonic() + patience
        while not any(what.items() <= entry.items() for entry in self.logged()):
            assert self.process.poll() is None, self.path.read_text()
            assert time.monotonic() < until, f"{what} was not logged: {self.path.read_text()}"
            time.sleep(0.02)


@contextmanager
def running(tmp_path_factory, *flags, domain=None):
    path, domain = tmp_path_factory.mktemp("emulator") / "log.jsonl", domain or unused_domain()
    command = [
        sys.executable,
        "-m",
        "equipoise.lab.emulators.unitree_dds",
        "--domain",
        str(domain),
        "--sim-preset",
        "ideal",
    ]
    with path.open("w") as log:
        process = subprocess.Popen(
            [*command, "--duration", "120", *flags], stdin=subprocess.PIPE, stdout=log, stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    emulator = Peer(process, path, domain, flags)
    try:
        emulator.wait_for(ready=True)
        yield emulator
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(timeout=10)
        process.stdin.close()


def settings(emulator, **others):
    return UnitreeDdsSettings(interface="lo", domain=emulator.domain, **others)


@contextmanager
def connected(emulator, robot, **others):
    with HardwarePlatform(open_connection(robot, settings(emulator, **others))) as platform:
        yield platform


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


def hold(platform, position, seconds=0.3, **others):
    """Stand for a while by the robot's clock; the last state."""
    state = platform.read()
    end, patience = state.time + seconds, time.monotonic() + PATIENCE
    while state.time < end:
        assert time.monotonic() < patience
        state = platform.step(JointCommand(position, **others))
    return state


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


def excitation(robot):
    """Legs long and short in turn, so that the body rolls and pitches."""
    at = np.arange(750) * 2e-3
    wave = np.sin(2 * np.pi * at / 1.5) * np.sin(np.pi * at / 1.5) ** 2
    position = np.repeat(nominal_stance(robot).joint_position[None], len(at), axis=0)
    for leg, sign in (("FL", 1.0), ("RR", -0.3), ("FR", 0.3)):
        _, thigh, calf = robot.legs[leg].joints
        position[:, thigh] += 0.2 * sign * wave
        position[:, calf] -= 0.4 * sign * wave
    return Trajectory(position)


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
    link._message.record["motor_cmd"]["q"][:12] += 0.5
    data = link._message.encoded()
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


def test_a_robot_that_is_not_there_is_noticed(a1):
    elsewhere = UnitreeB2Settings(interface="lo", domain=unused_domain())
    with (
        HardwarePlatform(open_connection(a1, elsewhere), patience=0.2) as platform,
        pytest.raises(CommunicationError, match=r"unitree-b2 on lo sent nothing for 0\.2 s"),
    ):
        platform.read()


def test_its_own_controller_lets_go_of_a_lying_robot_before_the_first_command(tmp_path_factory, a1):
    with running(tmp_path_factory) as emulator:
        emulator.fault(damage=0.1)
        with connected(emulator, a1) as platform:
            lying = platform.read().joint_position
            time.sleep(0.2)
            assert emulator.logged("asked") == []  # reading asks for nothing
            platform.step(JointCommand(lying))
            state = hold(platform, lying, 0.3)
            assert platform._connection.rejected > 10  # and left out
            assert np.allclose(state.joint_position, lying, atol=0.7)  # limp legs slide
            assert platform.lateness[0] == 0  # the seconds that it took are no delay
        emulator.wait_for(mode="silence")
        assert set(emulator.logged("asked")) == {"release"}
        assert emulator.logged("ignored") == []  # not a command came before
        assert emulator.logged("sport_mode") == ["ended"]
        assert logged_modes(emulator.logged()) == ["own stance", "released", "commanded", "released"]


def test_each_command_is_for_its_own_joint(tmp_path_factory, a1):
    """Each torque is commanded until it is measured; a busy machine may take long to deliver a command."""
    limp = {"kp": np.zeros(12), "kd": np.zeros(12)}
    with running(tmp_path_factory, "--no-sport-mode") as emulator, connected(emulator, a1) as platform:
        lying = platform.read().joint_position
        for push in 3 * np.eye(12):
            patience = time.monotonic() + PATIENCE
            while not np.allclose(
                measured := hold(platform, lying, 0.02, torque=push, **limp).joint_torque, push, atol=0.1
            ):
                assert time.monotonic() < patience, f"{measured.round(1)} for {push}"


def test_a_standing_robot_is_not_dropped_and_who_does_not_ask_is_ignored(tmp_path_factory, a1, target):
    with running(tmp_path_factory, "--start", "standing") as emulator:
        with connected(emulator, a1) as platform:
            for _ in range(2):
                with pytest.raises(MotionError, match=r"'normal' of unitree-go2 on lo holds .* does not lie"):
                    hold(platform, target, 0.1)
            time.sleep(0.2)
        time.sleep(0.1)
        assert (emulator.logged("ignored"), emulator.logged("asked"), emulator.logged("mode")) == (
            [],
            [],
            ["own stance"],
        )
        with connected(emulator, a1, release_sport_mode=False) as platform:
            hold(platform, target, 0.1)
            emulator.wait_for(ignored="fought")
        with connected(emulator, a1, hanging=True) as platform:
            hold(platform, target, 0.1)
            assert emulator.logged("sport_mode") == ["ended"]


COMMANDS = """
import sys, time
from equipoise.drivers.dds.domain import DdsDomain, raw
from equipoise.drivers.unitree.dds import COMMAND_TOPIC
from equipoise.drivers.unitree.dds_types import LowCmd
from equipoise.drivers.unitree.low_level import COMMAND, Message
sample, domain = raw(LowCmd), DdsDomain(int(sys.argv[1]), "lo")
commands, message = domain.outbox(COMMAND_TOPIC, sample), Message(COMMAND)
print("ready", flush=True)
sys.stdin.readline()
while True:
    commands.send(sample(message.encoded()))
    print("sent", flush=True)
    time.sleep(2e-3)
"""


@contextmanager
def other_commander(emulator):
    """A program that sends commands as soon as it is asked; a function that asks, and its process."""
    other = [sys.executable, "-c", COMMANDS, str(emulator.domain)]
    with subprocess.Popen(other, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def command():
            process.stdin.write("go\n")
            process.stdin.flush()
            assert process.stdout.readline() == "sent\n"

        try:
            assert process.stdout.readline() == "ready\n"
            yield command, process
        finally:
            process.kill()


def test_a_second_commander_is_refused_and_one_that_sends_nothing_is_not(tmp_path_factory, a1):
    with running(tmp_path_factory, "--no-sport-mode") as emulator, connected(emulator, a1) as platform:
        lying = JointCommand(platform.read().joint_position)
        with other_commander(emulator) as (command, _):
            hold(platform, lying.position, 0.1)
            platform._connection.release()
            command()
            with pytest.raises(MotionError) as caught:
                platform.step(lying)
        assert str(caught.value).startswith("another program commands the motors of unitree-go2 on lo: ")
        assert "end that program, on this computer or on the robot" in str(caught.value)
        assert caught.value.other_commander
        hold(platform, lying.position, 0.1)


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


def test_two_robots_on_a_domain_are_refused_before_anything_is_sent(tmp_path_factory, a1):
    with running(tmp_path_factory) as emulator, connected(emulator, a1) as platform:
        lying = JointCommand(platform.read().joint_position)
        with running(tmp_path_factory, domain=emulator.domain) as other:
            until = time.monotonic() + PATIENCE
            while platform._connection._states.writers < 2:
                assert time.monotonic() < until
                time.sleep(0.01)
            with pytest.raises(
                CommunicationError, match=r"2 robots send rt/lowstate in domain \d+ on lo: .*process \d+"
            ):
                platform.step(lying)
            with pytest.raises(CommunicationError, match=r"All would execute .* disconnect the others .* set domain"):
                platform.read()
            with pytest.raises(CommunicationError, match=r"motion_switcher .* exists 2 times"):
                platform._connection._switcher.mode()
            time.sleep(0.1)
            for robot in (emulator, other):
                assert (robot.logged("request"), robot.logged("ignored"), robot.logged("mode")) == (
                    [],
                    [],
                    ["own stance"],
                )


def test_a_robot_that_comes_to_the_domain_in_mid_run_is_noticed(tmp_path_factory, a1):
    with running(tmp_path_factory, "--no-sport-mode") as emulator, connected(emulator, a1) as platform:
        lying = platform.read().joint_position
        hold(platform, lying, 0.1)
        with (
            running(tmp_path_factory, domain=emulator.domain),
            pytest.raises(CommunicationError, match="2 robots send"),
        ):
            hold(platform, lying, PATIENCE)


def test_a_robot_that_sends_nothing_is_not_commanded(a1):
    alone = UnitreeDdsSettings(interface="lo", domain=unused_domain(), release_sport_mode=False)
    with (
        closing(open_connection(a1, alone)) as link,
        pytest.raises(CommunicationError, match="no robot sends rt/lowstate"),
    ):
        link.send(JointCommand(np.zeros(12)))


def test_a_simulator_without_clock_checksum_and_services(tmp_path_factory, a1, target):
    with running(tmp_path_factory, "--start", "standing", "--bare") as emulator:
        bare = connected(emulator, a1, check_crc=False)
        with bare as platform, pytest.raises(CommunicationError, match="release_sport_mode=false"):
            hold(platform, target, 0.1)
        with connected(emulator, a1, check_crc=False, release_sport_mode=False) as platform:
            state = hold(platform, target, 0.2)
            assert state.time == state.received
            recording = platform.play(excitation(a1))
    assert len(recording.joints.time) > 50
    assert recording.joints.time[-1] < time.monotonic()


@pytest.fixture(scope="module")
def asked(request, tmp_path_factory):
    """A robot of these flags, which several tests ask."""
    with running(tmp_path_factory, *request.param) as emulator:
        yield emulator


@pytest.mark.parametrize(
    ("asked", "given", "fine", "value"),
    [
        ([], [], True, "'normal' holds the motors; calibrate will have it release them"),
        (
            [],
            ["release_sport_mode=false"],
            False,
            "'normal' holds the motors, and calibrate will not have it release them",
        ),
        (
            ["--start", "standing"],
            [],
            False,
            "'normal' holds the motors, and the robot does not lie: calibrate will fail",
        ),
        (
            ["--start", "standing"],
            ["hanging=true"],
            True,
            "'normal' holds the motors; calibrate will have it release them",
        ),
        (["--no-sport-mode"], [], True, "none holds the motors; calibrate will command them at once"),
        (
            ["--bare"],
            ["check_crc=false"],
            False,
            "was not found within 3 s; a simulator without it needs release_sport_mode=false",
        ),
        (["--bare"], ["check_crc=false", "release_sport_mode=false"], None, "not known; calibrate will not request it"),
    ],
    indirect=["asked"],
)
def test_the_doctor_reports_who_holds_the_motors_and_releases_none(asked, capsys, given, fine, value):
    pairs = ["interface=lo", f"domain={asked.domain}", "silence=5", *given]
    doctor = ["doctor", "--platform", "unitree-go2", "--duration", "0.5s", "--json"]
    code = main([*doctor, *(f"--set={pair}" for pair in pairs)])
    time.sleep(0.2)
    assert {*asked.logged("request")} == (set() if "--bare" in asked.flags else {1001})
    assert (asked.logged("asked"), asked.logged("sport_mode"), asked.logged("ignored")) == ([], [], [])
    assert asked.logged("mode") == ["own stance"]
    findings = {finding["name"]: finding for finding in json.loads(capsys.readouterr().out)["findings"]}
    found = findings["robot's own controller"]
    assert found["fine"] is fine
    assert value in found["value"]
    assert bool(found["advice"]) == (fine is False)
    assert code in (
        (1,) if fine is False else (0, 1)
    )  # a busy machine's samples come late, and the doctor reports them


def test_a_service_that_receives_and_never_answers_is_named(monkeypatch):
    """No program holds the motors meanwhile: no command is sent before an answer."""
    monkeypatch.setattr(sport, "_ANSWER", 0.1)
    with closing(DdsDomain(unused_domain(), "lo")) as domain:
        service, _ = domain.inbox(sport.REQUESTS, Request), domain.outbox(sport.RESPONSES, Response)
        with pytest.raises(CommunicationError) as caught:
            sport.MotionSwitcher(domain, "unitree-go2").release()
        assert len(service.take()) == 3
    assert str(caught.value) == (
        "the motion_switcher service of unitree-go2 has not answered 3 requests, each within 0.1 s"
    )


@pytest.mark.parametrize("fault", [{"damage": 1.0}, {"zero_crc": True}])
def test_wrong_and_missing_checksums_are_left_out_unless_asked_for(tmp_path_factory, a1, fault):
    with running(tmp_path_factory, "--no-sport-mode") as emulator:
        emulator.fault(**fault)
        emulator.wait_for(fault=next(iter(fault)))
        with connected(emulator, a1) as platform:
            with pytest.raises(CommunicationError, match=r"all \d+ samples .* check_crc=false"):
                platform.read()
            assert platform._connection.rejected > 100
        with connected(emulator, a1, check_crc=False) as platform:
            assert platform.read().joint_position.shape == (12,)
            assert platform._connection.rejected == 0


def test_messages_lost_inside_the_robot_are_a_fault_once_they_get_lost(a1):
    link = open_connection(a1, UnitreeDdsSettings(interface="lo", domain=unused_domain()))
    try:
        message = Message(STATE)
        lost = message.record["motor_state"]["lost"]
        lost[:12] = 1000  # since it was switched on
        assert link._examine(message.record, 5.0).fault is None
        lost[:12] += 1  # a few are nothing
        lost[7] += 40  # RR_thigh's
        assert link._examine(message.record, 5.1).fault == "messages to motors get lost: RR_thigh_joint"
        assert link._examine(message.record, 5.2).fault is None
    finally:
        link.close()


def test_a_motor_in_the_cold_is_not_hot(a1):
    link = open_connection(a1, UnitreeDdsSettings(interface="lo", domain=unused_domain()))
    try:
        message = Message(STATE)
        message.record["motor_state"]["temperature"].view(np.uint8)[:12] = 256 - 5  # the byte of -5
        assert np.array_equal(link._examine(message.record, 5.0).motor_temperature, np.full(12, -5.0))
    finally:
        link.close()


def test_a_robot_with_other_legs_is_refused(two_jointed):
    with pytest.raises(SettingsError, match="unitree-go2 has 12 joints, three per leg"):
        open_connection(two_jointed, UnitreeDdsSettings(interface="lo"))


@pytest.mark.parametrize("wrong", [0, 2, 11, 256])
def test_motor_modes_that_no_example_of_the_maker_sends_are_refused(wrong):
    with pytest.raises(SettingsError, match=f"motor_mode is {wrong}; it must be 1 or 10"):
        UnitreeB2Settings(motor_mode=wrong)


@pytest.mark.parametrize(("kind", "mode"), [(UnitreeDdsSettings, 1), (UnitreeB2Settings, 10)])
def test_the_motor_mode_of_each_robot_arrives(tmp_path_factory, a1, kind, mode):
    with running(tmp_path_factory, "--no-sport-mode") as emulator:
        given = kind(interface="lo", domain=emulator.domain)
        with HardwarePlatform(open_connection(a1, given)) as platform:
            hold(platform, platform.read().joint_position, 0.1)
        assert {*emulator.logged("motor_mode")} == {mode}


@pytest.mark.parametrize("wrong", [{"domain": -1}, {"domain": 233}, {"silence": 0.0}, {"silence": 11.0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(SettingsError, match=f"{next(iter(wrong))} is .* must be from"):
        UnitreeDdsSettings(**wrong)
