"""Motion of the base from joints and IMU."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from equipoise import nominal_stance, simulate
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.trials import BayesianTrials
from equipoise.experiments.stand import stand_up
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import JointStream, Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.posture import BodyPosture
from equipoise.view.base_motion import STEP, BaseTracker


class Witnessed(PlatformWrapper):
    """Simulated platform that records the true base motion every ten milliseconds."""

    def __init__(self, simulation):
        super().__init__(simulation.platform)
        self._look, self.seen, self.recordings, self._count = simulation.ground_truth, [], [], 0

    def step(self, command):
        if self._count % 5 == 0:
            self.seen.append(self._look())
        self._count += 1
        return self._inner.step(command)

    def play(self, trajectory, stop=None):
        self.recordings.append(play_by_stepping(self, trajectory, stop))
        return self.recordings[-1]


def witnessed(robot, noise):
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com + [0.01, 0, 0]  # so that it tips
    with simulate(robot, noise, seed=5) as simulation:
        platform = Witnessed(simulation)
        standing, _ = stand_up(platform, robot, stance)
        trials = BayesianTrials(standing, stance, com)
        trials.lift(LiftDesign(BodyPosture(), "FL_RR", 0))
        trials.take_posture(BodyPosture(roll=0.15, yaw=0.25, crouch=0.1))
        trials.lift(LiftDesign(BodyPosture(roll=0.15, yaw=0.25, crouch=0.1), "FR_RL", 1, "roll"))
    return SimpleNamespace(stance=stance, seen=platform.seen, recordings=platform.recordings)


def tracked(robot, run):
    """Return the motion that the tracker computes, at the times of the truth, and the truth."""
    tracker = BaseTracker(robot, run.stance)
    parts = [part for recording in run.recordings if (part := tracker.take(recording)) is not None]
    time = np.concatenate([part.steps.joints.time for part in parts])
    feet, rotation, standing = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("feet_in_world", "rotation_base_to_world", "standing")
    )
    truth = [ground_truth for ground_truth in run.seen if time[0] <= ground_truth.time <= time[-1]]
    at = (
        np.searchsorted(time - STEP / 2, [ground_truth.time for ground_truth in truth], side="right") - 1
    )  # the nearest
    true_feet = np.array([ground_truth.feet for ground_truth in truth])
    return SimpleNamespace(
        truth=truth, true_feet=true_feet, feet=feet[at], rotation=rotation[at], standing=standing[at]
    )


@pytest.mark.parametrize(("noise", "place", "tilt"), [("ideal", 1e-3, 8e-3), ("realistic", 4e-3, 10e-3)])
def test_the_pose_of_the_base_agrees_with_the_simulation(a1, noise, place, tilt):
    run = witnessed(a1, noise)
    seen = tracked(a1, run)
    # Its position and heading in the room at the start are unknown.
    start, began = seen.feet[0], seen.true_feet[0]
    one, other = start - start.mean(axis=0), began - began.mean(axis=0)
    angle = np.arctan2((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum(), (one[:, :2] * other[:, :2]).sum())
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    feet = (seen.feet - start.mean(axis=0) * [1, 1, 0]) @ turn.T + began.mean(axis=0) * [1, 1, 0]
    error = feet - seen.true_feet
    assert np.linalg.norm(error, axis=2).max() < 3 * place, "any foot at any time"
    assert np.sqrt((error**2).sum(axis=2).mean()) < place
    up = np.array([ground_truth.up for ground_truth in seen.truth])
    true_tilt = np.array([ground_truth.tilt for ground_truth in seen.truth])
    felt = np.arccos(np.clip(seen.rotation[:, 2, 2], -1, 1))
    assert np.abs(felt - true_tilt).max() < tilt
    assert up[:, 2].min() > 0.99
    in_air = np.array([ground_truth.clearance for ground_truth in seen.truth]) > 6e-3
    assert in_air.any()
    assert seen.standing[in_air].max() < 0.5


def test_the_motion_does_not_depend_on_the_pieces_of_a_recording(a1, ideal_motions):
    recording = ideal_motions.lift
    whole = BaseTracker(a1, ideal_motions.stance).take(recording)
    tracker = BaseTracker(a1, ideal_motions.stance)
    edges = [-1.0, *np.linspace(recording.joints.time[0], recording.joints.time[-1], 23)[1:-1], 1e6]
    pieces = [recording.between(start, end) for start, end in itertools.pairwise(edges)]
    parts = [part for piece in pieces if (part := tracker.take(piece)) is not None]

    def both(read):
        return np.concatenate([read(part) for part in parts]), read(whole)

    for joined, expected in (
        both(lambda motion: motion.steps.joints.time),
        both(lambda motion: motion.steps.joints.position),
        both(lambda motion: motion.steps.joints.torque),
        both(lambda motion: motion.steps.imu.angular_velocity_in_imu),
        both(lambda motion: motion.steps.imu.acceleration_in_imu),
        both(lambda motion: motion.position_in_world),
        both(lambda motion: motion.standing),
    ):
        assert np.allclose(joined, expected, atol=1e-8)
    assert np.allclose(np.diff(whole.steps.joints.time), STEP)


def test_a_clock_that_is_reset_begins_again(a1, ideal_motions):
    tracker = BaseTracker(a1, ideal_motions.stance)
    first, second = tracker.take(ideal_motions.lift), tracker.take(ideal_motions.move)
    assert second.steps.joints.time[0] < first.steps.joints.time[0]
    assert np.isfinite(second.position_in_world).all()


def test_feet_count_alike_without_joint_torques(a1, ideal_motions):
    lift = ideal_motions.lift
    bare = Recording(lift.joint_names, JointStream(lift.joints.time, lift.joints.position), lift.imu)
    without, motion = (BaseTracker(a1, ideal_motions.stance).take(recording) for recording in (bare, lift))
    assert without.steps.joints.torque is None
    assert np.abs(without.position_in_world - motion.position_in_world).max() < 5e-3


def test_a_recording_may_complete_no_step(a1, ideal_motions):
    lift = ideal_motions.lift
    assert BaseTracker(a1, ideal_motions.stance).take(lift.between(-1, lift.joints.time[2])) is None
