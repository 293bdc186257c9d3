"""Effects of the simulated robot: sizes, independent draws, and errors by name."""

import dataclasses
import hashlib
from types import SimpleNamespace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robots import load_text, on_cylinders

from equipoise import EffectSizes, JointCommand, Trajectory, nominal_stance, simulate
from equipoise.conventions import GRAVITY
from equipoise.errors import SettingsError
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.inertial import InertialParameters, composite_parameters, nominal_inertia
from equipoise.robot.scale import Scale
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import PRESETS, REALISTIC, STRESS, read_effects
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.mujoco_contacts import foot_geoms, foot_name
from equipoise.simulation.mujoco_drive import ChangingFriction, spring_constraint, spring_name
from equipoise.simulation.mujoco_loads import SLING, SWINGING_LOAD, WATER
from equipoise.simulation.mujoco_model import build_simulated_robot
from equipoise.simulation.mujoco_truth import simulated_truth
from equipoise.simulation.samples import Samples

pytestmark = pytest.mark.usefixtures("fine_engine")

ROWS = EffectSizes.rows()
JOINTS, SEED, PERIOD = 12, 5, 2e-3
LEG_EFFECTS = (
    "leg_mass", "leg_mass_common", "leg_com", "leg_com_common", "leg_inertia", "leg_length", "leg_length_common",
    "hip_position",
)  # fmt: skip


def drawn(sizes, seed=SEED):
    return DrawnErrors.draw(sizes, JOINTS, seed)


def engine(simulation):
    """The engine's own model and state, and the simulated robot."""
    platform = simulation.platform
    return SimpleNamespace(model=platform._model, data=platform._data, simulated=platform._simulated)


def standing(robot, preset="ideal", seed=SEED, **effects):
    """A robot that stands, behind a forward step: contacts and forces are of the present."""
    with simulate(robot, preset, seed=seed, effects=effects) as simulation:
        simulation.platform.play(Trajectory(np.tile(nominal_stance(robot).joint_position, (250, 1))))
        seen = engine(simulation)
        seen.errors, seen.truth = simulation.errors, simulation.truth
        seen.ground_truth = simulation.ground_truth()
        mujoco.mj_forward(seen.model, seen.data)
        return seen


def foot_forces(seen):
    """Return each contact's record, force and moment in its axes; the first axis is the normal."""
    found = []
    for index, contact in enumerate(seen.data.contact):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(seen.model, seen.data, index, wrench)
        found.append((contact, wrench))
    assert len(found) == 4
    return found


# --- the table


def test_every_row_has_a_meaning_and_a_source():
    assert len({row.name for row in ROWS}) == len(ROWS)
    for row in ROWS:
        assert row.meaning, row.name
        assert row.source, row.name
        assert row.engines[0] == "mujoco"
        assert row.size_alone != row.none or row.realistic, f"{row.name} has no size to try it with"


def test_stress_has_all_of_realistic_and_more():
    assert {name for name, size in dataclasses.asdict(STRESS).items() if size} > {
        name for name, size in dataclasses.asdict(REALISTIC).items() if size and name != "imu_clock_offset"
    }
    alone = {row.name for row in ROWS if row.in_stress == row.none}
    assert alone == {
        "imu_clock_offset", "stribeck", "leg_inertia", "joint_axes", "imu_position", "gyro_drift", "sample_rate",
        "encoder_eccentricity", "swinging_load", "sling", "foot_width", "foot_oval", "foot_flat", "foot_position", "gyro_lag",
        "vertical_pull", "hose", "slosh",
    }  # fmt: skip


def test_sizes_scale_with_the_measure_of_their_row():
    scaled = STRESS.scaled_to(Scale(length=2.0, torque=12.0))
    for name, factor in (("springs", 12), ("foot_stiffness", 3), ("hip_position", 2), ("cable", 1), ("gyro_gain", 1)):
        assert getattr(scaled, name) == pytest.approx(factor * getattr(STRESS, name)), name
    assert STRESS.with_effects({"swinging_load": None}, Scale(2.0, 12.0)).swinging_load == pytest.approx(0.6)
    loads = STRESS.with_effects({"vertical_pull": None, "hose": None}, Scale(2.0, 12.0))
    assert (loads.vertical_pull, loads.hose) == pytest.approx((-18, 60))


def test_half_a_spring_is_twice_as_stiff_and_none_of_it_is_rigid():
    assert STRESS.times({"springs": 0.5, "cable": 0.5}).springs == 6000
    assert STRESS.times({"springs": 0.5, "cable": 0.5}).cable == 0.075
    assert STRESS.times({"springs": 0.0}).springs == 0


def test_effects_are_read_and_taken_out():
    assert read_effects(["springs=3000,cable", "jitter = 1e-3"]) == {"springs": 3000.0, "cable": None, "jitter": 1e-3}
    sizes = STRESS.with_effects({"cable": 0.5, "stribeck": None}, Scale(1, 1)).without_effects(
        ["springs", "floor_friction"]
    )
    assert (sizes.cable, sizes.stribeck, sizes.springs, sizes.floor_friction) == (0.5, 0.3, 0.0, 1.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"disabled_effects": ["sprngs"]}, r"'sprngs' is not an effect of a simulated robot; did you mean 'springs'\?"),
        ({"effects": {"wind": None}}, "'wind' is not an effect of a simulated robot; the effects are"),
        ({"effects": {"cable": -1.0}}, "cable is -1.0; it must be a finite number, zero or more"),
        ({"effects": {"cable": None}, "disabled_effects": ["cable"]},
         "cable: both enabled and disabled; use one of the two options"),
        ({"effects": {"lost_samples": 0.9}}, "lost_samples is 0.9: control loops need more samples"),
        ({"effects": {"slosh": 0.95}, "payload": "1,0,0,0"}, "slosh is 0.95: the tank itself has a mass; give 0.9 at most"),
        ({"effects": {"slosh": None}}, "slosh is 0.65, but the robot has no payload; give one"),
        ({"effects": {"vertical_pull": np.inf}}, r"vertical_pull is inf; it must be a finite number$"),
        ({"effects": {"foot_width": None, "foot_oval": None}}, "cylindrical feet .foot_width or the model file."),
        ({"effects": {"vertical_pull": None}, "engine": "dart"}, "dart does not support the effects vertical_pull; disable"),
        ({"preset": "stress", "engine": "dart"},
        r"dart does not support the effects springs, spring.*--disable-effect springs,spring_spread"),
        ({"effects": {"swinging_load": None}, "engine": "dart"}, "dart does not support the effects swinging_load; disable"),
        ({"contact_model": "file", "engine": "dart"}, "dart cannot take contacts from the model file"),
        ({"contact_model": "file"}, "the model file of 'unitree_a1' has no contact parameters for its feet"),
        ({"contact_model": "glue"}, "contact model 'glue' does not exist; use 'default' or 'file'"),
    ],
)  # fmt: skip
def test_impossible_effects_are_rejected_by_name(a1, given, words):
    with pytest.raises(SettingsError, match=words):
        simulate(a1, **given)


def test_a_size_that_is_not_a_number_is_rejected():
    with pytest.raises(
        SettingsError, match=r"'cable=much' does not give cable a size; give a number \(N\), for example cable=0.1"
    ):
        read_effects(["cable=much"])


# --- draws


def test_no_effect_changes_the_draws_of_another():
    everything = STRESS.with_effects({row.name: None for row in ROWS if row.in_stress == row.none}, Scale(1, 1))
    whole = drawn(everything).drawn
    for row in ROWS:
        without = drawn(everything.without_effects([row.name])).drawn
        assert all(np.array_equal(without[name], whole[name]) for name in whole if name != row.name), row.name


def test_the_draws_of_realistic_are_unchanged():
    errors, digest = drawn(REALISTIC), hashlib.sha256()
    for name in (
        "joint_offset", "torque_gain", "gyro_bias", "accelerometer_bias", "imu_tilt", "leg_mass_scale", "gravity_direction",
    ):  # fmt: skip
        digest.update(np.ascontiguousarray(getattr(errors, name, errors.drawn.get(name))).tobytes())
    digest.update(errors.noise(1000, 50).tobytes())
    assert digest.hexdigest() == "f1e1c1d33e9eac40a71f9d502e46bdab55bff0b6ae47eb361799d5ff53d24b96"


# Last samples of 0.1 s: position of the first leg's joints [rad], its torques [Nm], the accelerometer [m/s2].
OF_EVER = {
    "ideal": ([0.0081046, 0.71485, -1.4682077], [-1.16638, 2.66477, 3.66824], [0.01628, 0.32869, 9.80467]),
    "realistic": ([-0.0013043, 0.7143296, -1.4770404], [-0.05335, 2.77142, 4.73489], [-0.01748, 0.14025, 9.84047]),
}


@pytest.mark.parametrize("noise", OF_EVER)
def test_recordings_of_the_smaller_presets_are_unchanged(a1, noise):
    """The tolerance covers differences between releases of the engine."""
    target = nominal_stance(a1).joint_position + 0.02 * np.sin(np.arange(JOINTS))
    with simulate(a1, noise, seed=SEED) as simulation:
        recording = simulation.platform.play(Trajectory(np.tile(target, (50, 1))))
    position, torque, acceleration = OF_EVER[noise]
    assert np.allclose(recording.joints.position[-1, :3], position, atol=1e-5)
    assert np.allclose(recording.joints.torque[-1, :3], torque, atol=2e-3)
    assert np.allclose(recording.imu.acceleration_in_imu[-1], acceleration, atol=5e-3)


def test_draws_follow_their_laws():
    sizes = STRESS.with_effects(dict.fromkeys(("joint_axes", "leg_inertia")), Scale(1, 1))
    many = DrawnErrors.draw(sizes, 20000, SEED).drawn
    for row in ROWS:
        size, values = getattr(sizes, row.name), many[row.name]
        if row.law == "rms" and values.size > 1000:
            assert values.std() == pytest.approx(size, rel=0.05), row.name
        elif row.law == "exact":
            assert (values == size).all(), row.name
    assert np.log(many["friction_spread"]).std() == pytest.approx(0.3, rel=0.05)
    frictions = [drawn(STRESS, seed).floor_friction for seed in range(200)]
    assert 0.6 <= min(frictions) < 0.62
    assert 0.98 < max(frictions) <= 1.0


# --- legs


def as_drawn(robot, errors):
    """The estimator's model of a robot whose legs are as drawn: the reference for the truth."""
    legs, model = LegErrors.of(robot, nominal_stance(robot), errors), robot.pinocchio.copy()
    for joint in range(JOINTS):
        link, mass = model.inertias[joint + 2], float(errors.leg_mass_scale[joint])
        about_com = mass * float(errors.leg_inertia_scale[joint]) * np.array(link.inertia)
        model.inertias[joint + 2] = pin.Inertia(
            mass * link.mass, np.array(link.lever) + legs.com_shift[joint], about_com
        )
    for leg, hip in zip(robot.legs.values(), legs.hip_shift, strict=True):
        for joint, shift in zip(leg.joints, [hip, *legs.end_shift[list(leg.joints[:-1])]], strict=True):
            placement = model.jointPlacements[int(joint) + 2]
            model.jointPlacements[int(joint) + 2] = pin.SE3(placement.rotation, placement.translation + shift)
        frame = model.frames[leg.foot_frame_id]
        frame.placement = pin.SE3(
            frame.placement.rotation, frame.placement.translation + legs.end_shift[leg.joints[-1]]
        )
    return dataclasses.replace(robot, pinocchio=model)


def told_by_hips(body, shift):
    """Return a body in the base frame of shifted hips."""
    return InertialParameters.from_pinocchio(pin.SE3(np.eye(3), shift.mean(axis=0)).actInv(body.to_pinocchio()))


def assert_same_body(one, other):
    assert one.mass == pytest.approx(other.mass, abs=1e-9)
    assert np.allclose(one.com, other.com, atol=1e-9)
    assert np.allclose(one.inertia, other.inertia, atol=1e-9)


@pytest.mark.parametrize("name", ["unitree_a1", "skewed"])
def test_the_truth_includes_all_leg_errors(a1, skewed, name):
    robot = {"unitree_a1": a1, "skewed": skewed}[name]
    others = {"springs": None, "backlash": None, "rotor_spin": None, "armature": None, "foot_radius": None}
    with simulate(robot, "ideal", seed=SEED, effects={**dict.fromkeys(LEG_EFFECTS), **others}) as simulation:
        truth, errors, seen = simulation.truth, simulation.errors, engine(simulation)
    real, stance, shift = as_drawn(robot, errors), nominal_stance(robot), errors.hip_position
    in_base_link = composite_parameters(real, stance.joint_position)
    assert_same_body(truth.composite, told_by_hips(in_base_link, shift))
    assert truth.composite.mass != pytest.approx(robot.mass, abs=0.01)
    data = mujoco.MjData(seen.simulated.links)
    data.qpos[seen.simulated.qpos] = stance.joint_position
    mujoco.mj_kinematics(seen.simulated.links, data)
    feet = np.array([data.geom(f"equipoise_{leg}_foot").xpos for leg in robot.legs]) - data.qpos[:3]
    kinematic = real.create_data()
    pin.framesForwardKinematics(real.pinocchio, kinematic, real.configuration(stance.joint_position))
    assert np.allclose(feet, [kinematic.oMf[frame].translation for frame in real.foot_frames], atol=1e-9)
    assert np.abs(feet - stance.feet_in_base).max() > 3e-4


def test_a_common_hip_shift_moves_the_base_frame(a1):
    """Legs stay in their places in it, and the base moves the other way."""
    stance, shift = nominal_stance(a1), np.tile([2e-3, -1e-3, 3e-3], (4, 1))
    nominal = nominal_inertia(a1, stance.joint_position)
    moved = nominal.base.to_pinocchio()
    moved.lever = moved.lever - shift[0]
    legs = nominal.composite.to_pinocchio() - nominal.base.to_pinocchio()
    errors = drawn(EffectSizes())
    errors = dataclasses.replace(errors, drawn={**errors.drawn, "hip_position": shift.ravel()})
    truth = simulated_truth(a1, build_simulated_robot(a1, stance, errors, None, 1e-3), stance.joint_position)
    assert_same_body(truth.base, InertialParameters.from_pinocchio(moved))
    assert_same_body(truth.composite, InertialParameters.from_pinocchio(moved + legs))


def test_both_engines_have_the_same_legs(a1):
    pytest.importorskip("dartpy")
    effects = {**dict.fromkeys(LEG_EFFECTS), "foot_radius": None, "joint_axes": None}
    truths = []
    for name in ("mujoco", "dart"):
        with simulate(a1, "ideal", seed=SEED, effects=effects, engine=name, payload="1,0.1,0,0.05") as simulation:
            truths.append(simulation.truth)
    for body in ("composite", "base", "stance_effective"):
        assert_same_body(*(getattr(truth, body) for truth in truths))


@pytest.mark.parametrize("name", ["leg_mass_common", "leg_com_common", "leg_com", "leg_length", "hip_position"])
def test_each_leg_error_alone_moves_the_truth(a1, name):
    with simulate(a1, "ideal", seed=SEED, effects={name: None}) as simulation:
        real, shift = as_drawn(a1, simulation.errors), simulation.errors.hip_position
        composite = simulation.truth.composite
    stance = nominal_stance(a1)
    assert_same_body(composite, told_by_hips(composite_parameters(real, stance.joint_position), shift))
    assert np.abs(composite.com - composite_parameters(a1, stance.joint_position).com).max() > 1e-5


def test_common_leg_errors_are_symmetric(a1):
    shift = LegErrors.of(a1, nominal_stance(a1), drawn(EffectSizes(leg_com_common=4e-3))).com_shift[a1.leg_joints]
    assert np.abs(shift).max() > 1e-3
    assert np.allclose(shift[0], shift[1] * [1, -1, 1])
    assert np.allclose(shift[2], shift[3] * [1, -1, 1])


def test_feet_have_other_radii_and_still_stand_on_the_floor(a1):
    seen = standing(a1, foot_radius=2e-3)
    usual = [leg.foot_radius for leg in a1.legs.values()]
    radii = [seen.model.geom(f"equipoise_{leg}_foot").size[0] for leg in a1.legs]
    assert np.allclose(np.subtract(radii, usual), seen.errors.drawn["foot_radius"])
    assert np.abs(seen.ground_truth.clearance).max() < 5e-6


def test_axes_are_tilted_by_their_size(a1):
    tilted, plain = (engine(simulate(a1, "ideal", seed=SEED, effects=e)) for e in ({"joint_axes": 5e-3}, {}))
    joints = [plain.model.joint(name).id for name in a1.joint_names]
    cosine = np.sum(tilted.model.jnt_axis[joints] * plain.model.jnt_axis[joints], axis=1)
    expected = np.linalg.norm(tilted.simulated.errors.drawn["joint_axes"].reshape(-1, 2), axis=1)
    assert np.allclose(np.arccos(cosine), expected, rtol=1e-3)


# --- drive trains


def test_a_spring_bends_by_the_torque_over_its_stiffness(a1):
    seen = standing(a1, springs=3000.0, spring_spread=0.2)
    springs = [seen.model.joint(spring_name(name)).qposadr[0] for name in a1.joint_names]
    torque = seen.data.actuator_force
    loaded = np.abs(torque) > 0.3
    assert loaded.sum() >= 6
    assert np.allclose((-torque / seen.data.qpos[springs])[loaded], seen.errors.spring_stiffness[loaded], rtol=0.01)
    assert seen.errors.spring_stiffness.std() / 3000 == pytest.approx(0.2, rel=0.5)


def test_springs_are_stable_however_stiff_and_light(robots_or_a1):
    for stiffness in (1000.0, 3e6):
        with simulate(robots_or_a1, "ideal", effects={"springs": stiffness}) as simulation:
            assert np.abs(simulation.platform.read().joint_velocity).max() < 5e-3


@pytest.fixture(params=["unitree_a1", "two_jointed"])
def robots_or_a1(request, a1, two_jointed):
    return {"unitree_a1": a1, "two_jointed": two_jointed}[request.param]


def test_the_encoder_is_on_the_motors_side(a1):
    with simulate(a1, "ideal", effects={"springs": 3000.0}) as simulation:
        state, seen = simulation.platform.read(), engine(simulation)
    link = seen.data.qpos[seen.simulated.qpos + 1]
    assert np.abs(link).max() > 1e-3
    assert np.array_equal(state.joint_position, seen.data.qpos[seen.simulated.qpos])
    torque = seen.simulated.kp * (nominal_stance(a1).joint_position - state.joint_position)
    assert np.allclose(state.joint_torque, torque, atol=0.05)


@pytest.mark.parametrize("springs", [0.0, 3000.0])
def test_loaded_joints_rest_at_a_stop_of_the_backlash(a1, springs):
    play = 2e-3
    seen = standing(a1, backlash=play, springs=springs)
    bent = seen.data.qpos[[seen.model.joint(spring_name(name)).qposadr[0] for name in a1.joint_names]]
    torque = seen.data.actuator_force
    loaded = np.abs(torque) > 1.0
    stiffness = springs or 30e3
    assert loaded.sum() >= 4
    assert np.allclose(bent[loaded], (-np.sign(torque) * play / 2 - torque / stiffness)[loaded], rtol=0.02)


def test_stops_push_as_springs_do():
    solref, solimp, softness = spring_constraint(3000.0, 2.0, 5e-4, 150.0)
    impedance = solimp[0]
    assert (1 - impedance) / impedance * 150.0 == pytest.approx(softness)
    assert 1 / softness == pytest.approx(5e-4**2 * 3000 + 5e-4 * 2)
    assert -solref[0] / impedance / softness == pytest.approx(3000)
    assert -solref[1] / impedance / softness == pytest.approx(5e-4 * 3000 + 2)


def test_rotors_spin_in_the_links_that_carry_them(a1):
    armature, share = 0.02, 1 / 6
    with simulate(a1, "ideal", effects={"armature": armature, "rotor_spin": share}) as simulation:
        seen = engine(simulation)
    spinning, still = (np.zeros((18, 18)) for _ in range(2))
    data = mujoco.MjData(seen.model)
    for model, into in ((seen.simulated.links, still), (seen.model, spinning)):
        data.qpos[:] = seen.data.qpos
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, into, data.qM) if mujoco.__version__ < "4" else mujoco.mj_fullM(model, data, into)
    expected, spin = np.zeros((18, 18)), armature * share
    for name in a1.joint_names:
        joint = seen.model.joint(name).id
        carrier = seen.model.body_parentid[seen.model.jnt_bodyid[joint]]
        turning = np.zeros((3, 18))
        mujoco.mj_jacBody(seen.model, data, None, turning, carrier)
        about_axis, own = data.xaxis[joint] @ turning, np.eye(18)[seen.model.jnt_dofadr[joint]]
        expected += spin * (np.outer(own, about_axis) + np.outer(about_axis, own) + np.outer(own, own))
    assert np.allclose(spinning - still, expected, atol=1e-9)
    assert np.abs(expected[:6]).max() > 1e-3


def test_friction_differs_by_joint_grows_with_load_and_at_rest(a1):
    plain = standing(a1, coulomb_friction=0.3, friction_spread=0.3)
    loss, dof = plain.model.dof_frictionloss, plain.simulated.dof
    assert np.allclose(loss[dof], 0.3 * plain.errors.drawn["friction_spread"])
    assert np.ptp(loss[dof]) > 0.1
    heavy = standing(a1, coulomb_friction=0.3, load_friction=0.04, stribeck=0.3)
    expected = 1.3 * 0.3 + 0.04 * np.abs(heavy.data.actuator_force)
    assert np.allclose(heavy.model.dof_frictionloss[heavy.simulated.dof], expected, rtol=1e-3)
    moving = heavy.errors.sliding_friction(np.full(JOINTS, 2.0), np.zeros(JOINTS))
    assert np.allclose(moving, 0.3)


def test_friction_under_load_uses_the_torque_of_the_engine(a1):
    robot = dataclasses.replace(a1, effort_limit=np.where(np.arange(JOINTS) == 3, np.inf, a1.effort_limit))
    seen = standing(robot, torque_gain=0.05, load_friction=0.04, stribeck=0.3, coulomb_friction=0.3)
    model, data, dof = seen.model, seen.data, seen.simulated.dof
    data.qvel[dof] = np.linspace(-0.3, 0.3, JOINTS)
    data.ctrl[:] += np.tile([2.0, -2.0, 0.01], 4)  # the first two of a leg want more than they have
    ChangingFriction(model, dof, seen.simulated.qpos, seen.errors).act(data)
    mujoco.mj_forward(model, data)
    torque = data.actuator_force
    limit = model.actuator_forcerange[:, 1]
    assert (np.abs(torque) == limit).sum() == 7
    assert abs(torque[3]) > limit[0]
    more_at_rest = 0.3 * np.exp(-((data.qvel[dof] / 0.1) ** 2))
    assert np.allclose(model.dof_frictionloss[dof], 0.3 * (1 + more_at_rest) + 0.04 * np.abs(torque), rtol=1e-12)


def test_sparse_matrices_change_no_motion(a1):
    """Rolling feet on springs are solved with them."""
    motion = Trajectory(nominal_stance(a1).joint_position + 0.02 * np.sin(np.linspace(0, 12, 250))[:, None])
    recordings = []
    for jacobian in (None, 0):  # as it is chosen; dense
        with simulate(a1, "stress", seed=SEED) as simulation:
            options = engine(simulation).model.opt
            assert options.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE
            options.jacobian = options.jacobian if jacobian is None else jacobian
            recordings.append(simulation.platform.play(motion))
    one, other = recordings
    assert np.allclose(one.joints.position, other.joints.position, rtol=0, atol=1e-9)
    assert np.allclose(one.imu.acceleration_in_imu, other.imu.acceleration_in_imu, rtol=0, atol=1e-6)


def test_dart_has_friction_under_load_and_the_cable(a1):
    pytest.importorskip("dartpy")
    target = Trajectory(np.tile(nominal_stance(a1).joint_position, (150, 1)))

    def at_rest(name, **effects):
        with simulate(
            a1, "ideal", effects=effects, engine=name, timestep=1e-3 if name == "dart" else None
        ) as simulation:
            return simulation.platform.play(target).joints.torque[-50:].mean(axis=0)

    pulls = [at_rest(name, cable=3.0) - at_rest(name) for name in ("mujoco", "dart")]
    assert np.abs(pulls[0]).max() > 0.1
    assert np.allclose(*pulls, atol=0.15 * np.abs(pulls[0]).max())


# --- feet and floor


def test_feet_sink_in_by_the_load_over_their_stiffness(a1):
    for contact, force in foot_forces(standing(a1, foot_stiffness=30e3)):
        assert force[0] > 15
        assert -force[0] / contact.dist == pytest.approx(30e3, rel=0.01)


def test_soft_feet_creep_no_faster_than_hard_ones(a1):
    def creep(**effects):
        with simulate(a1, "ideal", effects=effects) as simulation:
            before = simulation.ground_truth().feet
            simulation.platform.play(Trajectory(np.tile(nominal_stance(a1).joint_position, (250, 1))))
            return np.abs(simulation.ground_truth().feet - before)[:, :2].max() / 0.5

    assert creep(foot_stiffness=30e3) < max(2 * creep(), 30e-6)  # [m/s]


def test_feet_resist_rolling_and_turning_on_the_spot(a1):
    seen = standing(a1, "ideal", rolling_friction=0.3e-3, torsional_friction=4e-3)
    for contact, _ in foot_forces(seen):
        assert contact.dim == 6
        assert np.allclose(contact.friction, [1.0, 1.0, 4e-3, 0.3e-3, 0.3e-3])
    # The base is made to pitch: every foot rolls, and none is resisted by more than its load allows.
    seen.data.qvel[4] = 1.0
    seen.data.qvel[seen.simulated.dof] = 0
    mujoco.mj_forward(seen.model, seen.data)
    ratios = [np.linalg.norm(force[4:]) / force[0] for _, force in foot_forces(seen) if force[0] > 1]
    # A foot that slides, too, shares what friction has between the two.
    assert 0.1e-3 < max(ratios) < 0.3e-3


def test_feet_stand_on_footholds_of_different_heights(a1):
    seen = standing(a1, foothold_height=2e-3)
    heights = seen.errors.drawn["foothold_height"]
    radii = [leg.foot_radius for leg in a1.legs.values()]
    assert np.abs(heights).max() > 1e-3
    assert np.allclose(seen.ground_truth.feet[:, 2] - radii, heights, atol=1e-5)
    assert np.abs(seen.ground_truth.clearance).max() < 1e-5


def test_a_cable_pulls_and_the_feet_hold_it(a1):
    seen = standing(a1, cable=0.5, floor_slope=0.02)
    pulled, down = seen.errors.cable_in_world, seen.errors.gravity_direction
    assert np.linalg.norm(pulled) == pytest.approx(0.5)
    assert pulled @ down == pytest.approx(0, abs=1e-12)
    # MuJoCo gives the contact's axes as rows, and the force on the second geom along them.
    held = sum(np.reshape(contact.frame, (3, 3)).T @ force[:3] for contact, force in foot_forces(seen))
    weight = seen.truth.composite.mass * 9.81 * down
    assert np.allclose(held * np.sign(held[2]), -(pulled + weight), atol=0.06)


def test_a_push_adds_to_the_cable(a1):
    with simulate(a1, "ideal", effects={"cable": 0.5}, seed=SEED) as simulation:
        simulation.push(np.array([0, 3.0, 0]))
        base = simulation.platform._simulated.base_body
        expected = simulation.errors.cable_in_world + [0, 3.0, 0]
        assert np.allclose(engine(simulation).data.xfrc_applied[base, :3], expected)


def test_a_load_swings_and_counts_at_its_hook(a1):
    with simulate(a1, "ideal", effects={"swinging_load": 0.1}) as simulation, simulate(a1, "ideal") as without:
        seen, truth, bare = engine(simulation), simulation.truth.composite, without.truth.composite
        hook = np.array(seen.model.body(SWINGING_LOAD).pos)
        assert truth.mass == pytest.approx(bare.mass + 0.1)
        assert np.allclose(truth.mass * truth.com, bare.mass * bare.com + 0.1 * hook)
        assert simulation.truth.base.mass == pytest.approx(without.truth.base.mass + 0.1)
        joint = seen.model.body(SWINGING_LOAD).jntadr[0]
        address = seen.model.jnt_qposadr[joint]
        seen.data.qpos[address : address + 4] = [np.cos(0.05), np.sin(0.05), 0, 0]
        swing = []
        for _ in range(800):
            simulation.platform.step(JointCommand(nominal_stance(a1).joint_position))
            swing.append(seen.data.qpos[address + 1])
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    length = -seen.model.body(SWINGING_LOAD).ipos[2]
    period = 2 * np.pi * np.sqrt(length / 9.81 * (1 + 0.4 * 0.2**2))
    assert 2 * PERIOD * np.diff(crossings).mean() == pytest.approx(period, rel=0.03)


def test_a_sling_pulls_where_the_robot_is_lower_than_its_slack(a1):
    with simulate(a1, "ideal", effects={"sling": 1000.0}) as simulation:
        seen = engine(simulation)
        sling = seen.model.tendon(SLING).id
        height, slack = seen.data.qpos[2], seen.model.tendon_lengthspring[sling][1] - seen.data.ten_length[sling]
        for lower in (-3e-3, 2e-3):
            seen.data.qpos[2] = height - lower
            mujoco.mj_forward(seen.model, seen.data)
            pull = seen.data.qfrc_passive[2]
            assert pull == pytest.approx(1000.0 * max(lower - slack, 0.0), abs=0.1)


# Lean of the base [rad], and how far from its centre a foot of 20 mm then touches the floor, forward and to the left [m].
LEAN, R = 0.06, 20e-3
SIN, COS = np.sin(LEAN), np.cos(LEAN)
EDGE = {width: width * COS - R * SIN for width in (3e-3, 6e-3)}
OVAL = {excess: R * excess * SIN * COS / np.sqrt(1 + excess * SIN**2) for excess in (0.3, -0.15)}
FORWARD, LEFT, DIAGONAL = [0, LEAN, 0], [-LEAN, 0, 0], [-LEAN / np.sqrt(2), LEAN / np.sqrt(2), 0]


@pytest.mark.parametrize(
    ("effects", "lean", "touches"),
    [
        ({}, LEFT, (0, 0)),
        ({"foot_width": 6e-3}, LEFT, (0, EDGE[6e-3])),
        ({"foot_width": 6e-3}, FORWARD, (0, 0)),
        ({"foot_oval": 0.3}, LEFT, (0, OVAL[-0.15])),
        ({"foot_oval": 0.3}, FORWARD, (OVAL[0.3], 0)),
        ({"foot_flat": 3e-3}, LEFT, (0, EDGE[3e-3])),
        ({"foot_flat": 3e-3}, FORWARD, (EDGE[3e-3], 0)),
        ({"foot_flat": 3e-3}, DIAGONAL, (EDGE[3e-3] / np.sqrt(2), EDGE[3e-3] / np.sqrt(2))),
        ({"foot_flat": 3e-3, "leg_length": 2e-3}, LEFT, (0, EDGE[3e-3])),
    ],
)  # fmt: skip
def test_a_foot_that_leans_touches_the_floor_where_its_shape_has_it(a1, effects, lean, touches):
    with simulate(a1, "ideal", effects=effects, seed=SEED) as simulation:
        seen = engine(simulation)
    model, data = seen.model, mujoco.MjData(seen.model)
    data.qpos[:7] = [0, 0, 1, *pin.Quaternion(pin.exp3(np.array(lean, dtype=float))).coeffs()[[3, 0, 1, 2]]]
    data.qpos[seen.simulated.qpos] = nominal_stance(a1).joint_position
    for leg in a1.legs:
        foot = model.geom(foot_name(leg)).id
        mujoco.mj_kinematics(model, data)
        data.qpos[2] -= data.geom_xpos[foot][2] - R + 0.1e-3
        mujoco.mj_forward(model, data)
        contacts = [contact for contact in data.contact if model.geom(contact.geom[1]).name.startswith(foot_name(leg))]
        deepest = min(contact.dist for contact in contacts)
        lowest = [contact.pos for contact in contacts if contact.dist < deepest + 1e-9]
        assert np.allclose((np.mean(lowest, axis=0) - data.geom_xpos[foot])[:2], touches, atol=20e-6)


@pytest.mark.parametrize(("effect", "contacts"), [("foot_width", 2), ("foot_oval", 1), ("foot_flat", 4)])
def test_feet_of_all_shapes_stand_level_on_the_floor(a1, skewed, effect, contacts):
    for robot in (a1, skewed):
        with simulate(robot, "ideal", effects={effect: None}) as simulation:
            ground_truth, seen = simulation.ground_truth(), engine(simulation)
            assert np.abs(ground_truth.clearance).max() < 0.2e-3
            assert ground_truth.tilt < 0.02
        data = mujoco.MjData(seen.model)
        stance = nominal_stance(robot)
        data.qpos[:7] = [0, 0, stance.base_height - 0.1e-3, 1, 0, 0, 0]
        data.qpos[seen.simulated.qpos] = stance.joint_position
        mujoco.mj_forward(seen.model, data)
        assert len(data.contact) == 4 * contacts
        assert np.ptp([contact.dist for contact in data.contact]) < 20e-6


def test_feet_that_are_cylinders_in_the_file_are_cylinders_in_the_simulation(tmp_path):
    robot = load_text(tmp_path, on_cylinders())
    with simulate(robot, "ideal") as simulation:
        model = engine(simulation).model
        for leg in LEG_NAMES:
            (foot,) = foot_geoms(model, leg)
            assert model.geom_type[foot] == mujoco.mjtGeom.mjGEOM_CYLINDER
            assert np.allclose(model.geom_size[foot][:2], (0.018, 0.006))
    unknowns = Unknowns(robot, nominal_stance(robot), Priors())
    assert unknowns.scale[unknowns["foot_width"]] == pytest.approx([6e-3, 6e-3])


def test_feet_are_displaced_by_the_drawn_errors(a1):
    with (
        simulate(a1, "ideal", effects={"foot_position": 3e-3}, seed=SEED) as simulation,
        simulate(a1, "ideal") as plain,
    ):
        moved, usual = (engine(one) for one in (simulation, plain))
        assert_same_body(simulation.truth.composite, plain.truth.composite)
    at = [
        [one.model.geom_pos[one.model.geom(foot_name(leg)).id] for leg in a1.legs] for one in (moved, usual)
    ]  # fmt: skip
    drawn_shift = simulation.errors.drawn["foot_position"].reshape(4, 3)
    shift = np.subtract(*at)
    assert np.allclose(np.linalg.norm(shift, axis=1), np.linalg.norm(drawn_shift, axis=1))
    assert np.allclose(shift[:, 2], -drawn_shift[:, 0], atol=1e-4)  # an A1's calf points down its z axis


ATTACHED = ("vertical_pull", "hose", "slosh", "foot_width", "foot_oval", "foot_flat", "gyro_lag", "foot_position")


@pytest.mark.parametrize("effect", ATTACHED)
def test_forces_slosh_lags_and_foot_shapes_do_not_change_the_truth(a1, effect):
    payload = "1.5,0.05,-0.02,0.06,0.01,0.02,0.025"
    with simulate(a1, "ideal", payload) as plain, simulate(a1, "ideal", payload, effects={effect: None}) as simulation:
        for body in ("composite", "base", "stance_effective"):
            assert_same_body(getattr(simulation.truth, body), getattr(plain.truth, body))
        assert simulation.link_truth.keys() == plain.link_truth.keys()


@pytest.mark.parametrize("pull", [-3.0, 3.0])
def test_a_vertical_pull_loads_the_feet_by_its_size_at_its_point(a1, pull):
    seen, plain = (standing(a1, floor_slope=0.02, **more) for more in ({"vertical_pull": pull}, {}))
    up = -seen.errors.gravity_direction
    eye = seen.data.site("equipoise_pull_eye").xpos
    assert eye[0] == pytest.approx(-np.abs(nominal_stance(a1).feet_in_base[:, 0]).mean(), abs=15e-3)
    loads, moments = [], []
    for one in (seen, plain):
        forces = [np.reshape(contact.frame, (3, 3)).T @ force[:3] for contact, force in foot_forces(one)]
        places = [contact.pos - one.data.subtree_com[0] for contact, _ in foot_forces(one)]
        loads.append(np.sum(forces, axis=0))
        moments.append(np.cross(places, forces).sum(axis=0))
    assert loads[0] - loads[1] == pytest.approx(-pull * up, abs=0.05)
    about_com = np.cross(eye - seen.data.subtree_com[0], pull * up)
    assert moments[0] - moments[1] == pytest.approx(-about_com, abs=0.02)
    assert abs(about_com[1]) > 0.4


def test_a_hose_pulls_its_point_back_to_the_stance(a1):
    with simulate(a1, "ideal", effects={"hose": 20.0}) as simulation:
        seen = engine(simulation)
    data, start = mujoco.MjData(seen.model), [0, 0, nominal_stance(a1).base_height]
    arm = [-np.abs(nominal_stance(a1).feet_in_base[:, 0]).mean(), 0, 0]
    for moved in ([0, 0, 0], [0.03, 0, 0], [-0.06, 0, 0], [0.01, -0.02, 0.02]):
        data.qpos[:7] = [*np.add(start, moved), 1, 0, 0, 0]
        mujoco.mj_forward(seen.model, data)
        force = -20.0 * np.array(moved)
        assert data.qfrc_passive[:3] == pytest.approx(force, abs=1e-9)
        assert data.qfrc_passive[3:6] == pytest.approx(np.cross(arm, force), abs=1e-9)


def test_water_has_the_period_of_its_tank_and_follows_a_lean(a1):
    with simulate(a1, "ideal", "2,0.05,-0.02,0.06", effects={"slosh": 0.65}) as simulation:
        model = engine(simulation).model
    water, data = model.body(WATER), mujoco.MjData(model)
    along_x, dofs = model.jnt_qposadr[water.jntadr[0]], water.dofadr[0] + np.arange(2)
    assert water.mass[0] == pytest.approx(1.3)
    assert model.body_mass.sum() == pytest.approx(a1.mass + 2, abs=1e-6)
    pendulum = 0.05 * nominal_stance(a1).scale.length
    data.qpos[:7] = [0, 0, 1, np.cos(LEAN / 2), 0, np.sin(LEAN / 2), 0]
    data.qpos[along_x] = pendulum * np.sin(LEAN)
    mujoco.mj_forward(model, data)
    falling = model.body(WATER).mass[0] * GRAVITY * np.sin(LEAN)
    assert data.qfrc_passive[dofs[0]] == pytest.approx(-falling)
    assert data.qfrc_bias[dofs[0]] == pytest.approx(-falling)
    data.qvel[dofs] = 0.1, 0.2
    mujoco.mj_forward(model, data)
    damping = 2 * 0.02 * np.sqrt(GRAVITY / pendulum) * 1.3 * np.array([0.1, 0.2])
    assert data.qfrc_passive[dofs] == pytest.approx([-falling, 0] - damping)


def test_all_motors_can_err_together():
    gains = drawn(EffectSizes(torque_gain_common=0.05)).torque_gain
    assert np.ptp(gains) == 0
    assert gains[0] != 1


@pytest.mark.parametrize(
    ("name", "start"), [("unitree_a1", "lying"), ("two_jointed", "standing"), ("skewed", "standing")]
)
def test_robots_of_all_kinds_rest_in_stress(a1, two_jointed, skewed, name, start):
    robot = {"unitree_a1": a1, "two_jointed": two_jointed, "skewed": skewed}[name]
    with simulate(robot, "stress", seed=SEED, start=start, effects={"swinging_load": None}) as simulation:
        ground_truth = simulation.ground_truth()
        assert np.abs(simulation.platform.read().joint_velocity).max() < 0.3
    assert ground_truth.tilt < 0.05
    if start == "standing":
        assert np.abs(ground_truth.clearance).max() < 2e-3


# --- contacts of the file


MJCF_FOOT = (
    '<geom type="sphere" size="0.02" pos="0 0 -0.2" condim="6" friction="0.7 0.02 0.01" solimp="0.015 1 0.022" '
    'priority="1"/>'
)


@pytest.mark.parametrize(
    "foot",
    [
        MJCF_FOOT,
        f'<body pos="0 -0.2 -0.2" euler="1.5707963 0 0">{MJCF_FOOT}</body>',
    ],
    ids=["of the link", "of a body fixed to it"],
)
def test_contact_parameters_can_come_from_the_file(tmp_path, foot):
    from robots import load_text  # noqa: PLC0415

    legs = "".join(
        f'<body name="{leg}_thigh" pos="{x} {y} 0"><joint name="{leg}_1" axis="0 1 0" range="-2 2"/>'
        f'<inertial pos="0 0 -0.1" mass="0.5" diaginertia="2e-3 2e-3 1e-3"/>'
        f'<body name="{leg}_calf" pos="0 0 -0.2"><joint name="{leg}_2" axis="0 1 0" range="-2.7 -0.1"/>'
        f'<inertial pos="0 0 -0.1" mass="0.2" diaginertia="1e-3 1e-3 1e-4"/>{foot}</body></body>'
        for leg, x, y in (("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1))
    )
    text = (
        '<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/>'
        f'<inertial pos="0 0 0" mass="6" diaginertia="0.02 0.06 0.07"/>{legs}</body></worldbody></mujoco>'
    )
    robot = load_text(tmp_path, text)
    with simulate(robot, "realistic", contact_model="file") as simulation:
        simulation.platform.play(Trajectory(np.tile(nominal_stance(robot).joint_position, (50, 1))))
        seen = engine(simulation)
        mujoco.mj_forward(seen.model, seen.data)
    for contact, _ in foot_forces(seen):
        assert contact.dim == 6
        assert np.allclose(contact.friction, [0.7, 0.7, 0.02, 0.01, 0.01])
        assert np.allclose(contact.solimp[:3], [0.015, 1, 0.022], atol=1e-3)


# --- sensors and samples


def sensed(raw, period=0, **sizes):
    """Samples of raw values at every engine step of 0.5 ms, four to a sample."""
    errors = drawn(EffectSizes(**sizes))
    samples = Samples(errors, JOINTS, 0.5e-3, 4)
    return samples.sensed(samples.filtered(raw), 0, len(raw) // 4, period), errors


def raw_values(**columns):
    raw = np.zeros((4000, 3 * JOINTS + 6))
    for name, values in columns.items():
        at = {"position": slice(0, JOINTS), "velocity": slice(JOINTS, 2 * JOINTS), "gyro": slice(-6, -3)}[name]
        raw[:, at] = values
    return raw


TIME = 0.5e-3 * np.arange(4000)[:, None]


def test_the_gyroscope_errs_in_gain_axes_and_mounting():
    turning = np.array([0.3, -0.5, 0.7])
    sizes = {"gyro_gain": 5e-3, "gyro_misalignment": 2e-3, "gyro_turn": 5e-3}
    samples, errors = sensed(raw_values(gyro=turning), **sizes)
    drawn_turn = errors.drawn["gyro_turn"]
    gains = np.diag(1 + errors.drawn["gyro_gain"])
    gains[0, 1:], gains[1, [0, 2]], gains[2, :2] = np.split(errors.drawn["gyro_misalignment"], 3)
    assert np.allclose(samples[5, -6:-3], gains @ pin.exp3(-drawn_turn) @ turning, atol=1e-6)
    assert np.abs(samples[5, -6:-3] - turning).max() > 1e-3


def test_the_gyroscope_drifts_by_its_size_in_two_minutes():
    samples, errors = sensed(raw_values(), period=60000, gyro_drift=2e-3)
    assert np.allclose(samples[0, -6:-3], errors.drawn["gyro_drift"])


@pytest.mark.parametrize(("frequency", "passed"), [(1.0, 1.0), (100.0, np.sqrt(0.5)), (400.0, None)])
def test_the_imus_filter_is_a_butterworth_of_second_order(frequency, passed):
    raw = raw_values(gyro=np.sin(2 * np.pi * frequency * TIME))
    errors = drawn(EffectSizes(imu_filter=100.0))
    through = Samples(errors, JOINTS, 0.5e-3, 4).filtered(raw)[2000:, -6]
    if passed is None:  # what is above falls with the square of the frequency, in the digital filter's measure
        passed = (np.tan(np.pi * 100 * 0.5e-3) / np.tan(np.pi * frequency * 0.5e-3)) ** 2
    assert np.abs(through).max() == pytest.approx(passed, rel=0.02)


def test_the_filter_does_not_depend_on_the_pieces_of_time(a1):
    target = Trajectory(np.tile(nominal_stance(a1).joint_position + 0.02, (60, 1)))
    with simulate(a1, effects={"imu_filter": 50.0}) as whole, simulate(a1, effects={"imu_filter": 50.0}) as pieces:
        recording = whole.platform.play(target)
        states = [pieces.platform.read()]
        for index in range(59):
            states.append(pieces.platform.step(target.command(index)))
    gyro = np.array([state.angular_velocity_in_imu for state in states])
    assert np.allclose(recording.imu.angular_velocity_in_imu[1:], gyro[1:], atol=2e-3)
    assert np.abs(gyro - recording.imu.angular_velocity_in_imu).mean() < 1e-4


def test_a_late_imu_is_late():
    ramp = raw_values(position=TIME, gyro=TIME)
    samples, _ = sensed(ramp, imu_latency=2e-3, sensor_delay=1e-3)
    assert np.allclose((samples[:, 0] - samples[:, -6])[5:], 2e-3)


def test_a_gyroscope_that_lags_is_older_than_the_accelerometer():
    ramp = raw_values()
    ramp[:, -6:] = TIME
    samples, _ = sensed(ramp, gyro_lag=3e-3, imu_latency=1e-3)
    assert np.allclose((samples[:, -3:] - samples[:, -6:-3])[5:-5], 3e-3)


def test_a_gyroscope_lag_of_two_samples_shifts_its_readings_by_two(a1):
    motion = Trajectory(nominal_stance(a1).joint_position + 0.02 * np.sin(np.linspace(0, 12, 250))[:, None])
    with simulate(a1, "ideal", effects={"gyro_lag": 4e-3}) as late, simulate(a1, "ideal") as usual:
        one, other = late.platform.play(motion), usual.platform.play(motion)
        assert np.allclose(
            late.platform.read().angular_velocity_in_imu, other.imu.angular_velocity_in_imu[-2], atol=1e-3
        )
    gyro = other.imu.angular_velocity_in_imu
    assert np.ptp(gyro) > 0.01
    assert np.allclose(one.imu.angular_velocity_in_imu[2:], gyro[:-2], atol=1e-9)
    assert np.array_equal(one.imu.acceleration_in_imu, other.imu.acceleration_in_imu)
    assert np.array_equal(one.joints.position, other.joints.position)


def test_an_eccentric_encoder_errs_with_the_joint(a1):
    sweep = np.linspace(-1, 1, 4000)[:, None] + np.zeros(JOINTS)
    speed = np.gradient(sweep[:, 0], 0.5e-3)[0]
    samples, errors = sensed(raw_values(position=sweep, velocity=speed), encoder_eccentricity=3e-3)
    off = samples[:, :JOINTS] - sweep[::4]
    assert np.allclose(off, 3e-3 * np.sin(sweep[::4] - errors.drawn["encoder_eccentricity"]))
    derived = np.gradient(samples[:, 0], 2e-3)
    assert np.allclose(samples[1:-1, JOINTS], derived[1:-1], rtol=1e-4)
    bent = simulate(a1, "ideal", effects={"encoder_eccentricity": 3e-3}, seed=SEED)
    with bent as simulation, simulate(a1, "ideal") as plain:
        moved = engine(simulation).data.qpos[7:] - engine(plain).data.qpos[7:]
    assert np.abs(moved).max() > 1e-3  # the loop closes on the encoder


@pytest.fixture(scope="module")
def held(a1):
    """A robot that holds still for a second, recorded."""

    def play(**effects):
        with simulate(a1, "realistic", seed=SEED, effects=effects) as simulation:
            return simulation.platform.play(Trajectory(np.tile(nominal_stance(a1).joint_position, (500, 1))))

    return play


@pytest.fixture(scope="module")
def usual(held):
    return held()


def test_lost_samples_are_missing_and_the_others_unchanged(held, usual):
    lossy = held(lost_samples=0.1)
    kept = np.isin(usual.joints.time, lossy.joints.time)
    assert 0.05 < 1 - kept.mean() < 0.15
    assert np.array_equal(lossy.joints.position, usual.joints.position[kept])
    assert np.array_equal(lossy.imu.time, lossy.joints.time)
    assert np.array_equal(lossy.commands.time, usual.commands.time)


@pytest.mark.parametrize(("rate", "count"), [(200.0, 200), (100.0, 100), (500.0, 500), (900.0, 500)])
def test_samples_come_at_their_rate(held, rate, count):
    recording = held(sample_rate=rate)
    assert recording.joints.time.size == pytest.approx(count, abs=1)
    assert np.ptp(np.diff(recording.joints.time)) <= PERIOD + 1e-9


def test_stamps_jitter_and_keep_their_order(held, usual):
    off = held(jitter=0.2e-3).joints.time - usual.joints.time
    assert off.std() == pytest.approx(0.2e-3, rel=0.1)
    assert np.diff(held(jitter=5e-3).joints.time).min() > 0


def test_a_loop_uses_the_last_sample_that_arrived(a1):
    with simulate(a1, effects={"lost_samples": 0.3}, seed=SEED) as simulation:
        states = [simulation.platform.step(JointCommand(nominal_stance(a1).joint_position)) for _ in range(100)]
        assert simulation.platform.read().time == states[-1].time
    times = np.array([state.time for state in states])
    late = PERIOD * (1 + np.arange(100)) - times
    assert late.min() >= -1e-9
    assert 0.15 < np.mean(late > 1e-4) < 0.45
    repeated = next(index for index in range(99) if times[index] == times[index + 1])
    assert np.array_equal(states[repeated].joint_position, states[repeated + 1].joint_position)


def test_presets_are_found_by_name():
    assert list(PRESETS) == ["ideal", "realistic", "stress"]
    assert EffectSizes.row("springs").name == "springs"
