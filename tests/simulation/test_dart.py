"""The simulated robot in DART: platform contract, agreement with MuJoCo, and contacts."""

import itertools
import subprocess
import sys
import warnings

import numpy as np
import pinocchio as pin
import pytest
from platform_contract import PlatformContract, wave
from robots import load_text, quadruped_mjcf, quadruped_urdf
from test_truth import BENT, CLASSES, FRAMES, ORIENTATIONS, PARTS, PAYLOAD, RADIAN, SAME_IN_BOTH, SHAPES, TOLERANCE

from equipoise import (
    ComSearchSettings,
    EffectSizes,
    ExcitationSettings,
    PaperMethod,
    RobotDescription,
    Trajectory,
    calibrate,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.errors import FallError, ModelError, SettingsError
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.mujoco_model import build_simulated_robot
from equipoise.simulation.mujoco_truth import simulated_truth
from equipoise.simulation.simulated import PERIODS_BETWEEN_STOP_TESTS

pytest.importorskip("dartpy", reason="DART is an extra: pip install 'equipoise[dart]'")

from equipoise.lab.dart.dart_model import build_dart_robot
from equipoise.lab.dart.dart_platform import DartPlatform
from equipoise.lab.dart.dart_truth import dart_truth

ENGINES = ("mujoco", "dart")
BODIES = ("composite", "base", "stance_effective")


class TestDart(PlatformContract):
    tolerances = dict.fromkeys(PlatformContract.tolerances, 1e-8)
    interrupted_method = "_roll"
    periods_between_stop_tests = PERIODS_BETWEEN_STOP_TESTS

    @pytest.fixture(autouse=True)
    def _robot(self, a1):
        self.robot = a1

    def make(self):
        return simulate(self.robot, "realistic", seed=3, timestep=1e-3, engine="dart").platform


@pytest.fixture
def platform(a1):
    with simulate(a1, "ideal", engine="dart") as simulation:
        yield simulation.platform


def test_the_robot_in_dart_fulfils_the_platform_contract(platform):
    public = {name for name in dir(platform) if not name.startswith("_")}
    assert public == {"control_period", "joint_names", "accepts", "read", "step", "play", "close"}


def test_a_motion_interrupted_inside_the_engine_has_not_begun(platform, a1, monkeypatch):
    motion = wave(platform, 60)
    with simulate(a1, "ideal", engine="dart") as simulation:
        expected = simulation.platform.play(motion)
    step, count = platform._imu, itertools.count()

    def interrupted(*arguments):
        if next(count) == 0:
            raise KeyboardInterrupt
        return step(*arguments)

    monkeypatch.setattr(platform, "_imu", interrupted)
    with pytest.raises(KeyboardInterrupt):
        platform.play(motion)
    # The engine's solver starts from where it ended last, and so ends elsewhere within its tolerance.
    assert np.allclose(platform.play(motion).joints.position, expected.joints.position, rtol=0, atol=1e-9)


# --- the robot


def assert_same_robot(robot, payload=None, **sizes):
    """Assert equal inertias in DART, MuJoCo and the model file, leg errors included."""
    stance = nominal_stance(robot)
    position = stance.joint_position
    errors = DrawnErrors.draw(EffectSizes(**sizes), len(robot.joint_names), 2)
    in_dart = dart_truth(robot, build_dart_robot(robot, stance, errors, payload), position)
    in_mujoco = simulated_truth(robot, build_simulated_robot(robot, stance, errors, payload, 1e-3), position)
    nominal = nominal_inertia(robot, position)
    for body in BODIES:
        found, expected = getattr(in_dart, body), getattr(in_mujoco, body)
        assert found.mass == pytest.approx(expected.mass, rel=1e-9)
        np.testing.assert_allclose(found.com, expected.com, atol=TOLERANCE)
        np.testing.assert_allclose(found.inertia, expected.inertia, rtol=1e-9, atol=TOLERANCE)
        if not sizes:
            modelled = getattr(nominal, body)
            modelled = modelled if payload is None else modelled + payload.parameters
            np.testing.assert_allclose(found.com, modelled.com, atol=1e-9)
            np.testing.assert_allclose(found.inertia, modelled.inertia, rtol=1e-9, atol=1e-9)


FIRST = '<joint name="arm_0" axis="0 1 0"/>'
SECOND_JOINT = (FIRST, FIRST + '<joint name="arm_0b" axis="1 0 0"/>')
MORE = {
    "MJCF, joints off their bodies": (quadruped_mjcf().replace('name="FL_1"', 'name="FL_1" pos="0.01 0.02 0.03"'), None),
    "MJCF, frames and classes": (quadruped_mjcf(head=CLASSES, trunk_extra=FRAMES), None),
    "MJCF, a body of several joints": (quadruped_mjcf(arm=True).replace(*SECOND_JOINT), None),
    "MJCF, sliding arm": (quadruped_mjcf(arm=True).replace('joint name="arm_', 'joint type="slide" name="arm_'), BENT),
    **{text: (quadruped_mjcf(trunk_extra=PARTS.format(text)), None) for text in ORIENTATIONS},
    **{
        shape: (quadruped_mjcf(head=RADIAN, trunk_extra=f'<body name="part" pos="0.1 0 0"><geom {shape}/></body>'), None)
        for shape in SHAPES
    },
}  # fmt: skip


@pytest.mark.parametrize("name", [*SAME_IN_BOTH, *MORE])
def test_dart_has_the_robot_that_mujoco_reads(tmp_path, name):
    text, description = {**SAME_IN_BOTH, **MORE}[name]
    assert_same_robot(load_text(tmp_path, text, description), PAYLOAD)


@pytest.mark.parametrize("text", [quadruped_urdf(arm_joints=2), quadruped_mjcf(arm=True)], ids=["URDF", "MJCF"])
def test_leg_errors_are_in_the_truth_as_in_mujoco(tmp_path, text):
    assert_same_robot(load_text(tmp_path, text, BENT), PAYLOAD, leg_mass=0.1)


@pytest.mark.parametrize("name", ["unitree_a1", "go2", "anymal_c", "solo12", "solo8", "hyq"])
def test_catalogue_robots_are_the_same_in_dart(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            robot = load_robot(name)
        except ImportError as error:
            pytest.skip(str(error))
    assert_same_robot(robot)


def test_dart_prints_nothing_while_a_model_is_read(a1, tmp_path, capfd):
    for robot in (a1, load_text(tmp_path, quadruped_urdf(arm_joints=2)), load_text(tmp_path, quadruped_mjcf())):
        simulate(robot, "ideal", payload="1,0.1,0,0.05", engine="dart").platform.close()
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""


def test_a_model_that_dart_rejects_raises_model_error(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf().replace('<mass value="0.2"/>', '<mass value="0"/>', 1))
    with pytest.raises(ModelError, match=r"DART cannot make a model of '.*robot': link 'FL_link_2' has no mass"):
        simulate(robot, "ideal", engine="dart")


def test_an_unknown_engine_is_rejected(a1):
    with pytest.raises(SettingsError, match="engine 'bullet' is unknown; it must be one of mujoco, dart"):
        simulate(a1, "ideal", engine="bullet")


# --- the same senses as in MuJoCo


@pytest.fixture(scope="module")
def robots(tmp_path_factory, a1):
    folder = tmp_path_factory.mktemp("robots")
    arm = RobotDescription(locked_joints=BENT.locked_joints, imu_position=(0.1, -0.05, 0.06), imu_rpy=(0.3, -0.5, 2.0))
    return {
        "A1": a1,
        "URDF, two joints a leg": load_text(folder, quadruped_urdf(joints_per_leg=2), name="two"),
        "MJCF, arm, IMU rotated": load_text(folder, quadruped_mjcf(arm=True), arm, name="arm"),
    }


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("A1", "standing"),
        ("A1", "lying"),
        ("URDF, two joints a leg", "lying"),
        ("MJCF, arm, IMU rotated", "standing"),
    ],
)
def test_robots_rest_in_dart_as_in_mujoco(robots, name, start):
    states, seen = [], []
    for engine in ENGINES:
        with simulate(robots[name], "realistic", PAYLOAD, 1, start, engine=engine) as simulation:
            states.append(simulation.platform.read())
            seen.append(simulation.ground_truth())
    one, other = states
    # Friction holds the joints anywhere between what gravity and their control ask for.
    assert np.abs(one.joint_position - other.joint_position).max() < 0.02
    assert np.allclose(one.acceleration_in_imu, other.acceleration_in_imu, atol=0.15)
    assert np.allclose(one.angular_velocity_in_imu, other.angular_velocity_in_imu, atol=2e-3)
    assert seen[0].time == seen[1].time == 0
    assert np.allclose(seen[0].feet, seen[1].feet, atol=5e-3)
    assert np.allclose(seen[0].com, seen[1].com, atol=5e-3)
    assert np.abs(seen[1].clearance).max() < 1e-6  # MuJoCo's feet are pressed in by 0.2 mm
    assert seen[0].tilt == pytest.approx(seen[1].tilt, abs=5e-3)


def rocking(robot, duration=0.6, size=0.03, period=2e-3):
    """Return joint targets of smooth roll, pitch and yaw over stance feet."""
    stance = nominal_stance(robot)
    position, solved = stance.joint_position, []
    for phase in np.arange(0.0, 1.0, period / duration):
        roll, pitch, yaw = size * np.sin(np.pi * phase) ** 2 * np.sin(2 * np.pi * phase * np.array([2, 3, 4]))
        position = inverse_kinematics(robot, stance.feet_in_base @ pin.rpy.rpyToMatrix(roll, pitch, yaw), position)
        solved.append(position)
    return Trajectory(np.array(solved))


def moved(robot, motion, engine, **sizes):
    with simulate(robot, EffectSizes(**sizes), PAYLOAD, 1, engine=engine) as simulation:
        return simulation.platform.play(motion)


DRIVE_TRAIN = {"viscous_friction": 0.3, "armature": 0.02, "torque_gain": 0.05, "leg_mass": 0.05}


@pytest.mark.parametrize(("name", "sizes"), [("A1", {}), ("A1", DRIVE_TRAIN), ("MJCF, arm, IMU rotated", DRIVE_TRAIN)])
def test_sensors_of_a_rocking_robot_agree_with_mujoco(robots, name, sizes):
    motion = rocking(robots[name])
    one, other = (moved(robots[name], motion, engine, **sizes) for engine in ENGINES)
    for stream, field, part in (
        ("joints", "position", 0.01), ("joints", "velocity", 0.05), ("joints", "torque", 0.05),
        ("imu", "angular_velocity_in_imu", 0.03), ("imu", "acceleration_in_imu", 0.08),
    ):  # fmt: skip
        expected = getattr(getattr(one, stream), field)
        off = getattr(getattr(other, stream), field) - expected
        assert off.std() < part * expected.std(), field


def test_joint_friction_agrees_with_mujoco(robots):
    motion = rocking(robots["A1"])
    rough, smooth = ([moved(robots["A1"], motion, engine, **sizes) for engine in ENGINES]
                     for sizes in ({"coulomb_friction": 0.5}, {}))  # fmt: skip
    effect = [a.joints.torque - b.joints.torque for a, b in zip(rough, smooth, strict=True)]
    assert effect[0].std() > 0.2
    assert np.corrcoef(effect[0].ravel(), effect[1].ravel())[0, 1] > 0.8
    assert effect[0].std() == pytest.approx(effect[1].std(), rel=0.2)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_displaced_imu_measures_the_lever_acceleration(a1, engine):
    motion, offset = rocking(a1), DrawnErrors.draw(EffectSizes(imu_position=0.05), 12, 1).drawn["imu_position"]
    one, other = (moved(a1, motion, engine, imu_position=size).imu for size in (0.0, 0.05))
    turning = one.angular_velocity_in_imu
    faster = np.gradient(turning, one.time, axis=0)
    carried = np.cross(faster, offset) + np.cross(turning, np.cross(turning, offset))
    assert np.array_equal(turning, other.angular_velocity_in_imu)
    off = other.acceleration_in_imu - one.acceleration_in_imu - carried
    assert off[50:].std() < 0.05 * carried[50:].std()  # the first joints' jump is too fast to be differentiated


# --- rotors, which DART does not have


def in_the_air(robot, engine, armature):
    """Return the displacement of the joints on their way to a target, feet in the air."""
    # MuJoCo's damping is implicit and DART's is not; in short steps that is the same.
    with simulate(robot, EffectSizes(armature=armature), timestep=0.1e-3, engine=engine) as simulation:
        platform, stance = simulation.platform, nominal_stance(robot)
        platform._place(stance.joint_position, stance.base_height + 5)
        begin = platform.read().joint_position
        jump = Trajectory(np.repeat((begin + 0.1)[None], 15, axis=0))
        return platform.play(jump).joints.position - begin


def test_rotor_inertia_agrees_with_mujoco_in_the_air(a1):
    with_rotors, without = ([in_the_air(a1, engine, armature) for engine in ENGINES] for armature in (0.02, 0.0))
    slower = np.abs(with_rotors[0] - without[0]).max()
    assert slower > 0.01
    for one, other in (with_rotors, without):
        assert np.abs(one - other).max() < 0.05 * slower


def test_rotors_add_no_weight_to_a_standing_robot(a1):
    torques = []
    for armature in (0.0, 0.02):
        with simulate(a1, EffectSizes(armature=armature), engine="dart") as simulation:
            here = np.repeat(nominal_stance(a1).joint_position[None], 1500, axis=0)
            torques.append(simulation.platform.play(Trajectory(here)).joints.torque[-200:].mean(axis=0))
    assert np.abs(torques[0] - torques[1]).max() < 0.01


def test_a_robot_in_free_fall_conserves_momentum(a1):
    with simulate(a1, EffectSizes(armature=0.02), PAYLOAD, engine="dart") as simulation:
        platform, stance = simulation.platform, nominal_stance(a1)
        platform._place(stance.joint_position, stance.base_height + 5)
        com = simulation.ground_truth().com
        recording = platform.play(wave(platform, 100))
        fallen = com - simulation.ground_truth().com
    duration = 100 * platform.control_period
    assert np.allclose(fallen, [0, 0, 9.81 * duration**2 / 2], atol=2e-3)  # half a step of the engine is worth 0.5 mm
    assert np.abs(recording.imu.acceleration_in_imu.mean(axis=0)).max() < 0.3


# --- contacts


def test_stance_feet_do_not_slide(a1):
    with simulate(a1, "realistic", engine="dart") as simulation:
        here = np.repeat(nominal_stance(a1).joint_position[None], 500, axis=0)
        before = simulation.ground_truth().feet
        simulation.platform.play(Trajectory(here))
        assert np.abs(simulation.ground_truth().feet - before).max() < 1e-6


@pytest.mark.parametrize("seed", [3, 4])  # down the slope to the front left, and to the front
def test_feet_hold_on_a_slope_up_to_the_friction_of_the_floor(a1, seed):
    slid = []
    for slope in (0.44, 0.56):
        sizes = EffectSizes(floor_friction=0.5, floor_slope=float(np.arctan(slope)), coulomb_friction=0.3)
        with simulate(a1, sizes, seed=seed, engine="dart") as simulation:
            before = simulation.ground_truth().feet
            simulation.platform.play(Trajectory(np.repeat(nominal_stance(a1).joint_position[None], 100, axis=0)))
            slid.append(np.abs(simulation.ground_truth().feet - before).max())
    assert slid[0] < 1e-4
    assert slid[1] > 0.05


def test_no_foot_is_lost_while_the_body_moves(a1, monkeypatch):
    with simulate(a1, "realistic", engine="dart") as simulation:
        platform, contacts = simulation.platform, []
        original = platform._step_once

        def counted(*arguments):
            original(*arguments)
            contacts.append(platform._contacts)

        monkeypatch.setattr(platform, "_step_once", counted)
        platform.play(rocking(a1, duration=1.2))
    assert set(contacts) == {4}


def test_a_foot_that_is_lifted_leaves_the_floor(a1):
    stance = nominal_stance(a1)
    lifted = stance.feet_in_base + np.array([[0, 0, 0.02], [0, 0, 0], [0, 0, 0], [0, 0, 0.02]])
    share = (1 - np.cos(np.linspace(0, np.pi, 150)))[:, None] / 2
    target = inverse_kinematics(a1, lifted, stance.joint_position)
    with simulate(a1, "ideal", engine="dart") as simulation:
        simulation.platform.play(Trajectory(stance.joint_position + share * (target - stance.joint_position)))
        clearance = simulation.ground_truth().clearance
    assert clearance[[0, 3]].max() > 2e-3


# --- time steps, and what goes wrong


def test_light_legs_get_a_shorter_step(a1, tmp_path):
    usual, damped = (build_dart_robot(robot, nominal_stance(robot), errors, None) for robot, errors in (
        (a1, DrawnErrors.draw(EffectSizes(), 12, 0)), (a1, DrawnErrors.draw(EffectSizes(viscous_friction=12.0), 12, 0))
    ))  # fmt: skip
    assert usual.world.getTimeStep() == 0.5e-3
    assert damped.world.getTimeStep() < 0.5e-3
    with pytest.raises(SettingsError, match=r"the engine's time step is 0\.0015 s; the control period of"):
        simulate(a1, "ideal", timestep=1.5e-3, engine="dart")


def test_a_robot_that_cannot_stand_under_its_payload_has_fallen_in_dart(a1):
    with pytest.raises(
        FallError, match="'unitree_a1' fell over before the first motion; check that its stance is stable"
    ):
        simulate(a1, "ideal", payload="15,0,0.7,0.3", engine="dart")


def test_a_diverging_simulation_in_dart_raises(tmp_path):
    robot = load_text(tmp_path, quadruped_mjcf(), RobotDescription(kd=1e-6, kp=1e9), name="stiff")
    with pytest.raises(
        FallError, match=r"the simulation of 'stiff' became unstable at t = 0.0\d s; check its inertias"
    ):
        simulate(robot, "ideal", engine="dart")


# --- the routine


def test_dart_needs_no_mujoco():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from equipoise import load_robot, simulate\n"
        "with simulate(load_robot('unitree_a1'), engine='dart') as simulation: simulation.platform.read()"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_a_calibration_in_dart_finds_the_centre_of_mass(a1):
    with simulate(a1, "realistic", "1.5,0.05,-0.02,0.06", seed=4, timestep=1e-3, engine="dart") as simulation:
        settings = PaperMethod(
            com_search=ComSearchSettings(tolerance=0.01), excitation=ExcitationSettings(duration=1.0)
        )
        result = calibrate(simulation.platform, a1, settings).with_truth(simulation.truth)
    assert np.abs(result.composite.com_in_base.errors[:2]).max() < 6e-3
    assert result.excitations["yaw"].moment == pytest.approx(simulation.truth.stance_effective.inertia[2, 2], rel=0.4)


def test_a_platform_may_be_made_with_another_control_period(a1):
    stance = nominal_stance(a1)
    simulated = build_dart_robot(a1, stance, DrawnErrors.draw(EffectSizes(), 12, 0), None)
    with DartPlatform(a1, simulated, stance, control_period=1e-3) as platform:
        assert platform.play(wave(platform, 11)).duration == pytest.approx(10e-3)
