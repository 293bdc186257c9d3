"""Runs with --rotate-halfway, which separates effects fixed in the world from those fixed to the robot."""

import os
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_plan import candidates_of

from equipoise import BayesianMethod, RunFolder, calibrate, nominal_stance, simulate
from equipoise.bayesian import method as bayesian_method
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.trials import BayesianTrials
from equipoise.cli import main
from equipoise.errors import ReachError, SettingsError
from equipoise.estimator.equations.stance_motion import StanceMotion, StanceMotions
from equipoise.estimator.measurements.heading import angle_turned, facing
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.momenta import model_parameters
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.measurements.traced import Traced
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors, model_values
from equipoise.experiments.stand import stand_up
from equipoise.platform.logged_platform import Logged
from equipoise.platform.platform import TURNS
from equipoise.platform.resumed import RepeatedSimulation, ResumedRobot
from equipoise.platform.stepped import PlatformWrapper
from equipoise.recording.trials import DesignedLift, TurnTrial, read_trial
from equipoise.robot.inertial import composite_parameters
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import EffectSizes
from equipoise.simulation.mujoco_contacts import foothold_heights

LOG = "recording_0.mcap"
SETTINGS = BayesianMethod(duration=65, mass=14.0, excitation=False, rotate_halfway=True)
WORLD = {
    "preset": "realistic",
    "payload": "1.5,0.05,-0.02,0.06",
    "seed": 4,
    "timestep": 1e-3,
    "effects": {"cable": 0.3},
}


@pytest.fixture(scope="module")
def run(a1, tmp_path_factory):
    """Run with a rotation on a robot with a cable: folder, result and true cable force."""
    path, sizes = tmp_path_factory.mktemp("turned") / "run", []

    class Sized(PlatformWrapper):
        def play(self, trajectory, stop=None):
            sizes.append(((path / LOG).stat().st_size, {event.data.get("name") for event in trajectory.events}))
            return super().play(trajectory, stop)

    with RunFolder.create(path, a1, SETTINGS, {}) as folder, simulate(a1, **WORLD) as simulation:
        platform = Sized(Logged(simulation.platform, folder.log))
        result = calibrate(platform, a1, SETTINGS, folder.keep).with_truth(simulation.truth)
        cable = simulation.errors.cable_in_world
    turn = next(number for number, (_, phases) in enumerate(sizes) if "turn" in phases)
    recordings = RunFolder.open(path).recordings()
    return SimpleNamespace(path=path, result=result, cable=cable, recordings=recordings, turned=sizes[turn + 1][0])


def test_an_external_force_is_separated_from_the_com(run):
    posterior = run.result.evidence.posterior
    force, std = posterior.unknowns.value(posterior.x, "external_force"), posterior.std("external_force")
    assert (std < 0.12).all()
    assert np.abs(force - run.cable[:2]).max() < 3 * std.max()
    assert np.abs(run.result.composite.com_in_base.errors[:2]).max() < 1e-3
    assert run.result.trustworthy


def test_recordings_determine_the_heading(a1, run):
    evidence = read_motions(a1, nominal_stance(a1), run.recordings)
    headings = [abs(motion.lift.heading) for motion in evidence if motion.lift is not None]
    assert headings[0] == 0.0
    assert headings[-1] == pytest.approx(np.pi, abs=np.radians(2))
    assert sorted(headings) == headings


def test_lifts_precede_and_follow_one_rotation(run):
    kinds = [type(recording.trial) for recording in run.recordings]
    turned = kinds.index(TurnTrial)
    assert kinds.count(TurnTrial) == 1
    assert DesignedLift in kinds[:turned]
    assert DesignedLift in kinds[turned + 1 :]
    assert [trial.kind for trial in run.result.trials].count("turn") == 1
    assert read_trial(TurnTrial().to_data()) == TurnTrial()


def test_a_run_is_resumed_after_the_rotation(a1, run, tmp_path):
    """The run was killed after the rotation, before the robot stands up."""
    path = shutil.copytree(run.path, tmp_path / "run")
    os.truncate(path / LOG, run.turned)
    folder, content = RunFolder.resume(path, repeats=True)
    assert content.plays[-1].recording.has_phase("turn")
    assert not content.closed
    with folder, simulate(a1, **WORLD) as simulation:
        platform = RepeatedSimulation(Logged(simulation.platform, folder.log), simulation.platform, content)
        result = calibrate(platform, a1, SETTINGS, folder.keep)
    assert [one.value for one in result.composite] == [one.value for one in run.result.composite]


def test_a_resumed_run_does_not_repeat_the_rotation(a1, run):
    content, asked = RunFolder.open(run.path).read(), []
    with simulate(a1, **WORLD) as simulation:
        robot = ResumedRobot(simulation.platform, content)
        result = calibrate(robot, a1, SETTINGS, operator_done=lambda: asked.append(1))
    assert not asked
    assert [one.value for one in result.composite] == [one.value for one in run.result.composite]
    assert np.array_equal(result.composite.covariance, run.result.composite.covariance)


def test_world_vectors_rotate_opposite_to_the_heading():
    world, headings = Traced(np.array([[3.0], [1.0]])), np.array([0.0, np.pi / 2, np.pi])
    seen = facing(Traced(np.repeat(world.value, 3, axis=1)), headings)
    assert np.allclose(seen.value, [[3, 1, -3], [1, -3, -1]])


def test_world_effects_change_sign_in_the_equations(a1, ideal_motions):
    stance, legs = ideal_motions.stance, LegChains(a1)
    motions = read_motions(a1, stance, [ideal_motions.move, ideal_motions.lift])
    there, back = model_values(a1), model_values(a1)
    for name in ("external_force", "floor_slope"):
        there[name], back[name] = np.array([0.3, -0.2]), np.array([-0.3, 0.2])
    lift, move = motions[1].lift, motions[0].of(StanceMotion)[0]

    def y(lift, values):
        return TiltInvariant(a1, legs, [lift]).evaluate(values, model_parameters(a1))[0]

    def rows(move, values):
        return StanceMotions(Unknowns(a1, stance, Priors()), [(0, move)]).residuals(values)

    assert np.allclose(y(replace(lift, heading=np.pi), there), y(lift, back), rtol=0, atol=1e-12)
    assert not np.allclose(y(lift, there), y(lift, back), rtol=0, atol=1e-6)
    assert np.allclose(rows(replace(move, heading=np.pi), there), rows(move, back), rtol=0, atol=1e-12)


def test_new_footholds_have_heights_of_their_own(a1, ideal_motions):
    stance, values = ideal_motions.stance, model_values(a1)
    move = read_motions(a1, stance, [ideal_motions.move, ideal_motions.lift])[0].of(StanceMotion)[0]
    values["foothold_change"] = np.array([1e-3, 0.0, 0.0, 0.0])

    def heights(heading):
        rows = StanceMotions(Unknowns(a1, stance, Priors()), [(0, replace(move, heading=heading))])
        return rows.residuals(values)[0, 3:] - rows.residuals(model_values(a1))[0, 3:]

    assert np.allclose(heights(0.0), 0)
    assert np.allclose(heights(np.pi), 1e-3 * np.array([-0.75, 0.25, 0.25, 0.25]))


def test_a_planned_rotation_reduces_the_std(a1):
    candidates = candidates_of(a1, combined_priors=BayesianMethod(rotate_halfway=True).combined_priors)
    turned, unknowns = candidates.turned(), candidates.unknowns
    there, back = candidates.rows[3], turned.rows[3]
    assert np.allclose(there[:, unknowns["external_force"]], -back[:, unknowns["external_force"]], atol=1e-9)
    assert np.allclose(there[:, unknowns["accelerometer_bias"]], back[:, unknowns["accelerometer_bias"]], atol=1e-9)
    once, both = make_plan(candidates, 110.0), make_plan(candidates, 110.0, turn=True)
    assert both.std[2] < 0.85 * once.std[2]
    assert both.std[1] < once.std[1]
    assert both.robot_time < 110.0
    first = both.visits[: both.rotate_after]
    assert 0 < len(first) < len(both.visits)
    assert once.rotate_after is None
    assert [name for name, _ in both.trials()].index("turned by 180 deg") == 1 + len(first)
    assert both.to_dict()["rotate_after"] == len(first)
    with pytest.raises(SettingsError, match=r"30 s allows no lift after the search; give (3[5-9]|40) s or more"):
        make_plan(candidates, 30.0, turn=True)


def test_only_a_turned_robot_has_new_footholds():
    assert BayesianMethod().combined_priors.foothold_change == 0.0
    assert BayesianMethod(rotate_halfway=True).combined_priors == Priors()


def test_a_robot_that_cannot_lie_is_not_turned(a1, monkeypatch):
    monkeypatch.setattr(bayesian_method, "lies", lambda *_: False)
    with pytest.raises(
        ReachError, match="'unitree_a1' cannot lie down over its feet to be turned; omit --rotate-halfway"
    ):
        SETTINGS.check(a1, nominal_stance(a1))


class ManualRotation(PlatformWrapper):
    """Robot that an operator has to turn."""

    def __init__(self, inner):
        super().__init__(inner)
        self.accepts = inner.accepts - {TURNS}


def test_a_robot_without_an_operator_is_not_turned(a1):
    with simulate(a1, "ideal") as simulation, pytest.raises(SettingsError) as caught:
        calibrate(ManualRotation(simulation.platform), a1, SETTINGS)
    assert str(caught.value) == (
        "an operator has to turn the robot and confirm it: give `operator_done` to calibrate(), or omit `rotate_halfway`"
    )


def test_the_gyroscope_measures_the_rotation(a1, run):
    turned = next(recording for recording in run.recordings if isinstance(recording.trial, TurnTrial))
    assert abs(angle_turned(a1, turned)) == pytest.approx(np.pi, abs=np.radians(2))


def test_dart_turns_the_robot(a1):
    pytest.importorskip("dartpy")
    stance = nominal_stance(a1)
    with simulate(a1, "realistic", engine="dart") as simulation:
        standing, _ = stand_up(simulation.platform, a1, stance)
        recording = BayesianTrials(standing, stance, composite_parameters(a1, stance.joint_position).com).turn()
        feet = simulation.ground_truth().feet
    ahead = (feet[:2] - feet[2:]).sum(axis=0)
    heading = np.arctan2(ahead[1], ahead[0])
    off = (angle_turned(a1, recording) - heading + np.pi) % (2 * np.pi) - np.pi
    assert abs(heading) > np.radians(175)
    assert abs(off) < np.radians(2)


def test_footholds_are_fixed_in_the_world(a1):
    errors = DrawnErrors.draw(EffectSizes(foothold_height=1e-3), 12, 3)
    fl, fr, rl, rr = foothold_heights(errors, 0.0)
    assert np.allclose(foothold_heights(errors, np.pi), [rr, rl, fr, fl])


@pytest.mark.parametrize("method", ["paper", "static"])
def test_other_methods_reject_rotate_halfway(capsys, method):
    assert main(["calibrate", "--method", method, "--rotate-halfway"]) == 2
    assert f"--rotate-halfway belongs to --method bayesian; this is --method {method}" in capsys.readouterr().err


def test_plan_and_rehearsal_contain_the_rotation(a1, capsys):
    assert main(["plan", "--rotate-halfway", "--duration", "60s"]) == 0
    assert "turned by 180 deg" in capsys.readouterr().out
    assert "is turned by hand half-way, joints damped" in SETTINGS.rehearse(a1, nominal_stance(a1)).doing
