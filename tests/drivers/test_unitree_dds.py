"""A Go2's link against simulated robots in processes of their own, over DDS on loopback."""

import json
import time
from contextlib import closing

import numpy as np
import pytest
from emulator_processes import logged_modes, unused_domain

pytest.importorskip("cyclonedds")

from dds_robots import PATIENCE, connected, excitation, hold, other_commander, running

from equipoise import nominal_stance
from equipoise.cli import main
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree import sport
from equipoise.drivers.unitree.dds import open_connection
from equipoise.drivers.unitree.dds_settings import UnitreeB2Settings, UnitreeDdsSettings
from equipoise.drivers.unitree.dds_types import Request, Response
from equipoise.drivers.unitree.low_level import STATE
from equipoise.errors import CommunicationError, MotionError, SettingsError
from equipoise.platform.platform import JointCommand

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def target(a1):
    return nominal_stance(a1).joint_position


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


ASKED = {  # by the robot's flags: what is set, whether all is fine, and what is reported
    (): [
        ([], True, "'normal' holds the motors; calibrate will have it release them"),
        (["release_sport_mode=false"], False, "'normal' holds the motors, and calibrate will not have it release them"),
    ],
    ("--start", "standing"): [
        ([], False, "'normal' holds the motors, and the robot does not lie: calibrate will fail"),
        (["hanging=true"], True, "'normal' holds the motors; calibrate will have it release them"),
    ],
    ("--no-sport-mode",): [([], True, "none holds the motors; calibrate will command them at once")],
    ("--bare",): [
        (
            ["check_crc=false"],
            False,
            "was not found within 3 s; a simulator without it needs release_sport_mode=false",
        ),
        (["check_crc=false", "release_sport_mode=false"], None, "not known; calibrate will not request it"),
    ],
}


@pytest.mark.parametrize("flags", ASKED, ids=" ".join)
def test_the_doctor_reports_who_holds_the_motors_and_releases_none(tmp_path_factory, capsys, flags):
    with running(tmp_path_factory, *flags) as asked:
        for given, fine, value in ASKED[flags]:
            pairs = ["interface=lo", f"domain={asked.domain}", "silence=5", *given]
            doctor = ["doctor", "--platform", "unitree-go2", "--duration", "0.5s", "--json"]
            code = main([*doctor, *(f"--set={pair}" for pair in pairs)])
            time.sleep(0.2)
            assert {*asked.logged("request")} == (set() if "--bare" in flags else {1001})
            assert (asked.logged("asked"), asked.logged("sport_mode"), asked.logged("ignored")) == ([], [], [])
            assert asked.logged("mode") == ["own stance"]
            findings = {finding["name"]: finding for finding in json.loads(capsys.readouterr().out)["findings"]}
            found = findings["robot's own controller"]
            assert found["fine"] is fine
            assert value in found["value"]
            assert bool(found["advice"]) == (fine is False)
            # A busy machine's samples come late, and the doctor reports them.
            assert code in ((1,) if fine is False else (0, 1))


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
        record = STATE.blank()
        lost = record["motor_state"]["lost"]
        lost[:12] = 1000  # since it was switched on
        assert link._examine(record, 5.0).fault is None
        lost[:12] += 1  # a few are nothing
        lost[7] += 40  # RR_thigh's
        assert link._examine(record, 5.1).fault == "messages to motors get lost: RR_thigh_joint"
        assert link._examine(record, 5.2).fault is None
    finally:
        link.close()


def test_a_motor_in_the_cold_is_not_hot(a1):
    link = open_connection(a1, UnitreeDdsSettings(interface="lo", domain=unused_domain()))
    try:
        record = STATE.blank()
        record["motor_state"]["temperature"].view(np.uint8)[:12] = 256 - 5  # the byte of -5
        assert np.array_equal(link._examine(record, 5.0).motor_temperature, np.full(12, -5.0))
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
