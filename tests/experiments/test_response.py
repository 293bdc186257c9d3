"""Response test: correctly wired robots pass, and miswired ones are rejected with the cause."""

import dataclasses
import re
import warnings

import numpy as np
import pytest
from miswired import Miswired, wiring
from scipy.spatial.transform import Rotation

from equipoise import BayesianMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.calibration.run_folder import RunFolder
from equipoise.errors import ModelWarning, MotionError, RecordingError
from equipoise.experiments.imu_orientation import wirings
from equipoise.experiments.response import check_base, check_joints, find_orientation, turn_base
from equipoise.experiments.response_test import ResponseTest
from equipoise.experiments.stand import stand_up
from equipoise.json_form import from_json
from equipoise.result.calibration import Calibration
from equipoise.result.legend import frame_message
from equipoise.robot.catalog import CATALOG

ROBOTS = ("unitree_a1", "anymal_c", "solo12")
HIPS = ("FL", "FR", "RL", "RR")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    if CATALOG[request.param].install:
        pytest.skip(f"{request.param} is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # about defects of the model files
        return load_robot(request.param)


def turned(platform, robot):
    """Return the recording of a robot that turns its base."""
    stance = nominal_stance(robot)
    standing, _ = stand_up(platform, robot, stance)
    return turn_base(standing, stance)[0]


@pytest.mark.parametrize(
    ("robot", "preset"),
    [
        (ROBOTS[0], "ideal"),
        (ROBOTS[0], "realistic"),
        (ROBOTS[0], "stress"),
        (ROBOTS[1], "stress"),
        (ROBOTS[2], "realistic"),
    ],
    indirect=["robot"],
)
def test_a_correctly_wired_robot_passes(robot, preset):
    with simulate(robot, preset, seed=7, start="lying") as simulation:
        answered = check_joints(simulation.platform, robot, nominal_stance(robot))
        found = find_orientation(robot, turned(simulation.platform, robot))
        mounted = robot.imu_in_base.rotation @ Rotation.from_rotvec(simulation.errors.drawn["imu_tilt"]).as_matrix()
    error = np.degrees(Rotation.from_matrix(found.rotation.T @ mounted).magnitude())
    assert answered == 12 or preset == "ideal"  # without friction legs sink until links have no room
    assert found.residual < 0.025
    assert error < max(0.5, 2 * np.degrees(found.std))
    assert np.degrees(found.std) < 0.8


def test_a_standing_robot_is_not_moved_joint_by_joint(a1):
    with simulate(a1, "ideal") as simulation:
        before = simulation.platform.read().time
        assert check_joints(simulation.platform, a1, nominal_stance(a1)) == 0
        assert simulation.platform.read().time == before


@pytest.mark.parametrize(("robot", "joint"), [*zip(ROBOTS, (0, 4, 8), strict=True)], indirect=["robot"])
def test_a_joint_with_the_wrong_sign_is_rejected(robot, joint):
    sign = np.ones(12)
    sign[joint] = -1
    with simulate(robot, "realistic", seed=2, start="lying") as simulation:
        platform = Miswired(simulation.platform, sign=sign, sensed=False)
        with pytest.raises(MotionError) as caught:
            check_joints(platform, robot, nominal_stance(robot))
    details = caught.value.details
    assert "sign" in details["cause"]
    assert abs(details["moved"][robot.joint_names[joint]]) > 0.1
    assert f"joint {details['joint']!r} was commanded by" in str(caught.value)
    assert list(details["moved"]) == list(robot.joint_names)


@pytest.mark.parametrize(("robot", "pair"), [*zip(ROBOTS, [(0, 3), (1, 2), (7, 10)], strict=True)], indirect=["robot"])
def test_joints_in_the_wrong_order_are_rejected(robot, pair):
    order = np.arange(12)
    order[list(pair)] = order[list(pair)][::-1]
    with simulate(robot, "realistic", seed=2, start="lying") as simulation:
        platform = Miswired(simulation.platform, order=order, sensed=False)
        with pytest.raises(MotionError) as caught:
            check_joints(platform, robot, nominal_stance(robot))
    moved = caught.value.details["moved"]
    assert max(abs(moved[robot.joint_names[joint]]) for joint in pair) > 0.1
    assert re.search("order of joints is wrong", caught.value.details["cause"])


MISWIRINGS = [
    ("left and right", (), "left and right legs are exchanged"),
    ("front and rear", (), "front and rear legs are exchanged"),
    ("across both diagonals", (), "legs are exchanged across both diagonals"),
    ("none", HIPS, "the signs of the hips FL, FR, RL, RR are wrong"),
    ("none", ("FL", "RL"), "the signs of the hips FL, RL are wrong"),
    ("none", ("FL", "FR"), "the signs of the hips FL, FR are wrong"),
    ("left and right", HIPS, "left and right legs are exchanged and the signs of the hips FL, FR, RL, RR are wrong"),
]


@pytest.mark.parametrize(
    ("robot", "number"),
    [("unitree_a1", number) for number in range(7)] + [("anymal_c", 1), ("solo12", 6)],
    indirect=["robot"],
)
def test_consistent_miswiring_is_named_by_the_gyroscope(robot, number, request):
    """Every miswiring on the A1, one on each other robot; each preset on the A1."""
    exchange, hips, cause = MISWIRINGS[number]
    preset = ("realistic", "stress")[(number + ROBOTS.index(request.node.callspec.params["robot"])) % 2]
    with simulate(robot, preset, seed=1) as simulation:
        recording = turned(Miswired(simulation.platform, *wiring(robot, exchange, hips)), robot)
    with pytest.raises(MotionError, match="the gyroscope contradicts the joints") as caught:
        find_orientation(robot, recording)
    assert any(named.startswith(cause + " (") for named in caught.value.details["causes"])
    assert len(caught.value.details["causes"]) <= 3


def test_hypotheses_begin_with_the_model_and_are_all_different(a1, two_jointed):
    causes = [one.cause for one in wirings(a1)]
    assert causes[0] == ""
    assert len(set(causes)) == len(causes) == 64
    assert len([*wirings(two_jointed)]) == 4


def test_legs_of_two_joints_turn_in_pitch_alone(two_jointed):
    stance = nominal_stance(two_jointed)
    with simulate(two_jointed, "realistic", seed=3) as simulation:
        standing, _ = stand_up(simulation.platform, two_jointed, stance)
        test = check_base(standing, stance, 0, None)
    assert test.axes == ("pitch",)
    assert np.degrees(test.angle) < 2


@pytest.mark.parametrize(
    ("robot", "rpy"),
    [("unitree_a1", rpy) for rpy in ((0, 0, 180), (180, 0, 0))] + [(name, (20, -30, 140)) for name in ROBOTS],
    indirect=["robot"],
)
def test_a_turned_imu_is_measured_and_used_once_confirmed(robot, rpy):
    mounted = Rotation.from_euler("xyz", rpy, degrees=True).as_matrix()
    stance, asked = nominal_stance(robot), []
    with simulate(robot, "realistic", seed=5) as simulation:
        standing, _ = stand_up(Miswired(simulation.platform, imu=mounted.T), robot, stance)
        test = check_base(standing, stance, 0, lambda question: asked.append(question) or True)
        tilt = Rotation.from_rotvec(simulation.errors.drawn["imu_tilt"]).as_matrix()
    expected = robot.imu_in_base.rotation @ tilt @ mounted
    used = np.array(standing.robot.imu_in_base.rotation)
    assert np.degrees(Rotation.from_matrix(used.T @ expected).magnitude()) < 1
    assert test.uses_measurement
    assert "Is the measured orientation right?" in asked[0]


def test_a_turned_imu_that_is_not_confirmed_ends_the_run(a1):
    mounted = Rotation.from_euler("xyz", (20, -30, 140), degrees=True).as_matrix()
    stance = nominal_stance(a1)
    with simulate(a1, "realistic", seed=5) as simulation:
        standing, _ = stand_up(Miswired(simulation.platform, imu=mounted.T), a1, stance)
        with pytest.raises(MotionError, match=r"not confirmed, and no foot was lifted.*--imu-rpy "):
            check_base(standing, stance, 0, None)


def test_a_run_with_a_turned_imu_is_estimated_again_with_the_orientation_found(a1, tmp_path):
    mounted = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    method, kept = BayesianMethod(duration=30, excitation=False), []
    with simulate(a1, "realistic", "1.5,0.1,0,0.08", 4, "lying") as simulation:
        with RunFolder.create(tmp_path / "run", a1, method, {"time": "now"}) as folder:
            result = calibrate(
                Miswired(simulation.platform, imu=mounted.T), a1, method,
                lambda recording: (kept.append(recording), folder.keep(recording)),
                confirm=lambda question: True, on_response=folder.save_response,
            )  # fmt: skip
        truth = simulation.truth.composite.com
    folder.save(result.with_provenance(**folder.provenance))
    assert np.abs(result.composite.com_in_base.values - truth)[:2].max() < 4e-3
    assert all(recording.trial is not None for recording in kept)  # the response test is not a trial
    again = RunFolder.open(tmp_path / "run")
    test = from_json(ResponseTest, again.provenance["response_test"])
    assert test.uses_measurement
    assert test.joints == 12
    assert np.degrees(test.angle) == pytest.approx(90, abs=1)
    assert again.robot().description.imu_rpy == test.measured_rpy
    assert again.estimate().composite.com_in_base.values == pytest.approx(result.composite.com_in_base.values, abs=1e-7)
    stored = Calibration.load(tmp_path / "run" / "calibration.json")
    assert from_json(ResponseTest, stored.provenance["response_test"]) == test
    assert f" {test.message}." in frame_message(stored)


def test_a_resumed_run_keeps_the_orientation_of_its_trials(a1, tmp_path, bayesian_run):
    method = bayesian_run.settings
    passed = ResponseTest(0, ("roll", "pitch", "yaw"), 0.01, (0.0, 0.0, 1.5), 0.01, (0.0, 0.0, 0.0), True)
    folder = RunFolder.create(tmp_path / "run", a1, method, {"time": "now"})
    folder.save_response(passed)
    folder.keep(bayesian_run.recordings[0])
    folder.close()
    folder, content = RunFolder.resume(tmp_path / "run", repeats=False)
    assert len(content.recordings) == 1
    folder.save_response(dataclasses.replace(passed, model_rpy=passed.measured_rpy, uses_measurement=False))
    with pytest.raises(RecordingError, match="from the orientation of the trials"):
        folder.save_response(dataclasses.replace(passed, measured_rpy=(0.0, 0.0, 0.1)))
    folder.close()
    assert RunFolder.open(tmp_path / "run").robot().description.imu_rpy == (0.0, 0.0, 1.5)
