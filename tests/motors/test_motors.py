"""Motor estimates of a simulated robot that swings its legs."""

import dataclasses
import warnings
from itertools import pairwise

import numpy as np
import pytest

from equipoise import BayesianMethod, Calibration, calibrate, load_robot, nominal_stance, simulate
from equipoise.clearance.clearance import Clearance
from equipoise.clearance.in_the_air import LegsInTheAir
from equipoise.errors import MissingDependencyError, ReachError, RecordingError
from equipoise.estimator.motors.delay import _torque_scale, position_loop_delays
from equipoise.estimator.motors.equations import SPACING, averages, motor_samples
from equipoise.estimator.motors.fit import _repetition
from equipoise.experiments.legs_up import legs_up
from equipoise.figures.parts import motors_alone
from equipoise.method.combined import CombinedMethod
from equipoise.method.table import method_from_dict
from equipoise.motors.method import Motors
from equipoise.recording.phases import Phase
from equipoise.recording.trials import MotorTrial
from equipoise.report.contents import run_contents
from equipoise.result.body import Body
from equipoise.robot.description import RobotDescription
from equipoise.terminal.results import print_calibration


@pytest.fixture(scope="module")
def swung(a1):
    """Result and recordings of an A1 whose joints differ in friction."""
    kept = []
    with simulate(a1, "realistic", seed=5, effects={"friction_spread": 0.3}) as simulation:
        result = calibrate(simulation.platform, a1, Motors(motor_time=5.0), keep=kept.append)
        return result.with_truth_of_parts(simulation.truth_of_parts), kept


def test_motors_match_the_simulation(swung):
    result, _ = swung
    for name, most in (("coulomb_friction", 0.05), ("armature", 0.1), ("viscous_friction", 0.15)):
        found = [getattr(joint, name) for joint in result.joints.values()]
        assert np.sqrt(np.mean([(one.error / one.truth) ** 2 for one in found])) < most
    delays = [joint.delay for joint in result.joints.values()]
    assert max(abs(delay.error) for delay in delays) < 0.4e-3
    everything = [one for motor in result.motors.values() for one in motor.quantities.values()]
    assert np.mean([one.missed for one in everything]) < 0.15


def test_spinning_rotors_do_not_bias_armatures(a1):
    with simulate(a1, "ideal", effects={"armature": None, "rotor_spin": 1 / 9}) as simulation:
        result = calibrate(simulation.platform, a1, Motors(motor_time=5.0))
        result = result.with_truth_of_parts(simulation.truth_of_parts)
    errors = [one.armature.error / one.armature.truth for one in result.joints.values()]
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


def test_friction_is_never_negative(a1):
    with simulate(a1, "realistic", seed=3, effects={"coulomb_friction": 0.0, "viscous_friction": 0.0}) as simulation:
        result = calibrate(simulation.platform, a1, Motors(motor_time=5.0))
        result = result.with_truth_of_parts(simulation.truth_of_parts)
    found = [one for joint in result.joints.values() for one in (joint.coulomb_friction, joint.viscous_friction)]
    assert min(one.value for one in found) == 0.0
    assert np.mean([one.missed for one in found]) < 0.15


def test_the_control_law_replaces_torques_that_obey_it(a1, swung):
    recording, scale = swung[1][0], nominal_stance(a1).scale.time
    other = recording.joints.torque.copy()
    other[:, 2] += 1.5 * np.sin(7 * recording.joints.time)
    strange = dataclasses.replace(recording, joints=dataclasses.replace(recording.joints, torque=other))
    apart = np.array([_taken_less_reported(a1, one, scale) for one in (recording, strange)])
    assert ((apart > 0) & (apart < 0.1))[0].all()
    assert apart[1, 2] < 1e-12
    assert ((apart > 0) & (apart < 0.1))[1, np.arange(12) != 2].all()


def _taken_less_reported(robot, recording, scale):
    """Return (nj,) mean distances of the used torques from the averages of the reported ones [Nm]."""
    samples, joints = motor_samples(robot, [recording], scale), recording.phase(Phase.SWING).joints
    reported = averages(joints.time, samples.time, SPACING * scale) @ joints.torque
    return np.abs(samples.torque - reported).mean(axis=0)


def test_too_short_a_swing_raises(a1, swung):
    recording = swung[1][0]
    start = recording.phase(Phase.SWING).joints.time[0]
    early = [replace_time(event, start) for event in recording.events]
    with pytest.raises(RecordingError, match=r"the joints swung for 0.1 s; 2 s are needed"):
        motor_samples(a1, [dataclasses.replace(recording, events=tuple(early))], nominal_stance(a1).scale.time)


def replace_time(event, start):
    """Move events after the start of the swing to 0.1 s after it."""
    return dataclasses.replace(event, time=start + 0.1) if event.time > start else event


def test_joints_with_more_friction_are_identified(swung):
    frictions = [joint.coulomb_friction for joint in swung[0].joints.values()]
    truth, found = np.array([(one.truth, one.value) for one in frictions]).T
    assert np.corrcoef(truth, found)[0, 1] > 0.9


def test_legs_touch_nothing_while_they_swing(a1, swung):
    moving = swung[1][0].phase(Phase.SWING).joints.position[::25]
    clearance = LegsInTheAir(a1, nominal_stance(a1), 0.005)
    assert all(clearance.kept(position) for position in moving)
    low = legs_up(a1, nominal_stance(a1)).joint_position.copy()
    low[a1.legs["FL"].joints[1]] -= 1.5  # a thigh half down: the shank is in the floor
    assert not clearance.kept(low)


def test_legs_that_would_collide_turn_up_in_pairs(a1):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cheetah = load_robot("mini_cheetah")
    except MissingDependencyError as error:
        pytest.skip(str(error))
    assert len(legs_up(a1, nominal_stance(a1)).way) == 1
    up = legs_up(cheetah, nominal_stance(cheetah))
    assert len(up.way) == 2
    clearance, through = Clearance(cheetah, up.folded), (up.folded, *up.way, *up.way_back)
    for before, after in pairwise(through):
        assert clearance.first_contact(np.linspace(before, after, 300)) is None
    assert (through[-1] == up.folded).all()


def test_gains_are_a_quarter_and_recorded(a1, swung):
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    assert swung[1][0].trial == MotorTrial(kp=kp / 4, kd=kd / 4)


def test_without_torques_the_commands_replace_them(a1, swung):
    (recording,) = swung[1]
    blind = dataclasses.replace(recording, joints=dataclasses.replace(recording.joints, torque=None))
    result = Motors().estimate(a1, [blind], nominal_stance(a1))
    assert "their correlation is -" in result.warnings[0]
    for name, joint in result.joints.items():
        assert joint.coulomb_friction.value == pytest.approx(swung[0].joints[name].coulomb_friction.value, rel=0.3)
        assert joint.delay.value == pytest.approx(4e-3, abs=1e-3)


def cut(stream, start, end):
    """Remove the samples of a stream between two times [s]."""
    kept = (stream.time < start) | (stream.time > end)
    return dataclasses.replace(
        stream,
        **{
            field.name: getattr(stream, field.name)[kept]
            for field in dataclasses.fields(stream)
            if getattr(stream, field.name) is not None
        },
    )


@pytest.mark.parametrize("streams", [("imu",), ("imu", "joints")])
def test_samples_near_a_gap_are_excluded(a1, swung, streams):
    result, (recording,) = swung
    middle = recording.phase(Phase.SWING).joints.time.mean()
    gapped = dataclasses.replace(
        recording, **{name: cut(getattr(recording, name), middle, middle + 0.09) for name in streams}
    )
    other = Motors().estimate(a1, [gapped], nominal_stance(a1))
    for name, joint in result.joints.items():
        for what in ("armature", "viscous_friction"):
            found, before = getattr(other.joints[name], what), getattr(joint, what)
            assert abs(found.value - before.value) < before.std


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_another_torque_constant_does_not_bias_the_delay(a1, swung, factor):
    result, (recording,) = swung
    joints = dataclasses.replace(recording.joints, torque=factor * recording.joints.torque)
    other = Motors().estimate(a1, [dataclasses.replace(recording, joints=joints)], nominal_stance(a1))
    for name, joint in result.joints.items():
        assert other.joints[name].delay.value == pytest.approx(joint.delay.value, abs=0.3e-3)  # 10 % looked like 1.2 ms


def test_velocity_noise_does_not_bias_the_torque_constant(a1, swung):
    result, (recording,) = swung
    joints = recording.joints
    noise = 0.15 * np.random.default_rng(0).standard_normal(joints.velocity.shape)
    noisy = dataclasses.replace(recording, joints=dataclasses.replace(joints, velocity=joints.velocity + noise))
    time_scale = nominal_stance(a1).scale.time
    assert _torque_scale([noisy], [range(12)], time_scale) == 1.0
    delays, _ = position_loop_delays(a1, [noisy], time_scale)
    truth = [motor.delay.truth for motor in result.motors.values()]
    assert np.mean(delays - truth) == pytest.approx(0.0, abs=1.5e-4)


@pytest.mark.parametrize("name", ["torque", "velocity"])
def test_constant_zeros_count_as_unreported(a1, swung, name):
    (recording,) = swung[1]
    blind, zeros = (
        dataclasses.replace(recording, joints=dataclasses.replace(recording.joints, **{name: column}))
        for column in (None, np.zeros_like(recording.joints.position))
    )
    expected, found = (Motors().estimate(a1, [one], nominal_stance(a1)) for one in (blind, zeros))
    assert found.motors == expected.motors
    assert found.warnings == expected.warnings


def test_a_joint_that_never_slides_does_not_narrow_other_intervals():
    rng = np.random.default_rng(1)
    residual, used = np.cumsum(rng.normal(size=(400, 2)), axis=0), np.ones((400, 2))
    used[:, 1] = 0.0
    expected = _repetition(residual[:, :1], used[:, :1])
    residual[:, 1] = np.inf
    assert _repetition(residual, used) == pytest.approx(expected)
    assert expected > 2


def test_model_errors_of_other_joints_widen_every_interval(a1, swung):
    """All reported torques except the last calf's have load-dependent friction."""
    result, (recording,) = swung
    joints = recording.joints
    friction = 0.15 * np.sign(joints.velocity) * np.abs(joints.torque) * (np.arange(12) < 11)
    greased = dataclasses.replace(recording, joints=dataclasses.replace(joints, torque=joints.torque + friction))
    found = Motors().estimate(a1, [greased], nominal_stance(a1))
    *others, last = found.motors.values()
    assert last.residual < 0.1 * max(one.residual for one in others)
    assert last.armature.std > 3 * list(result.motors.values())[-1].armature.std


def test_slow_joints_stretch_the_phases(a1):
    slow = dataclasses.replace(a1, velocity_limit=np.full(12, 3.0))
    with simulate(a1, "realistic") as simulation:
        kept = []
        calibrate(simulation.platform, slow, Motors(motor_time=3.0), keep=kept.append)
    (recording,) = kept
    swing, moving = recording.phase(Phase.SWING), np.abs(np.diff(recording.commands.position, axis=0)).max(axis=1) > 0
    assert swing.duration > 3.5
    after = recording.commands.time[1:] > swing.joints.time[-1] + 1.5
    fold = next(event.time for event in recording.events if event.data.get("name") == Phase.FOLD)
    assert not moving[after & (recording.commands.time[1:] < fold - 0.01)].any()


def test_a_planar_com_with_motors_is_a_result_of_its_own(swung):
    assert motors_alone(swung[0])
    assert not motors_alone(dataclasses.replace(swung[0], composite=Body.partial(com_in_base=(0.01, 0.0, None))))


def test_a_report_of_motors_alone_begins_with_them(swung):
    contents = run_contents(swung[0])
    (table,) = contents.first
    assert len(table.rows) == 12
    assert [row[0] for row in table.rows[:2]] == ["FL_hip_joint", "FR_hip_joint"]
    assert "Coulomb friction 0.2" in contents.lead
    for found, name in zip(contents.sections["Motors"], ("coulomb_friction", "viscous_friction"), strict=False):
        estimates, truths = found.data
        first = getattr(swung[0].joints["FL_hip_joint"], name)
        scale = estimates["x"][0] / first.value
        assert estimates["error_x"]["array"][0] == pytest.approx(scale * first.half_width, rel=1e-3)
        assert truths["x"][0] == pytest.approx(scale * first.truth, rel=1e-3)


def test_the_terminal_shows_estimates_truths_and_the_export(swung, tmp_path, capsys):
    result = swung[0]
    print_calibration(result, [], kept=tmp_path)
    shown = capsys.readouterr().out
    estimates, truths = shown.split("unitree_a1: motors, ground truth")
    assert "unitree_a1: motors, 95 % +-" in estimates
    words = next(line for line in truths.splitlines() if "RR_calf_joint" in line).split()
    assert float(words[1]) == pytest.approx(result.motors["RR_calf_joint"].coulomb_friction.truth, abs=1e-3)
    assert "s of robot time; the method motors has no checks." in truths
    assert f"export with: equipoise export {tmp_path} --to toml\n" in truths
    unknown = result.with_truth_of_parts({})
    print_calibration(unknown, [])
    assert "ground truth" not in capsys.readouterr().out


def test_a_result_round_trips(swung, tmp_path):
    swung[0].save(tmp_path / "result.json")
    assert Calibration.load(tmp_path / "result.json").motors == swung[0].motors


def test_legs_that_cannot_turn_up_raise():
    narrow = {f"{leg}_thigh_joint": (-1.0, 1.6) for leg in ("FL", "FR", "RL", "RR")}
    robot = load_robot("unitree_a1", RobotDescription(joint_limits=narrow))
    stance = nominal_stance(robot)
    with pytest.raises(ReachError, match="'unitree_a1' cannot turn its legs up"):
        Motors(motor_stance="belly").check(robot, stance)
    assert Motors().lies(load_robot("unitree_a1"), stance)
    assert not Motors().lies(robot, stance)  # it stands on three feet instead
    assert "lifts the fourth" in Motors().rehearse(robot, stance).doing


def test_a_run_without_a_swing_raises(a1):
    with pytest.raises(RecordingError, match=r"no complete swing of all joints.*--resume RUN"):
        Motors().estimate(a1, [], nominal_stance(a1))


def test_settings_of_both_methods_round_trip():
    both = CombinedMethod(BayesianMethod(duration=60.0), Motors(motor_time=7.0))
    assert method_from_dict(both.to_dict()) == both
    assert both.having({"mass": 12.0}).base.mass == 12.0
