"""The simulated robot's model: the robot's own file, with added actuators, sensors, floor and errors."""

import dataclasses
import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from platform_contract import wave
from robots import FOUR_LEGS, load_text, quadruped_mjcf, quadruped_urdf

from equipoise import EffectSizes, RobotDescription, Trajectory, nominal_stance, simulate
from equipoise.errors import FallError, ModelError, SettingsError
from equipoise.recording.recording import JointStream
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.simulation.effects import REALISTIC
from equipoise.simulation.mujoco import MujocoPlatform
from equipoise.simulation.mujoco_contacts import FLOOR

HEAD = '<compiler angle="radian"/>'
HELD = RobotDescription(locked_joints={"arm_0": 0.7, "arm_1": -0.4})
ROBOTS = {
    "URDF": (quadruped_urdf(), None),
    "URDF of two joints a leg": (quadruped_urdf(joints_per_leg=2), None),
    "URDF with an arm": (quadruped_urdf(arm_joints=2), HELD),
    "URDF with an arm that slides": (
        quadruped_urdf(arm_joints=2, arm_type="prismatic"), RobotDescription(locked_joints={"arm_0": 0.07, "arm_1": -0.04}),
    ),
    "URDF with a spine": (quadruped_urdf(spine=True), RobotDescription(locked_joints={"spine": 0.1})),
    "URDF with turned inertials": (
        quadruped_urdf().replace('<origin xyz="-0.004 0.02 -0.03"/>', '<origin xyz="0 0 -0.03" rpy="0.3 0.4 0.5"/>'), None,
    ),
    "URDF below a world link": (quadruped_urdf(world=True), None),
    "MJCF": (quadruped_mjcf(), None),
    "MJCF with mass from shapes": (quadruped_mjcf(explicit_inertia=False), None),
    "MJCF with an arm": (quadruped_mjcf(arm=True), HELD),
    "MJCF somewhere else": (quadruped_mjcf(attributes='pos="3 -2 9" euler="0.5 1 2"'), None),
}  # fmt: skip

# Everything that a file may bring along of a simulation of its own.
CLUTTERED = quadruped_mjcf(
    head=HEAD
    + '<option timestep="0.02" gravity="0 0 -1" integrator="Euler" iterations="1" ls_iterations="1" solver="PGS" '
    'tolerance="1" density="1000" viscosity="5" wind="9 0 0" cone="pyramidal" impratio="0.1">'
    '<flag gravity="disable" contact="disable" limit="disable" frictionloss="disable" actuation="disable"/></option>'
    '<default><joint damping="7" armature="0.4" stiffness="60" springref="1" frictionloss="3" actuatorfrclimited="true" '
    'actuatorfrcrange="-9 9"/><geom friction="0.01" solref="0.5 1" margin="0.1" condim="1"/></default>',
    attributes='pos="0 0 0.5" gravcomp="1"',
    trunk_extra='<site name="s"/><geom type="box" size="0.5 0.5 0.5" mass="0"/>'
    '<camera name="c"/><light name="l" pos="0 0 1"/>',
    tail="<actuator>"
    + "".join(f'<motor name="{leg}_{j}" joint="{leg}_{j}" ctrlrange="-9 9"/>' for leg in FOUR_LEGS for j in range(3))
    + '</actuator><sensor><accelerometer name="own" site="s"/><gyro site="s"/></sensor>'
    '<keyframe><key name="home" qpos="0 0 0.5 1 0 0 0 0 0.5 -1 0 0.5 -1 0 0.5 -1 0 0.5 -1"/></keyframe>'
    '<equality><joint joint1="FL_0" joint2="FR_0" active="false"/></equality>'
    '<tendon><fixed name="t"><joint joint="FL_1" coef="1"/></fixed></tendon>'
    '<contact><exclude body1="trunk" body2="FL_link_1"/></contact>',
)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    return {name: load_text(tmp_path_factory.mktemp("robot"), *ROBOTS[name]) for name in ROBOTS}


def played(robot, noise="ideal", seed=0):
    with simulate(robot, noise, seed=seed) as simulation:
        return simulation.platform.play(wave(simulation.platform, 100))


def compiled(robot, noise="ideal", **settings):
    platform = simulate(robot, noise, **settings).platform
    return platform._model, platform._simulated


# --- the robot


@pytest.mark.parametrize("name", ROBOTS)
def test_both_engines_read_the_same_robot_from_a_file(robots, name):
    robot = robots[name]
    truth, nominal = simulate(robot, "ideal").truth, nominal_inertia(robot, nominal_stance(robot).joint_position)
    for body in ("composite", "base", "stance_effective"):
        found, expected = getattr(truth, body), getattr(nominal, body)
        assert found.mass == pytest.approx(expected.mass)
        assert np.allclose(found.com, expected.com, rtol=0, atol=1e-9)
        assert np.allclose(found.inertia, expected.inertia, rtol=0, atol=1e-7)


@pytest.mark.parametrize("noise", ["ideal", "realistic"])
@pytest.mark.parametrize("start", ["standing", "lying"])
@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_stands_and_lies_on_the_floor(robots, name, start, noise):
    robot = robots[name]
    stance = nominal_stance(robot)
    with simulate(robot, noise, start=start) as simulation:
        data = simulation.platform._data
        state = simulation.platform.read()
    assert state.time == 0.0
    assert data.qfrc_constraint[2] == pytest.approx(simulation.truth.composite.mass * 9.81, rel=0.01)
    assert np.linalg.norm(state.acceleration_in_imu) == pytest.approx(9.81, abs=0.3)
    assert np.abs(data.qvel).max() < 0.05
    near = np.abs(state.joint_position - stance.joint_position).max() < 0.1
    assert near == (start == "standing")
    height = data.qpos[2] / stance.base_height
    assert 0.95 < height < 1 if start == "standing" else 0.2 < height < 0.7


def test_a_lying_robot_can_stand_up(a1):
    stance = nominal_stance(a1)
    with simulate(a1, "realistic", start="lying") as simulation:
        here = simulation.platform.read().joint_position
        step = np.linspace(0, 1, 500)[:, None]
        simulation.platform.play(Trajectory(here + step * (stance.joint_position - here)))
        assert simulation.platform._data.qpos[2] > 0.9 * stance.base_height


def test_only_feet_and_belly_touch_the_floor(robots):
    model, _ = compiled(robots["MJCF with mass from shapes"])
    touching = {model.geom(index).name for index in range(model.ngeom) if model.geom_contype[index]}
    assert touching == {FLOOR, "equipoise_belly", *(f"equipoise_{leg}_foot" for leg in FOUR_LEGS)}
    feet = [model.geom(f"equipoise_{leg}_foot") for leg in FOUR_LEGS]
    assert all(foot.size[0] == pytest.approx(0.02) for foot in feet)


def test_the_floor_has_the_friction_asked_for(a1):
    model, _ = compiled(a1, EffectSizes(floor_friction=0.4))
    touching = model.geom_contype > 0
    assert np.allclose(model.geom_friction[touching, 0], 0.4)
    assert (model.geom_condim[touching] == 3).all()


def test_the_engine_steps_a_whole_number_of_times_a_period(a1):
    coarse, fine = (simulate(a1, "ideal", timestep=step).platform for step in (1e-3, 0.5e-3))
    assert coarse.control_period == fine.control_period == pytest.approx(2e-3)
    for platform in (coarse, fine):
        assert platform.play(wave(platform, 10)).duration == pytest.approx(9 * 2e-3)
    for timestep in (0.75e-3, 0.0, -1e-3):
        with pytest.raises(SettingsError, match=r"the engine's time step is .* s; the control period of"):
            simulate(a1, "ideal", timestep=timestep)


def test_steps_that_would_soften_contacts_are_refused(a1):
    message = "the engine's time step is 0.002 s; contacts of the feet need 0.001 s or less"
    with pytest.raises(SettingsError, match=f"^{re.escape(message)}$"):
        simulate(a1, "ideal", timestep=2e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"preset": "loud"}, "preset 'loud' does not exist; use one of ideal, realistic, stress, or EffectSizes"),
        ({"start": "sitting"}, "a robot starts 'standing' or 'lying', not 'sitting'"),
        ({"payload": "heavy"}, "payload 'heavy' is not MASS,X,Y,Z"),
    ],
)
def test_invalid_settings_are_rejected(a1, settings, message):
    with pytest.raises(SettingsError, match=message):
        simulate(a1, **settings)


# --- what the file brings along


@pytest.mark.parametrize("noise", ["ideal", "realistic"])
def test_simulation_options_of_a_file_have_no_effect(tmp_path, noise):
    # Torque limits are the robot's; the cluttered file gives some.
    plain = load_text(tmp_path, quadruped_mjcf())
    cluttered = load_text(tmp_path, CLUTTERED, name="cluttered")
    assert cluttered.effort_limit.tolist() == [9.0] * 12
    plain = dataclasses.replace(plain, effort_limit=cluttered.effort_limit)
    one, other = played(plain, noise), played(cluttered, noise)
    for field in dataclasses.fields(JointStream):
        assert np.allclose(getattr(one.joints, field.name), getattr(other.joints, field.name), rtol=0, atol=1e-9)
    assert np.allclose(one.imu.acceleration_in_imu, other.imu.acceleration_in_imu, rtol=0, atol=1e-9)


def test_actuators_sensors_and_keyframes_of_a_file_are_replaced(tmp_path):
    robot = load_text(tmp_path, CLUTTERED)
    model, simulated = compiled(robot)
    assert [model.actuator(index).name for index in range(model.nu)] == list(robot.joint_names)
    sensors = {model.sensor(index).name for index in range(model.nsensor)}
    assert sensors == {"equipoise_accelerometer", *(f"{joint}_torque" for joint in robot.joint_names)}
    assert model.nkey == model.neq == model.ntendon == model.nexclude == 0
    islands = int(getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", 0))
    assert model.opt.disableflags == int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | islands
    assert model.opt.enableflags == 0
    for name in ("iterations", "ls_iterations", "tolerance", "solver", "density", "viscosity"):
        assert getattr(model.opt, name) == getattr(mujoco.MjModel.from_xml_string("<mujoco/>").opt, name)
    assert not model.body_gravcomp.any()
    assert not model.jnt_stiffness.any()
    for losses in (model.dof_frictionloss, model.dof_damping):
        assert not losses.any()
    assert np.allclose(model.dof_armature[simulated.dof], model.opt.timestep * simulated.kd)  # the late part of damping
    assert np.array_equal(simulated.dof, np.sort(simulated.dof))


def test_losses_are_those_asked_for_on_the_leg_joints_alone(tmp_path):
    robot = load_text(tmp_path, CLUTTERED)
    model, simulated = compiled(robot, EffectSizes(coulomb_friction=0.3, viscous_friction=0.05, armature=0.01))
    armature = 0.01 + model.opt.timestep * (simulated.kd + 0.05)  # the late part of damping
    for losses, size in ((model.dof_frictionloss, 0.3), (model.dof_damping, 0.05), (model.dof_armature, armature)):
        assert np.allclose(losses[simulated.dof], size)
        assert not np.delete(losses, simulated.dof).any()


def test_viscous_friction_is_linear_in_speed(tmp_path):
    # Damping became a polynomial in MuJoCo 4: neither the file's nor a higher coefficient may be left in it.
    platform = simulate(load_text(tmp_path, CLUTTERED), EffectSizes(viscous_friction=0.5)).platform
    model, data, dof = platform._model, platform._data, platform._simulated.dof
    for speed in (0.1, 3.0, -10.0):
        data.qvel[dof] = speed
        mujoco.mj_forward(model, data)
        assert np.allclose(data.qfrc_passive[dof], -0.5 * speed, rtol=1e-9)
        assert np.abs(data.qfrc_passive[:6]).max() < 1e-9


def test_no_message_is_printed_while_a_model_is_read(a1, robots, capfd):
    for robot in (a1, robots["URDF"], robots["MJCF"]):
        simulate(robot, "ideal")
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""


# --- actuators


def test_torque_limits_apply_to_reported_torques(a1):
    for errors in (EffectSizes(), EffectSizes(torque_gain=0.1)):
        with simulate(a1, errors) as simulation:
            here = simulation.platform.read().joint_position
            jump = Trajectory(np.repeat((here + 1.0)[None], 50, axis=0))
            torque = simulation.platform.play(jump).joints.torque
        assert np.abs(torque).max() <= a1.effort_limit.max() * (1 + 1e-9)
        assert np.isclose(np.abs(torque).max(axis=0), a1.effort_limit).sum() >= 6


def test_feed_forward_torque_does_not_pass_the_limit(a1):
    with simulate(a1, "ideal") as simulation:
        here = simulation.platform.read().joint_position
        pushed = Trajectory(np.repeat(here[None], 20, axis=0), torque=np.full((20, 12), 500.0))
        torque = simulation.platform.play(pushed).joints.torque
    assert np.abs(torque).max() <= a1.effort_limit.max() * (1 + 1e-9)


def test_a_joint_without_a_limit_has_none(tmp_path):
    robot = load_text(tmp_path, quadruped_mjcf())
    assert np.isinf(robot.effort_limit).all()
    model, _ = compiled(robot)
    assert not model.actuator_forcelimited.any()


def test_gains_are_the_robots_or_the_descriptions(a1, a1_urdf, tmp_path):
    described = load_text(tmp_path, a1_urdf, RobotDescription(kp=80.0, kd=2.0))
    for robot, gains in ((a1, a1.gains(nominal_stance(a1).hip_height)), (described, (80.0, 2.0))):
        model, _ = compiled(robot, EffectSizes(torque_gain=0.05), seed=1)
        scale = model.actuator_gainprm[:, 0] / gains[0]
        assert np.abs(scale - 1).max() > 0.01
        assert np.allclose(model.actuator_biasprm[:, 1], -gains[0] * scale)
        assert np.allclose(model.actuator_biasprm[:, 2], -gains[1] * scale)


# --- masses


@pytest.mark.parametrize("name", ["URDF", "URDF of two joints a leg", "MJCF with an arm"])
def test_leg_links_are_scaled_as_a_whole_and_the_base_is_not(robots, name):
    robot = robots[name]
    (before, simulated), (after, _) = compiled(robot), compiled(robot, EffectSizes(leg_mass=0.1), seed=2)
    errors = simulate(robot, EffectSizes(leg_mass=0.1), seed=2).platform._simulated.errors
    base = before.body_weldid == before.body_weldid[simulated.base_body]
    assert np.array_equal(after.body_mass[base], before.body_mass[base])
    for joint, expected in zip(robot.joint_names, errors.leg_mass_scale, strict=True):
        body = int(before.jnt_bodyid[before.joint(joint).id])
        assert after.body_mass[body] / before.body_mass[body] == pytest.approx(expected)
        assert np.allclose(after.body_inertia[body] / before.body_inertia[body], expected)
    assert np.array_equal(before.body_ipos, after.body_ipos)
    assert after.body_subtreemass[simulated.base_body] == pytest.approx(after.body_mass.sum())


def test_the_truth_includes_the_leg_errors(robots):
    robot = robots["URDF"]
    known, real = simulate(robot, "ideal"), simulate(robot, EffectSizes(leg_mass=0.1), seed=2)
    assert np.array_equal(known.truth.base.inertia, real.truth.base.inertia)
    assert abs(known.truth.composite.mass - real.truth.composite.mass) > 0.01
    assert real.truth.composite.mass == pytest.approx(real.platform._model.body_mass.sum())


# --- the IMU


def rocking(robot, period, duration=0.6, size=0.03):
    """Return joint targets of smooth roll, pitch and yaw over stance feet."""
    stance = nominal_stance(robot)
    position, solved = stance.joint_position, []
    for phase in np.arange(0.0, 1.0, period / duration):
        roll, pitch, yaw = size * np.sin(np.pi * phase) ** 2 * np.sin(2 * np.pi * phase * np.array([2, 3, 4]))
        feet = stance.feet_in_base @ pin.rpy.rpyToMatrix(roll, pitch, yaw)
        position = inverse_kinematics(robot, feet, position)
        solved.append(position)
    return Trajectory(np.array(solved))


def test_the_imu_has_the_pose_of_the_description(a1_urdf, tmp_path):
    rotation = pin.rpy.rpyToMatrix(0.3, -0.5, 2.0)
    straight = load_text(tmp_path, a1_urdf)
    mounted = load_text(tmp_path, a1_urdf, RobotDescription(imu_position=(0.1, 0.02, 0.05), imu_rpy=(0.3, -0.5, 2.0)))
    recordings = []
    for robot in (straight, mounted):
        with simulate(robot, "ideal") as simulation:
            simulated, stance = simulation.platform._simulated, nominal_stance(robot)
            step = simulated.model.opt.timestep
            # A new command at every engine step: accelerations jump at commands that come more rarely.
            with MujocoPlatform(robot, simulated, stance, control_period=step) as smooth:
                recordings.append(smooth.play(rocking(straight, step)))
    (base, imu), time = (recording.imu for recording in recordings), recordings[0].imu.time
    assert np.allclose(imu.angular_velocity_in_imu, base.angular_velocity_in_imu @ rotation, atol=1e-9)
    omega, alpha = base.angular_velocity_in_imu, np.gradient(base.angular_velocity_in_imu, time, axis=0)
    measured = imu.acceleration_in_imu @ rotation.T - base.acceleration_in_imu
    # What an IMU on an arm of 1 m along each axis would feel more; how much of each this one feels is its arm.
    unit = np.array([np.cross(alpha, axis) + np.cross(omega, np.cross(omega, axis)) for axis in np.eye(3)])
    lever, measured = unit[:, 5:-5].reshape(3, -1).T, measured[5:-5].ravel()
    arm = np.linalg.lstsq(lever, measured, rcond=None)[0]
    assert np.allclose(arm, np.array([0.1, 0.02, 0.05]) - straight.imu_in_base.translation, atol=1e-3)
    assert np.linalg.norm(measured - lever @ arm) < 0.02 * np.linalg.norm(measured)


@pytest.mark.parametrize("timestep", [0.5e-3, 1e-3])
@pytest.mark.parametrize("payload", [None, "4,0.03,0.01,0.06"])
def test_stance_feet_hold_while_the_body_shakes(a1, payload, timestep):
    with simulate(a1, "ideal", payload=payload, timestep=timestep) as simulation:
        platform = simulation.platform
        hold = Trajectory(np.repeat(nominal_stance(a1).joint_position[None], 1000, axis=0))
        platform.play(hold)
        before = simulation.ground_truth()
        platform.play(rocking(a1, platform.control_period, duration=1.2, size=0.01))
        platform.play(hold)
        after = simulation.ground_truth()
    assert np.abs(after.feet - before.feet)[:, :2].max() < 15e-6
    assert np.abs(after.clearance).max() < 10e-6


# --- what goes wrong


def test_a_robot_that_cannot_stand_under_its_payload_has_fallen(a1):
    with pytest.raises(
        FallError, match="'unitree_a1' fell over before the first motion; check that its stance is stable"
    ):
        simulate(a1, "ideal", payload="15,0,0.7,0.3")


@pytest.fixture
def no_log(tmp_path, monkeypatch):
    """MuJoCo keeps a log of its warnings in the working directory."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("no_log")
def test_a_diverging_simulation_raises(tmp_path):
    robot = load_text(tmp_path, quadruped_mjcf(), RobotDescription(kd=1e-6, kp=1e9), name="stiff")
    with pytest.raises(FallError, match=r"the simulation of 'stiff' became unstable at t = 0.00 s; check its inertias"):
        simulate(robot, "ideal")


@pytest.mark.usefixtures("no_log")
def test_a_short_divergence_that_the_engine_recovers_from_does_not_pass(tmp_path):
    platform = simulate(load_text(tmp_path, quadruped_mjcf()), "ideal").platform
    torque = np.zeros((500, 12))
    torque[:3] = 1e9
    here = np.repeat(platform.read().joint_position[None], 500, axis=0)
    with pytest.raises(FallError, match=r"the simulation of 'robot' became unstable at t = 0\.00 s"):
        platform.play(Trajectory(here, torque=torque))


def test_a_model_that_the_engine_rejects_raises_model_error(tmp_path):
    # A leg's link without mass: the estimator's engine takes it, the simulator's does not.
    massless = quadruped_urdf().replace('<mass value="0.2"/>', '<mass value="0"/>', 1)
    robot = load_text(tmp_path, massless)
    with pytest.raises(
        ModelError, match=r"MuJoCo cannot make a model of '.*robot': .*mass and inertia of moving bodies"
    ):
        simulate(robot, "ideal")


def test_realistic_errors_of_another_robot_change_with_its_size(robots):
    robot = robots["URDF"]
    scale = nominal_stance(robot).scale
    model, simulated = compiled(robot, "realistic")
    assert model.dof_frictionloss[simulated.dof[0]] == pytest.approx(REALISTIC.scaled_to(scale).coulomb_friction)
