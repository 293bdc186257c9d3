"""Every limit of the doctor, from both sides: what is just fine, and what is not by little. `make mutants` loosens them."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from equipoise import nominal_stance, simulate
from equipoise.drivers import checkup
from equipoise.errors import CommunicationError
from equipoise.platform.platform import Health
from equipoise.robot.model import LEG_NAMES
from equipoise.robot.stance import lying_posture
from equipoise.robot.statics import static_torques


@pytest.fixture(scope="module")
def home(a1):
    return nominal_stance(a1).joint_position


def leaning(angle):
    """(3,) accelerometer at rest on a base that leans forward by an angle [deg]."""
    return 9.81 * np.array(pin.rpy.rpyToMatrix(np.radians([0.0, angle, 0.0])))[2]


@pytest.mark.parametrize(("rate", "fine"), [(260.0, True), (240.0, None), (180.0, None), (105.0, None), (90.0, False)])
def test_rates(rate, fine):
    assert checkup._rate("joint samples", np.arange(200) / rate).fine is fine


@pytest.mark.parametrize(("late", "fine"), [(4.5e-3, True), (6e-3, False)])
def test_jitter(late, fine):
    times = np.arange(200) * 2e-3
    times += late * np.cumsum(np.arange(200) % 20 == 0)
    assert checkup._rate("IMU samples", times).fine is fine
    (arrival,) = checkup._arrival(times, np.arange(200) * 2e-3)
    assert arrival.fine is fine


@pytest.mark.parametrize(("beyond", "fine"), [(0.09, True), (0.12, False)])
def test_joint_positions(a1, home, beyond, fine):
    position = home.copy()
    position[2] = a1.upper_limit[2] + beyond
    (finding,) = checkup._limits(a1, position[None])
    assert finding.fine is fine


@pytest.mark.parametrize(("bias", "noise", "fine"), [
    (0.045, 0.0, True), (0.06, 0.0, False), (0.0, 0.055, True), (0.0, 0.07, False),
])  # fmt: skip
def test_a_gyroscope_at_rest(bias, noise, fine):
    readings = np.zeros((200, 3))
    readings[:, 1] = bias + noise * np.tile([1.0, -1.0], 100)
    assert checkup._still(readings).fine is fine


@pytest.mark.parametrize(("posture", "angle", "fine"), [
    ("standing", 5.5, True), ("standing", 7.0, False), ("lying", 33.0, None), ("lying", 38.0, False),
])  # fmt: skip
def test_gravity_against_the_stance(a1, home, posture, angle, fine):
    position = home if posture == "standing" else lying_posture(a1, nominal_stance(a1))[0]
    assert checkup._floor(a1, position, leaning(angle)).fine is fine


@pytest.mark.parametrize(("share", "fine"), [(0.55, False), (0.65, True), (1.6, True), (1.85, False)])
def test_the_mass_that_torques_carry(a1, home, share, fine):
    torque = share * static_torques(a1, home, LEG_NAMES)
    assert checkup._torque(a1, home, torque[None]).fine is fine


def test_temperature_and_battery(a1):
    hot, empty = ([Health(motor_temperature=np.full(12, value)) for value in (59.0, 62.0)],
                  [Health(battery_charge=value) for value in (0.32, 0.28)])  # fmt: skip
    for states in (hot, empty):
        assert [[finding.fine for finding in checkup._health(a1, state)] for state in states] == [[True], [False]]


def test_a_clock_that_stands_still_is_given_three_seconds(a1, home, monkeypatch):
    now = [0.0]
    state = SimpleNamespace(time=1.0, received=0.0, earlier=(), joint_position=home)
    robot = SimpleNamespace(read=lambda: state, control_period=0.01)
    monkeypatch.setattr(checkup, "time", SimpleNamespace(
        monotonic=lambda: now[0], sleep=lambda duration: now.__setitem__(0, now[0] + duration)
    ))  # fmt: skip
    with pytest.raises(CommunicationError, match="its clock has stopped"):
        next(checkup.watch(robot, a1, 5.0))
    assert 2.9 < now[0] < 3.2


def test_whether_a_cable_is_attached_is_asked(a1):
    with simulate(a1, "ideal") as simulation:
        (asked,) = (finding for finding in checkup.examine(simulation.platform, a1, 0.1) if finding.name == "cable")
    assert asked.fine is None
    assert asked.value.startswith("is one attached?")
    assert "--cable none" in asked.advice
