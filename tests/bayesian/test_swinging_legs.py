"""Lifts in which the lifted feet swing, and the leg parameters they determine."""

import dataclasses

import numpy as np
import pytest

from equipoise import BayesianMethod, Calibration, calibrate, estimate, nominal_stance, simulate
from equipoise.bayesian.lift_design import LiftDesign, lift_feet, lift_settings
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.cli import main
from equipoise.errors import SettingsError
from equipoise.estimator.unknowns import Priors
from equipoise.recording.event import TRIAL, Event
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.recording.trials import DesignedLift
from equipoise.report.contents import run_contents
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.posture import BodyPosture
from equipoise.terminal.results import print_calibration

LEANING = BodyPosture(roll=0.2, yaw=0.1)
WRONG_LEGS = {"leg_mass_common": 0.1, "leg_com_common": 8e-3, "leg_length": 1.5e-3}


@pytest.fixture(scope="module")
def found(a1):
    """Result and recordings of a run on a robot whose legs differ from the model file."""
    kept = []
    with simulate(
        a1, "realistic", seed=4, effects=WRONG_LEGS, disabled_effects=("cable",), timestep=1e-3
    ) as simulation:
        weighed = simulation.truth.composite.mass
        settings = BayesianMethod(
            duration=80.0, mass=weighed, mass_std=0.005 * weighed, cable="none", excitation=False, swings=True
        )
        result = calibrate(simulation.platform, a1, settings, kept.append)
        return result.with_truth(simulation.truth).with_truth_of_parts(simulation.truth_of_parts), kept


@pytest.mark.parametrize("swing", ["ahead", "aside"])
def test_lifted_feet_swing_to_and_fro_at_one_height_and_the_others_stand(a1, swing):
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    design = LiftDesign(LEANING, "FL_RR", 1, swing=swing)
    _, lifted = lift_feet(stance, com, design, lift_settings(stance).height)
    amounts = design.amounts(stance, 2e-3)
    feet = np.array([design.feet(lifted, com, amount) for amount in amounts]) - lifted
    standing = [leg in DIAGONALS["FL_RR"] for leg in LEG_NAMES]
    assert (feet[:, standing] == 0).all()
    level = feet[:, ~np.array(standing)] @ LEANING.rotation.T
    assert np.abs(level[..., 2]).max() < 1e-12
    along, across = (level[..., axis] for axis in ((0, 1) if swing == "ahead" else (1, 0)))
    assert np.abs(across).max() < 1e-12
    assert along.max() == pytest.approx(-along.min(), rel=1e-3)
    assert 0.04 < along.max() < 0.07
    assert np.abs(feet[-1]).max() < 1e-12


def test_swings_reduce_the_predicted_std_of_height_and_inertia(a1):
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    plans = [
        make_plan(Candidates.of(a1, stance, com, Priors(external_force=0.0), swings=swings), 90.0)
        for swings in (False, True)
    ]
    without, with_them = plans
    assert not any(lift.swing for visit in without.visits for lift in visit.lifts)
    swings = [lift.swing for visit in with_them.visits for lift in visit.lifts if lift.swing]
    assert len(swings) >= 3
    assert (with_them.std[3:6] < 0.85 * without.std[3:6]).all()


def test_links_are_found_within_their_intervals(found):
    result, kept = found
    assert sum(getattr(recording.trial, "swing", None) is not None for recording in kept) >= 3
    assert result.trustworthy
    everything = [one for link in result.links.values() for one in link.quantities.values() if one.value is not None]
    assert len(everything) == 4 * (4 + 5 + 5)
    assert np.mean([one.missed for one in everything]) < 0.15
    assert sum(one.missed for one in result.composite) <= 1  # of ten at 95 %


def test_swings_reduce_the_std_of_thighs(a1, found):
    """The reduction is larger than that from the number of lifts alone."""
    result, kept = found
    settings = BayesianMethod.from_dict({name: value for name, value in result.settings.items() if name != "method"})
    passive = [recording for recording in kept if getattr(recording.trial, "swing", None) is None]
    without = estimate(a1, passive, settings)
    for name, link in result.links.items():
        if name.endswith("thigh"):
            stds = np.array([[one.std for one in other.moment] for other in (link, without.links[name])])
            assert (stds[0] < stds[1]).all()
            assert stds[0, 2] < 0.85 * stds[1, 2]


def test_unidentified_links_are_reported(found, capsys):
    """A hip link moves too little."""
    result, _ = found
    hips = [link for name, link in result.links.items() if name.endswith("hip")]
    assert {one.verdict for hip in hips for one in hip.moment} == {"not identified"}
    assert all(hip.length.value is None for hip in hips)
    print_calibration(result, [])
    shown = capsys.readouterr().out
    assert "a1: links, 95 % +-" in shown
    assert "In brackets: not identified, posterior std above half of the prior std" in " ".join(shown.split())
    assert max(map(len, shown.splitlines())) <= 80


def test_links_of_a_run_whose_checks_fail_are_doubtful(found):
    link = found[0].links["FL_thigh"].doubted()
    verdicts = {name: one.verdict for name, one in found[0].links["FL_thigh"].quantities.items()}
    assert {name: one.verdict for name, one in link.quantities.items()} == {
        name: "doubtful" if verdict in ("identified", "weak") else verdict for name, verdict in verdicts.items()
    }
    assert link.moment_z.value == found[0].links["FL_thigh"].moment_z.value


def test_a_result_with_links_is_read_as_it_was_written(found, tmp_path):
    result, _ = found
    result.save(tmp_path / "result.json")
    assert Calibration.load(tmp_path / "result.json").links == result.links


def test_the_page_has_a_table_of_links(found):
    assert len(run_contents(found[0]).sections["Legs"][0].rows) == 12


def test_a_lift_with_a_swing_is_read_as_it_was_recorded():
    trial = DesignedLift(
        diagonal="FL_RR", offset=0.0, lift_height=0.02, tilt_threshold=0.01, posture=LEANING, side=-1, swing="aside"
    )

    def recorded(data):
        joints, imu = JointStream([0.0], [[0.0]]), ImuStream([0.0], [[0.0] * 3], [[0.0] * 3])
        return Recording(("a",), joints, imu, None, (Event(0.0, TRIAL, data),))

    assert recorded(trial.to_data()).trial == trial
    assert trial.meanwhile == "swing aside"


def test_legs_cannot_be_estimated_with_a_narrow_prior():
    with pytest.raises(SettingsError, match="legs cannot be estimated with leg_prior 'narrow'; omit one of them"):
        dataclasses.replace(BayesianMethod(leg_prior="narrow"), swings=True)


def test_the_command_line_plans_swings_for_the_bayesian_method_only(capsys):
    assert main(["plan", "unitree_a1", "--parameters", "legs", "--duration", "60s"]) == 0
    shown = capsys.readouterr().out
    assert "swing aside" in shown
    assert "links of the model file, predicted 95 % +-" in shown
    assert main(["plan", "unitree_a1", "--parameters", "legs", "--method", "paper"]) == 2
    assert "--parameters legs needs --method bayesian" in capsys.readouterr().err
