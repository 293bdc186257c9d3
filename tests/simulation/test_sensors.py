"""Sensor and actuator errors: sizes, draws, and their effect on samples."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from equipoise import EffectSizes, JointCommand, Trajectory, nominal_stance, simulate
from equipoise.errors import SettingsError
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.scale import Scale
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import IDEAL, PRESETS, REALISTIC, STRESS
from equipoise.simulation.mujoco import MujocoPlatform

JOINTS = 12
PERIOD = 2e-3
SEED = 5
TORQUE_LIKE = {"torque_noise", "coulomb_friction", "viscous_friction", "armature"}


def drawn(seed=SEED, joints=JOINTS, **sizes):
    return DrawnErrors.draw(EffectSizes(**sizes), joints, seed)


# --- sizes


def test_realistic_is_the_table_of_an_a1():
    sizes = {name: size for name, size in dataclasses.asdict(REALISTIC).items() if size}
    assert sizes == {
        "encoder_noise": 0.0003,  # rad
        "joint_offset": 0.005,  # rad
        "joint_velocity_noise": 0.03,  # rad/s
        "gyro_noise": 0.003,  # rad/s
        "gyro_bias": 0.002,  # rad/s
        "accelerometer_noise": 0.05,  # m/s2
        "accelerometer_bias": 0.03,  # m/s2
        "imu_tilt": 0.005,  # rad
        "torque_noise": 0.2,  # Nm
        "coulomb_friction": 0.3,  # Nm
        "viscous_friction": 0.05,  # Nm s/rad
        "armature": 0.01,  # kg m2
        "torque_gain": 0.03,
        "leg_mass": 0.03,
        "command_delay": 0.002,  # s
        "sensor_delay": 0.002,  # s
        "imu_clock_offset": 0.0005,  # s
        "floor_friction": 0.8,
        "floor_slope": 0.005,  # rad
    }


def test_ideal_has_no_error_at_all():
    sizes = dataclasses.asdict(IDEAL)
    assert sizes.pop("floor_friction") == 1.0
    assert set(sizes.values()) == {0.0}
    assert PRESETS == {"ideal": IDEAL, "realistic": REALISTIC, "stress": STRESS}


def test_torque_like_errors_scale_with_the_robot_and_nothing_else_does():
    scaled = dataclasses.asdict(REALISTIC.scaled_to(Scale(length=2.0, torque=3.0)))
    for name, value in dataclasses.asdict(REALISTIC).items():
        assert scaled[name] == pytest.approx(value * (3 if name in TORQUE_LIKE else 1))


def test_only_presets_are_scaled_to_the_robot(a1):
    scale = nominal_stance(a1).scale
    sizes = simulate(a1, "realistic").platform._simulated.errors.sizes
    assert sizes == REALISTIC.scaled_to(scale)
    own = EffectSizes(torque_noise=0.7)
    assert simulate(a1, own).platform._simulated.errors.sizes is own


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(EffectSizes)])
@pytest.mark.parametrize("value", [-1e-6, np.nan, np.inf])
def test_negative_or_infinite_sizes_are_refused(name, value):
    signed = name in ("imu_clock_offset", "vertical_pull")  # IMU samples may be the older ones; cables hang down
    if signed and value == -1e-6:
        assert getattr(EffectSizes(**{name: value}), name) == value
        return
    with pytest.raises(SettingsError) as caught:
        EffectSizes(**{name: value})
    least = "" if signed else ", zero or more"
    assert str(caught.value) == f"{name} is {value}; it must be a finite number{least}"


def test_no_imu_sample_is_younger_than_its_reading():
    assert EffectSizes(imu_clock_offset=1e-3, sensor_delay=1e-3)
    with pytest.raises(
        SettingsError, match=r"imu_clock_offset is 0.001 s and sensor_delay is 0.0005 s: IMU samples would be"
    ):
        EffectSizes(imu_clock_offset=1e-3, sensor_delay=0.5e-3)


# --- drawing


def test_constants_are_drawn_once_per_seed():
    first, again, other = (DrawnErrors.draw(REALISTIC, JOINTS, seed) for seed in (SEED, SEED, SEED + 1))
    for name in ("joint_offset", "torque_gain", "gyro_bias", "accelerometer_bias", "imu_tilt", "leg_mass"):
        assert not np.allclose(first.drawn[name], other.drawn[name], rtol=1e-6, atol=1e-9)
    assert all(np.array_equal(values, again.drawn[name]) for name, values in first.drawn.items())


def test_constants_have_the_sizes_asked_for():
    many = drawn(joints=20000, joint_offset=5e-3, torque_gain=0.03, leg_mass=0.02)
    for value, mean, size in (
        (many.drawn["joint_offset"], 0, 5e-3), (many.torque_gain, 1, 0.03), (many.leg_mass_scale, 1, 0.02),
    ):  # fmt: skip
        assert value.mean() == pytest.approx(mean, abs=5 * size / np.sqrt(20000))
        assert value.std() == pytest.approx(size, rel=0.03)
    imu = [DrawnErrors.draw(REALISTIC, 1, seed) for seed in range(500)]
    for name in ("gyro_bias", "accelerometer_bias", "imu_tilt"):
        values = np.array([errors.drawn[name] for errors in imu])
        assert values.shape == (500, 3)
        assert values.std() == pytest.approx(getattr(REALISTIC, name), rel=0.1)


def test_one_error_does_not_change_how_another_is_drawn():
    alone, among = drawn(imu_tilt=5e-3), drawn(imu_tilt=5e-3, joint_offset=5e-3, gyro_bias=1e-3, floor_slope=0.1)
    assert np.array_equal(alone.drawn["imu_tilt"], among.drawn["imu_tilt"])


def test_the_slope_is_exact_and_its_direction_drawn():
    directions = np.array([drawn(seed, floor_slope=0.1).gravity_direction for seed in range(200)])
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.allclose(np.arccos(-directions[:, 2]), 0.1)
    assert np.abs(directions[:, :2].mean(axis=0)).max() < 0.02
    assert np.array_equal(drawn().gravity_direction, [0, 0, -1])


def test_a_negative_seed_is_refused(a1):
    with pytest.raises(SettingsError, match="the seed is -1; it must be zero or more"):
        simulate(a1, "ideal", seed=-1)
    with pytest.raises(SettingsError, match="the seed of the noise is -4; it must be zero or more"):
        simulate(a1, "ideal", noise_seed=-4)


# --- noise


@settings(max_examples=60, deadline=None)
@given(
    first=st.integers(0, 5000),
    pieces=st.lists(st.integers(1, 1500), min_size=1, max_size=6),
    seed=st.integers(0, 2**32),
)
def test_noise_does_not_depend_on_the_requested_pieces(first, pieces, seed):
    errors = DrawnErrors.draw(REALISTIC, 4, seed)
    whole = errors.noise(first, sum(pieces))
    starts = first + np.cumsum([0, *pieces[:-1]])
    parts = [errors.noise(int(start), count) for start, count in zip(starts, pieces, strict=True)]
    assert np.array_equal(np.concatenate(parts), whole)


def test_noise_has_the_sizes_asked_for_and_no_correlation():
    errors = DrawnErrors.draw(REALISTIC, 4, SEED)
    noise = errors.noise(0, 20000)
    sizes = np.repeat([0.3e-3, 0.03, 0.2, 3e-3, 0.05], [4, 4, 4, 3, 3])
    assert np.allclose(noise.std(axis=0), sizes, rtol=0.03)
    unit = noise / sizes
    assert np.abs(unit.mean(axis=0)).max() < 0.04
    assert np.abs(unit.T @ unit / 20000 - np.eye(18)).max() < 0.04
    assert np.abs((unit[:-1] * unit[1:]).mean(axis=0)).max() < 0.04


def test_each_seed_has_different_noise():
    one, other = (DrawnErrors.draw(REALISTIC, 4, seed).noise(0, 10) for seed in (0, 1))
    assert not np.isclose(one, other).any()


def test_zero_size_gives_no_noise():
    assert not drawn(joint_offset=1.0).noise(7, 30).any()
    assert drawn(encoder_noise=1.0).noise(0, 0).shape == (0, 3 * JOINTS + 6)


# --- what a platform shows of them


def squat(robot, duration=0.6, depth=0.03):
    """Down and up again, smoothly: joint targets."""
    stance = nominal_stance(robot)
    time = np.arange(round(duration / PERIOD)) * PERIOD
    position, solved = stance.joint_position, []
    for drop in depth * (1 - np.cos(2 * np.pi * time / duration)) / 2:
        position = inverse_kinematics(robot, stance.feet_in_base + np.array([0, 0, drop]), position)
        solved.append(position)
    return Trajectory(np.array(solved))


@pytest.fixture(scope="module")
def motion(a1):
    return squat(a1)


@pytest.fixture(scope="module")
def moved(a1, motion):
    """Records the motion on a robot with some errors."""

    def play(**sizes):
        with simulate(a1, EffectSizes(**sizes), seed=SEED) as simulation:
            return simulation.platform.play(motion)

    return play


@pytest.fixture(scope="module")
def ideal(moved):
    return moved()


@pytest.fixture(scope="module")
def resting(a1):
    """Reads at rest from a robot with some errors."""

    def read(**sizes):
        with simulate(a1, EffectSizes(**sizes), seed=SEED) as simulation:
            return simulation.platform.read()

    return read


@pytest.fixture
def at_every_engine_step(a1):
    """A platform whose control period is one engine step, and how many of them one usual control period takes.

    Joints shake a little at each new command: read but once per command, positions do not say how fast joints are.
    """
    made = []

    def make(**sizes):
        usual = simulate(a1, EffectSizes(**sizes), seed=SEED).platform
        step = usual._model.opt.timestep
        made.extend([usual, MujocoPlatform(a1, usual._simulated, nominal_stance(a1), control_period=step)])
        return made[-1], round(usual.control_period / step)

    yield make
    for platform in made:
        platform.close()


def lag_of(value, rate):
    """Return the lag of a rate behind the derivative of its value [s]."""
    time = PERIOD * np.arange(len(value))
    slope = np.gradient(rate, PERIOD, axis=0)[5:-5]
    return float(np.sum((CubicSpline(time, value)(time, 1) - rate)[5:-5] * slope) / np.sum(slope**2))


def off_derivative(position, velocity, step):
    """Return the errors of velocities against the derivative of positions, and of the engine's own, half a step late."""
    off = (position[2:] - position[:-2]) / (2 * step) - velocity[1:-1]
    return off, np.abs(np.diff(velocity, axis=0)).max() / 2


def test_velocity_is_the_derivative_of_position_without_a_lag(at_every_engine_step, motion, ideal):
    platform, steps = at_every_engine_step()
    joints = platform.play(Trajectory(np.repeat(motion.position, steps, axis=0))).joints
    off, half_step = off_derivative(joints.position, joints.velocity, platform.control_period)
    assert half_step > 1e-3
    assert np.abs(off).max() < 1e-9
    assert np.allclose(ideal.joints.position, joints.position[::steps], atol=1e-9)
    assert np.allclose(ideal.joints.velocity, joints.velocity[::steps], atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_stepping_measures_velocities_without_a_lag(at_every_engine_step, motion, delay):
    platform, steps = at_every_engine_step(command_delay=delay)
    states = [platform.step(motion.command(index // steps)) for index in range(steps * len(motion.position))]
    position, velocity = (np.array([getattr(s, f"joint_{name}") for s in states]) for name in ("position", "velocity"))
    off, half_step = off_derivative(position, velocity, platform.control_period)
    # Without any delay a new command that is about to act is not known to a reading; on average that is worth 0.06 ms.
    surprised = (np.arange(1, len(states) - 1) + 1) % steps == 0 if delay == 0 else np.zeros(len(off), dtype=bool)
    slope = np.gradient(velocity, platform.control_period, axis=0)[1:-1]
    assert half_step > 1e-3
    assert np.abs(off[~surprised]).max() < 1e-9
    assert abs(np.sum((off * slope)[surprised])) <= 0.1e-3 * np.sum(slope[surprised] ** 2)


def test_the_gyroscope_is_the_derivative_of_the_attitude_without_a_lag(a1):
    stance = nominal_stance(a1)
    drop = 0.007 * (1 - np.cos(4 * np.pi * np.arange(250) / 250))[:, None] * np.sign(stance.feet_in_base[:, 1])
    position, attitude, gyro = stance.joint_position, [], []
    with simulate(a1, EffectSizes(command_delay=2e-3)) as simulation:
        platform = simulation.platform
        for heights in drop:
            position = inverse_kinematics(a1, stance.feet_in_base + heights[:, None] * [0, 0, 1], position)
            state = platform.step(JointCommand(position))
            attitude.append(platform._data.qpos[3:7].copy())
            gyro.append(state.angular_velocity_in_imu)
    roll = 2 * np.array(attitude)[:, 1]
    assert np.ptp(roll) > 0.03
    assert abs(lag_of(roll[:, None], np.array(gyro)[:, :1])) < 0.05e-3


def assert_streams_equal(one, other, streams, late=0, tolerance=1e-9):
    """One recording is another, some samples later."""
    for stream, name in streams:
        values, before = getattr(getattr(one, stream), name), getattr(getattr(other, stream), name)
        assert np.allclose(values[late:], before[: len(before) - late], rtol=0, atol=tolerance), name


JOINT_STREAMS = (("joints", "position"), ("joints", "velocity"), ("joints", "torque"))
IMU_STREAMS = (("imu", "angular_velocity_in_imu"), ("imu", "acceleration_in_imu"))


@pytest.mark.parametrize("late", [1, 2, 5])
def test_a_sensor_delay_makes_every_sample_old(moved, ideal, late):
    delayed = moved(sensor_delay=late * PERIOD)
    assert np.array_equal(delayed.joints.time, ideal.joints.time)
    assert_streams_equal(delayed, ideal, JOINT_STREAMS + IMU_STREAMS, late)


@pytest.mark.parametrize("delay", [0.3e-3, 1e-3, 2.5e-3])
def test_a_sensor_delay_may_be_a_fraction_of_a_period(moved, ideal, delay):
    expected = CubicSpline(ideal.joints.time, ideal.joints.position)(ideal.joints.time - delay)
    off = moved(sensor_delay=delay).joints.position - expected
    assert np.abs(off)[5:].max() < 0.02 * np.abs(ideal.joints.position - expected)[5:].max()


@pytest.mark.parametrize("late", [1, 3])
def test_a_command_delay_makes_the_robot_late(moved, ideal, late):
    delayed = moved(command_delay=late * PERIOD)
    assert np.array_equal(delayed.commands.position, ideal.commands.position)
    # The robot still settled by some micrometres when it was asked to move.
    assert_streams_equal(delayed, ideal, (("joints", "position"),), late, tolerance=5e-5)
    assert np.abs(delayed.joints.position - ideal.joints.position).max() > 1e-3 * late


@pytest.mark.parametrize("offset", [0.5e-3, 1.5e-3, -1e-3])
def test_a_clock_offset_makes_the_imu_younger_than_the_encoders(moved, offset):
    apart = moved(sensor_delay=2e-3, imu_clock_offset=offset)
    assert np.array_equal(apart.imu.time, apart.joints.time)
    assert_streams_equal(apart, moved(sensor_delay=2e-3), JOINT_STREAMS)
    assert_streams_equal(apart, moved(sensor_delay=2e-3 - offset), IMU_STREAMS)
    late = moved(sensor_delay=2e-3).imu.angular_velocity_in_imu - apart.imu.angular_velocity_in_imu
    assert np.abs(late).max() > 1e-4


def test_the_loop_closes_on_the_encoder_and_the_joint_is_offset(a1):
    zero = drawn(joint_offset=5e-3).drawn["joint_offset"]
    target, (kp, _) = nominal_stance(a1).joint_position, a1.gains(nominal_stance(a1).hip_height)
    with simulate(a1, EffectSizes(joint_offset=5e-3), seed=SEED) as simulation:
        state = simulation.platform.read()
        true = simulation.platform._data.qpos[simulation.platform._simulated.qpos].copy()
    with simulate(a1, "ideal") as simulation:
        without = simulation.platform.read()
    assert np.allclose(state.joint_torque, kp * (target - state.joint_position), atol=0.05)
    moved_by = true - without.joint_position
    assert np.corrcoef(moved_by, -zero)[0, 1] > 0.5
    assert np.abs(moved_by).max() > 3e-3


def test_the_encoder_error_is_the_joint_offset_in_any_motion(a1):
    zero = drawn(joint_offset=5e-3).drawn["joint_offset"]
    with simulate(a1, EffectSizes(joint_offset=5e-3), seed=SEED) as simulation:
        platform = simulation.platform
        recording = platform.play(squat(a1))
        true = platform._data.qpos[platform._simulated.qpos]
        assert np.allclose(platform.read().joint_position - true, zero, atol=1e-12)
        assert recording.joints.position.std(axis=0).max() > 0.02


def test_a_torque_gain_is_between_the_true_and_the_reported_torque(a1):
    gain = drawn(torque_gain=0.1).torque_gain
    with simulate(a1, EffectSizes(torque_gain=0.1), seed=SEED) as simulation:
        platform = simulation.platform
        target = nominal_stance(a1).joint_position
        state = platform.read()
        true = platform._data.qfrc_actuator[platform._simulated.dof]
        kp, _ = a1.gains(nominal_stance(a1).hip_height)
    assert np.abs(gain - 1).max() > 0.1
    assert np.allclose(state.joint_torque * gain, true, atol=0.02)
    # The motor's own loop is wrong by the same factor: what it reports is what it means to do.
    assert np.allclose(state.joint_torque, kp * (target - state.joint_position), atol=0.05)


def test_a_gyroscope_bias_shows_at_rest(resting):
    bias = drawn(gyro_bias=2e-3).drawn["gyro_bias"]
    assert np.allclose(
        resting(gyro_bias=2e-3).angular_velocity_in_imu - resting().angular_velocity_in_imu, bias, atol=1e-12
    )
    assert np.abs(resting().angular_velocity_in_imu).max() < 2e-3


def test_an_accelerometer_bias_shows_at_rest(resting):
    bias = drawn(accelerometer_bias=0.03).drawn["accelerometer_bias"]
    assert np.allclose(
        resting(accelerometer_bias=0.03).acceleration_in_imu - resting().acceleration_in_imu, bias, atol=1e-12
    )


def test_a_tilted_imu_turns_gravity(resting):
    tilt = drawn(imu_tilt=0.01).drawn["imu_tilt"]
    level, tilted = resting().acceleration_in_imu, resting(imu_tilt=0.01).acceleration_in_imu
    # The IMU turned by +tilt sees the world turned by -tilt.
    assert np.allclose(tilted - level, -np.cross(tilt, level), atol=2e-3)
    assert np.linalg.norm(tilted) == pytest.approx(np.linalg.norm(level), abs=1e-6)


def test_a_tilted_imu_turns_rotations_alike(moved, ideal):
    tilt = drawn(imu_tilt=0.05).drawn["imu_tilt"]
    turned = moved(imu_tilt=0.05).imu.angular_velocity_in_imu
    straight = ideal.imu.angular_velocity_in_imu
    assert np.allclose(turned - straight, -np.cross(tilt, straight), atol=0.02 * np.abs(straight).max())


def test_an_ideal_imu_measures_gravity_upward(resting):
    state = resting()
    assert np.linalg.norm(state.acceleration_in_imu) == pytest.approx(9.81, abs=0.01)
    assert state.acceleration_in_imu[2] > 9.8


@pytest.mark.parametrize("start", ["standing", "lying"])
def test_a_sloping_floor_tilts_gravity(a1, start):
    level, sloping = (simulate(a1, EffectSizes(floor_slope=s), seed=SEED, start=start) for s in (0.0, 0.02))
    down = drawn(floor_slope=0.02).gravity_direction
    off = sloping.platform.read().acceleration_in_imu - level.platform.read().acceleration_in_imu
    # On soft legs the base leans a little further the same way.
    assert np.allclose(off, 9.81 * (np.array([0, 0, -1.0]) - down) * [1, 1, 0], atol=0.05)
    assert np.linalg.norm(off[:2]) > 0.9 * 9.81 * 0.02


def test_friction_holds_joints_short_of_their_targets(moved, ideal):
    rough = moved(coulomb_friction=0.3, viscous_friction=0.05, armature=0.01)
    assert np.ptp(rough.joints.position, axis=0).max() < np.ptp(ideal.joints.position, axis=0).max()


def test_noise_of_a_whole_run_has_its_sizes(a1):
    sizes = {name: getattr(REALISTIC, name) for name in dataclasses.asdict(REALISTIC) if name.endswith("noise")}
    target = Trajectory(np.repeat(nominal_stance(a1).joint_position[None], 1500, axis=0))
    clean, noisy = (simulate(a1, EffectSizes(**s), seed=SEED).platform.play(target) for s in ({}, sizes))
    for stream, name, size in (
        ("joints", "position", "encoder_noise"), ("joints", "velocity", "joint_velocity_noise"),
        ("joints", "torque", "torque_noise"), ("imu", "angular_velocity_in_imu", "gyro_noise"),
        ("imu", "acceleration_in_imu", "accelerometer_noise"),
    ):  # fmt: skip
        noise = getattr(getattr(noisy, stream), name) - getattr(getattr(clean, stream), name)
        assert noise.std() == pytest.approx(sizes[size], rel=0.03)


@settings(max_examples=8, deadline=None)
@given(cuts=st.lists(st.integers(1, 119), unique=True, max_size=5))
def test_a_motion_played_in_pieces_gives_the_same_samples(a1, motion, cuts):
    position = motion.position[:120]
    pieces = np.split(position, sorted(cuts))
    whole, pieced = (simulate(a1, "realistic", seed=SEED).platform for _ in range(2))
    expected = whole.play(Trajectory(position))
    found = [pieced.play(Trajectory(piece)) for piece in pieces]
    for stream, name in (
        ("joints", "position"),
        ("joints", "torque"),
        ("imu", "angular_velocity_in_imu"),
        ("imu", "acceleration_in_imu"),
    ):
        joined = np.concatenate([getattr(getattr(part, stream), name) for part in found])
        assert np.allclose(joined, getattr(getattr(expected, stream), name), rtol=0, atol=1e-9)
