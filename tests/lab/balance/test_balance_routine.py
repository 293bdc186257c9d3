"""Balance trials of simulated robots, and their evaluation."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from equipoise import nominal_stance, simulate
from equipoise.errors import FallError, MotionError, SettingsError
from equipoise.lab.balance.balance_routine import balance
from equipoise.lab.balance.evaluation import evaluate, true_traces
from equipoise.lab.balance.model_error import calibrated, displaced, error_along, model_file, with_composite
from equipoise.lab.balance.observer import SensorCorrections, StateEstimator, leveling
from equipoise.platform.platform import MotionInterrupted, RobotState
from equipoise.result.body import Body
from equipoise.robot.inertial import composite_parameters
from equipoise.simulation.ground_truth_view import GroundTruthRecorder


class Wrapped:
    """Platform with only the required interface, which applies a function to every state that `step` returns."""

    def __init__(self, platform, modify=lambda state: state):
        self._platform, self._modify = platform, modify
        self.control_period, self.joint_names = platform.control_period, platform.joint_names
        self.commands = []

    def read(self):
        return self._platform.read()

    def play(self, trajectory, stop=None):
        return self._platform.play(trajectory, stop)

    def step(self, command):
        self.commands.append(command)
        return self._modify(self._platform.step(command))

    def close(self):
        self._platform.close()


def stand(robot, error, diagonal="FL_RR", noise="ideal", seconds=3.0, seed=0):
    stance = nominal_stance(robot)
    with simulate(robot, noise, seed=seed) as simulation:
        model = displaced(robot, stance, simulation.truth, diagonal, error).model
        recorder = GroundTruthRecorder(simulation.ground_truth, 5)
        run = balance(Wrapped(simulation.platform), robot, model, diagonal, seconds, watch=recorder.watch)
        last = simulation.ground_truth()
    traces = true_traces(run, recorder.ground_truths)
    return SimpleNamespace(run=run, traces=traces, verdict=evaluate(run, traces), last=last)


@pytest.fixture(scope="module")
def balanced(a1):
    return stand(a1, 0.0)


@pytest.fixture(scope="module")
def fallen(a1):
    return stand(a1, 0.02)


def test_an_a1_with_the_true_model_balances(balanced):
    verdict = balanced.verdict
    assert verdict.balanced
    assert verdict.failure is None
    assert verdict.time_balanced == 3.0
    assert verdict.com_std < 0.5e-3
    assert verdict.largest_tilt < np.radians(2)
    assert verdict.largest_torque < 15
    assert verdict.foot_travel < 1e-3


def test_the_estimated_states_agree_with_the_simulated_truth(balanced):
    estimated, true = balanced.run.estimates, balanced.traces
    at = np.searchsorted(estimated.time, true.time[:-1] - 1e-9)
    later = true.time[:-1] > 0.2
    for name, tolerance in (("tilt", np.radians(0.3)), ("com_ahead", 0.5e-3), ("clearance", 3e-3)):
        difference = getattr(estimated, name)[at] - getattr(true, name)[:-1]
        assert np.abs(difference[later]).max() < tolerance, name


def test_the_recording_holds_the_phases_and_every_sample(balanced):
    recording = balanced.run.recording
    for name in ("rest", "move", "unload", "lift", "balance", "lower"):
        assert recording.has_phase(name)
    assert np.allclose(np.diff(recording.joints.time), 2e-3)
    assert recording.commands.position.shape == recording.joints.position.shape
    assert recording.phase("lift").joints.time[0] == pytest.approx(balanced.run.lift_off)


def test_the_feet_are_put_back(balanced):
    assert np.abs(balanced.last.clearance).max() < 1e-3
    assert balanced.last.tilt < 0.02


def test_an_a1_with_a_com_error_of_20_mm_falls_and_its_joints_are_held(a1, fallen):
    verdict = fallen.verdict
    assert not verdict.balanced
    assert verdict.failure is not None
    assert 0.1 < verdict.time_balanced < 1.5
    assert verdict.com_std is None
    assert fallen.run.ending in ("touched", "tilted")
    recording = fallen.run.recording
    assert recording.has_phase("catch")
    assert np.allclose(recording.commands.position[-1], nominal_stance(a1).joint_position)


def test_a_robot_leans_to_where_its_true_centre_of_mass_is_over_the_line(a1):
    leaning = stand(a1, -0.004, diagonal="FR_RL", noise="realistic", seconds=3.0, seed=3)
    assert leaning.verdict.balanced
    assert leaning.verdict.off_line == pytest.approx(0, abs=1e-3)
    assert np.radians(2) < leaning.verdict.tilt < np.radians(9)
    assert leaning.run.estimates.com_ahead[-500:].mean() == pytest.approx(-0.004, abs=2e-3)


def test_ctrl_c_puts_the_feet_down_and_keeps_the_recording(a1):
    def interrupt(state):
        if state.time > 3.6 and not seen:
            seen.append(state.time)
            raise KeyboardInterrupt
        return state

    seen = []
    with simulate(a1, "ideal") as simulation:
        platform = Wrapped(simulation.platform, interrupt)
        with pytest.raises(MotionInterrupted) as caught:
            balance(platform, a1, a1, "FL_RR")
        last = simulation.ground_truth()
    assert seen
    recording = caught.value.recording
    assert recording.has_phase("lift")
    assert recording.has_phase("lower")
    assert np.abs(last.clearance).max() < 2e-3
    assert last.tilt < 0.05


@pytest.mark.parametrize("sensor", ["joint_position", "angular_velocity_in_imu", "acceleration_in_imu"])
def test_a_measurement_that_is_not_finite_ends_the_trial_with_the_feet_down(a1, sensor):
    def spoil(state):
        if 3.4 < state.time < 3.41:
            return dataclasses.replace(state, **{sensor: np.full_like(getattr(state, sensor), np.nan)})
        return state

    with simulate(a1, "ideal") as simulation:
        platform = Wrapped(simulation.platform, spoil)
        with pytest.raises(MotionError, match="is not finite; the feet were lowered") as caught:
            balance(platform, a1, a1, "FR_RL")
        last = simulation.ground_truth()
    assert all(np.isfinite(command.position).all() for command in platform.commands)
    assert caught.value.recordings[0].has_phase("lower")
    assert np.abs(last.clearance).max() < 2e-3


def test_an_unknown_diagonal_raises_an_error(a1):
    with simulate(a1, "ideal") as simulation, pytest.raises(SettingsError, match="diagonal is 'FL_RL'"):
        balance(simulation.platform, a1, a1, "FL_RL")


@pytest.mark.parametrize("duration", [0.0, np.inf])
def test_a_duration_out_of_range_raises_an_error(a1, duration):
    with simulate(a1, "ideal") as simulation, pytest.raises(SettingsError, match="the duration is"):
        balance(simulation.platform, a1, a1, "FL_RR", duration)


def test_the_ground_truth_describes_a_standing_robot_on_a_slope(a1):
    with simulate(a1, "realistic", seed=5) as simulation:
        ground_truth = simulation.ground_truth()
        down = simulation.errors.gravity_direction
        state = simulation.platform.read()
    assert np.allclose(ground_truth.up, -down)
    assert ground_truth.time == state.time == 0
    assert np.abs(ground_truth.clearance).max() < 1e-3
    assert ground_truth.com[2] == pytest.approx(0.3, abs=0.03)
    assert 0 < ground_truth.tilt < 0.05


def at_rest(robot, up_in_base, corrections):
    mounting = np.array(robot.imu_in_base.rotation)
    reading = mounting.T @ (9.81 * np.array(up_in_base))
    state = RobotState(0.0, np.zeros(len(robot.joint_names)), None, None, np.full(3, 0.01), reading)
    return StateEstimator(robot, corrections, [state] * 10, 2e-3), state


def test_the_estimator_follows_the_gyroscope_without_its_bias(a1):
    estimator, state = at_rest(a1, [0, 0, 1], SensorCorrections.none(a1))
    rate = np.array([0.2, -0.1, 0.0])
    for _ in range(50):
        estimator.update(dataclasses.replace(state, angular_velocity_in_imu=state.angular_velocity_in_imu + rate))
    assert np.allclose(estimator.lean, 0.1 * rate[:2], atol=1e-3)
    assert np.allclose(estimator.angular_velocity_in_base, rate)


def test_sensor_errors_are_subtracted(a1):
    corrections = SensorCorrections(np.full(12, 0.01), np.array([0.02, 0, 0]), np.zeros(3))
    estimator, _ = at_rest(a1, [0, 0, 1], corrections)
    assert np.allclose(estimator.joint_position, -0.01)
    assert np.allclose(estimator.command_for(estimator.joint_position), 0)
    assert estimator.lean[0] == pytest.approx(-0.02, abs=1e-4)


def test_a_robot_that_lies_on_its_side_raises_an_error(a1):
    with pytest.raises(FallError, match="leans by 90 deg"):
        at_rest(a1, [0, 1, 0], SensorCorrections.none(a1))


def test_leveling_turns_a_vector_to_the_vertical():
    rng = np.random.default_rng(1)
    for _ in range(5):
        up = rng.normal(size=3) * [0.2, 0.2, 1] + [0, 0, 2]
        up /= np.linalg.norm(up)
        turn = leveling(up)
        assert np.allclose(turn @ up, [0, 0, 1])
        assert np.allclose(turn @ turn.T, np.eye(3))


def test_a_displaced_design_model_differs_from_the_truth_only_by_the_displacement(a1):
    stance = nominal_stance(a1)
    with simulate(a1, "realistic", payload="2,0.1,0.03,0.05", seed=1) as simulation:
        truth = simulation.truth
    for diagonal in ("FL_RR", "FR_RL"):
        design = displaced(a1, stance, truth, diagonal, 0.007)
        assert error_along(stance, diagonal, design.model, truth) == pytest.approx(0.007, abs=1e-9)
        whole = composite_parameters(design.model, stance.joint_position)
        assert whole.mass == pytest.approx(truth.composite.mass)
        assert np.linalg.norm(whole.com - truth.composite.com) == pytest.approx(0.007, abs=1e-9)


def test_a_whole_robot_lighter_than_its_legs_raises_an_error(a1):
    with pytest.raises(SettingsError, match=r"whole robot is 5.00 kg, but the legs of 'unitree_a1' have"):
        with_composite(a1, nominal_stance(a1), 5.0, np.zeros(3))


def test_a_bayesian_calibration_gives_mass_inertia_and_sensor_errors(a1, bayesian_run):
    stance = bayesian_run.stance
    design = calibrated(a1, stance, bayesian_run.result)
    estimate = bayesian_run.result.composite.parameters()
    whole = composite_parameters(design.model, stance.joint_position)
    assert whole.mass == pytest.approx(estimate.mass)
    assert np.allclose(whole.com, estimate.com, atol=1e-9)
    assert design.source == "a calibration by the method bayesian"
    with simulate(a1, "realistic", seed=bayesian_run.seed) as simulation:
        drawn = simulation.errors
    assert design.sensors.any
    # Remaining errors are smaller than the drawn ones: units, signs and order are right.
    for name in ("joint_offset", "imu_tilt"):
        left = getattr(design.sensors, name) - drawn.drawn[name]
        assert np.linalg.norm(left) < 0.7 * np.linalg.norm(drawn.drawn[name]), name


def test_a_planar_calibration_moves_the_com_in_the_plane_only(a1, bayesian_run):
    stance, result = bayesian_run.stance, bayesian_run.result
    x, y, _ = result.composite.com_in_base.values
    planar = dataclasses.replace(
        result,
        composite=Body.partial(com_in_base=(x, y, None)),
        base=Body.partial(),
        sensors=(),
    )
    design = calibrated(a1, stance, planar)
    nominal, whole = (composite_parameters(robot, stance.joint_position) for robot in (a1, design.model))
    assert np.allclose(whole.com, [x, y, nominal.com[2]], atol=1e-9)
    assert whole.mass == pytest.approx(nominal.mass)
    assert not design.sensors.any
    unknown = dataclasses.replace(planar, composite=Body.partial())
    with pytest.raises(SettingsError, match="has no planar centre of mass"):
        calibrated(a1, stance, unknown)


def test_a_calibration_of_another_model_raises_an_error(two_jointed, bayesian_run):
    with pytest.raises(SettingsError, match="with another model file than"):
        calibrated(two_jointed, nominal_stance(two_jointed), bayesian_run.result)


def test_the_model_file_is_the_unchanged_design_model(a1):
    design = model_file(a1)
    assert design.model is a1
    assert not design.sensors.any
