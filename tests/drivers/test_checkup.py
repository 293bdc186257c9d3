"""Findings of the doctor about sound and faulty robots."""

import dataclasses

import numpy as np
import pytest

from equipoise import EffectSizes, nominal_stance, simulate
from equipoise.drivers import checkup
from equipoise.drivers.checkup import examine, joint_table, watch
from equipoise.errors import CommunicationError
from equipoise.platform.platform import Health
from equipoise.platform.stepped import PlatformWrapper
from equipoise.recording.recording import Recording
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.mujoco import MujocoPlatform
from equipoise.simulation.mujoco_model import build_simulated_robot


class Altered(PlatformWrapper):
    """A robot with altered sensor readings."""

    def __init__(self, inner, change):
        super().__init__(inner)
        self._change = change

    def read(self):
        return self._change(super().read())

    def step(self, command):
        return self._change(super().step(command))


def examined(robot, change=lambda state: state, start="standing"):
    with simulate(robot, "realistic", seed=2, start=start) as simulation:
        findings = examine(Altered(simulation.platform, change), robot, 1.0)
    return {finding.name: finding for finding in findings}


def with_(**changes):
    return lambda state: dataclasses.replace(state, **{name: change(state) for name, change in changes.items()})


@pytest.mark.parametrize("start", ["standing", "lying"])
def test_nothing_speaks_against_a_sound_robot(a1, start):
    findings = examined(a1, start=start)
    assert not [finding for finding in findings.values() if finding.fine is False]
    assert findings["joint samples"].value.startswith("500 Hz")
    assert ("lies" in findings["joint torques"].value) == (start == "lying")


@pytest.mark.parametrize(
    ("name", "change", "advice"),
    [
        ("accelerometer at rest", with_(acceleration_in_imu=lambda s: s.acceleration_in_imu / 9.81), "units of g"),
        (
            "gravity against the stance",
            with_(acceleration_in_imu=lambda s: s.acceleration_in_imu[[1, 2, 0]]),
            "rotated (--imu-rpy ",
        ),
        ("joint torques", with_(joint_torque=lambda s: -s.joint_torque), "with the joints' signs"),
        ("joint positions", with_(joint_position=lambda s: np.degrees(s.joint_position)), "joint map"),
        ("gyroscope at rest", with_(angular_velocity_in_imu=lambda s: s.angular_velocity_in_imu + 0.2), "biased"),
        ("motor temperatures", with_(health=lambda s: Health(np.full(12, 71.0))), "cool down"),
        ("battery charge", with_(health=lambda s: Health(battery_charge=0.1)), "charge it"),
        ("fault", with_(health=lambda s: Health(fault="motor 3 overheated")), "manual"),
    ],
)
def test_what_is_wrong_is_named_with_what_to_do(a1, name, change, advice):
    finding = examined(a1, change)[name]
    assert finding.fine is False
    assert advice in finding.advice


def test_a_robot_without_torques_needs_a_scale(a1):
    finding = examined(a1, with_(joint_torque=lambda s: None))["joint torques"]
    assert (finding.value, finding.fine) == ("not reported", None)


def test_watching_gives_each_sample_once_and_no_commands(a1):
    with simulate(a1, "realistic", seed=2) as simulation:
        whole = Recording.concatenate(list(watch(simulation.platform, a1, 1.1)))
    assert whole.commands is None
    assert np.allclose(np.diff(whole.joints.time), simulation.platform.control_period)
    assert whole.duration == pytest.approx(1.1, abs=0.01)


def test_too_few_samples_are_reported(a1):
    stance = nominal_stance(a1)
    simulated = build_simulated_robot(a1, stance, DrawnErrors.draw(EffectSizes(), 12, 0), None, 1e-3)
    with MujocoPlatform(a1, simulated, stance, control_period=5e-3) as platform:
        findings = {finding.name: finding for finding in examine(platform, a1, 1.0)}
    for name in ("joint samples", "IMU samples"):
        assert findings[name].fine is None
        assert "use 250 Hz or more" in findings[name].advice


def test_a_clock_that_stands_still_ends_the_look(a1, monkeypatch):
    monkeypatch.setattr(checkup, "_PATIENCE", 0.05)
    with simulate(a1, "realistic", seed=2) as simulation:
        stopped = Altered(simulation.platform, with_(time=lambda state: 1.5))
        with pytest.raises(CommunicationError, match=r"time has been 1\.5 s for 0\.05 s: its clock has stopped"):
            examine(stopped, a1)


def test_the_joint_table_has_every_joint_once(a1):
    rows = joint_table(a1, np.zeros(12))
    assert sorted(row[1] for row in rows) == sorted(a1.joint_names)
    assert [row[0] for row in rows][::3] == ["FL", "FR", "RL", "RR"]
