"""Motor estimates of a simulated robot that stands on three feet and swings one leg after the other."""

import dataclasses
import warnings

import numpy as np
import pytest

from equipoise import calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import MissingDependencyError, ReachError, RecordingError, SettingsError
from equipoise.estimator.motors.equations import motor_samples
from equipoise.experiments.one_leg_up import ORDER, legs_in_turn
from equipoise.method.table import method_from_dict
from equipoise.motors.method import Motors
from equipoise.recording.phases import Phase
from equipoise.recording.trials import MotorTrial, read_trial
from equipoise.robot.floor import floor_normal_by_diagonals, floor_normal_of, margin_inside, over_three_feet
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import LEG_NAMES
from equipoise.robot.statics import foot_forces

ON_THREE = Motors(motor_time=8.0, motor_stance="three-feet")


def result_and_recordings(robot, method):
    kept = []
    with simulate(robot, "realistic", seed=5) as simulation:
        result = calibrate(simulation.platform, robot, method, keep=kept.append)
        return result.with_truth_of_parts(simulation.truth_of_parts), kept


@pytest.fixture(scope="module")
def swung(a1):
    return result_and_recordings(a1, ON_THREE)


def assert_found(result):
    for name, most in (("coulomb_friction", 0.05), ("armature", 0.1), ("viscous_friction", 0.15)):
        found = [getattr(joint, name) for joint in result.joints.values()]
        assert np.sqrt(np.mean([(one.error / one.truth) ** 2 for one in found])) < most
    assert max(abs(joint.delay.error) for joint in result.joints.values()) < 0.4e-3
    everything = [one for motor in result.motors.values() for one in motor.quantities.values()]
    assert np.mean([one.missed for one in everything]) < 0.15


def test_motors_match_the_simulation(swung):
    assert_found(swung[0])


def test_a_robot_whose_legs_do_not_turn_up_stands(swung):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            hyq = load_robot("hyq")
    except MissingDependencyError as error:
        pytest.skip(str(error))
    result, kept = result_and_recordings(hyq, Motors())
    assert_found(result)
    assert [one.trial.leg for one in kept] == list(ORDER)


def test_each_leg_swings_with_reduced_gains(a1, swung):
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    for recording, leg in zip(swung[1], ORDER, strict=True):
        assert recording.trial == MotorTrial(kp=kp / 4, kd=kd / 4, leg=leg)
        names = [event.data["name"] for event in recording.events if event.name == "phase"]
        assert names == ["move", "settle", "unload", "lift", "rest", "ramp", "swing", "end", "lower"]
        moved = np.ptp(recording.phase(Phase.SWING).joints.position, axis=0)
        others = [joint for name in LEG_NAMES if name != leg for joint in a1.legs[name].joints]
        assert moved[list(a1.legs[leg].joints)].min() > 0.3
        assert moved[others].max() < 0.06
    assert [trial.about for trial in swung[0].trials] == [f"{leg} leg" for leg in ORDER]


def test_the_com_stays_inside_the_three_feet(a1, swung):
    stance = nominal_stance(a1)
    for up in legs_in_turn(a1, stance):
        assert up.margin > 0.06
        standing = np.delete(up.feet[:, :2], LEG_NAMES.index(up.leg), axis=0)
        assert margin_inside(standing, standing.mean(axis=0)) >= up.margin
        held = foot_forces(a1, up.joint_position, up.standing)[:, 2]
        assert held[[LEG_NAMES.index(leg) for leg in up.standing]].min() > 0.2 * 9.81 * a1.mass
        assert foot_positions(a1, up.joint_position)[LEG_NAMES.index(up.leg), 2] > -stance.base_height + 0.05
    for recording in swung[1]:
        size = np.linalg.norm(recording.imu.acceleration_in_imu, axis=1)
        assert (recording.imu.acceleration_in_imu[:, 2] > np.cos(0.15) * size).mean() > 0.99


def test_a_lifted_foot_does_not_tilt_the_floor():
    feet = np.array([[0.2, 0.1, -0.2], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])
    assert np.allclose(floor_normal_of(feet, (1, 2, 3)), [0, 0, 1])
    assert floor_normal_of(feet, (0, 1, 2, 3)) == floor_normal_by_diagonals(feet)
    assert floor_normal_by_diagonals(feet)[2] < 0.97


def test_a_point_outside_the_feet_has_a_negative_margin():
    corners = np.array([[0.0, 0.0], [0.4, 0.0], [0.0, 0.3]])
    for turn in (corners, corners[::-1]):
        assert margin_inside(turn, np.array([0.1, 0.05])) == pytest.approx(0.05)
        assert margin_inside(turn, np.array([0.1, -0.05])) == pytest.approx(-0.05)
        assert margin_inside(turn, np.array([0.4, 0.3])) == pytest.approx(-0.24)
    four = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    assert np.allclose(over_three_feet(four, 0, 0.9), [-0.3, -0.3])


def test_the_equation_includes_the_base_motion(a1, swung):
    scale = nominal_stance(a1).scale.time
    recording = swung[1][0]
    still = np.zeros_like(recording.imu.angular_velocity_in_imu)
    resting = dataclasses.replace(recording, imu=dataclasses.replace(recording.imu, angular_velocity_in_imu=still))
    moving, still = (motor_samples(a1, [one], scale).regressor for one in (recording, resting))
    assert np.abs(moving - still).max() > 0.01


def test_the_message_names_missing_legs(a1, swung):
    with pytest.raises(RecordingError, match="no complete swing of the FR and RL leg"):
        ON_THREE.estimate(a1, [swung[1][0], swung[1][2]], nominal_stance(a1))


def test_trials_round_trip_also_old_ones():
    one = MotorTrial(kp=20.0, kd=0.5, leg="RR")
    assert read_trial(one.to_data()) == one
    assert read_trial({"kind": "motors", "kp": None, "kd": None}) == MotorTrial()
    assert "leg" not in MotorTrial().to_data()
    with pytest.raises(RecordingError, match="no leg is called 'XX'"):
        read_trial({"kind": "motors", "kp": None, "kd": None, "leg": "XX"})


def test_settings_round_trip_and_are_checked(a1):
    assert method_from_dict(ON_THREE.to_dict()) == ON_THREE
    with pytest.raises(SettingsError, match="motor_stance is 'head'; it must be one of auto, belly, three-feet"):
        Motors(motor_stance="head")
    with pytest.raises(
        SettingsError, match=r"'unitree_a1' swings its legs one after the other, which takes 4.9 s or more"
    ):
        Motors(motor_time=4.0, motor_stance="three-feet").check(a1, nominal_stance(a1))


def test_the_plan_predicts_the_duration(a1, swung):
    course = ON_THREE.rehearse(a1, nominal_stance(a1))
    assert course.duration == pytest.approx(sum(one.duration for one in swung[1]), rel=0.1)
    assert len(course.postures) == 12


def test_a_robot_that_cannot_stand_on_three_feet_raises(two_jointed):
    """Legs of two joints cannot bring the body over them."""
    with pytest.raises(ReachError, match=r"cannot stand on three feet and swing its FL leg: .* Omit motors, or give"):
        Motors(motor_stance="three-feet").check(two_jointed, nominal_stance(two_jointed))
