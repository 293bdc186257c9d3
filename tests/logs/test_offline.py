"""Estimates from foreign logs: as accurate as with events, and with their limitations."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from foreign_logs import Bag, as_log, columns_of, every, shifted, without, write_bag, write_csv
from scipy.spatial.transform import Rotation

from equipoise import BayesianMethod, simulate
from equipoise.cli import main
from equipoise.errors import MotionError, RecordingError
from equipoise.estimator.measurements.lift_samples import attitudes
from equipoise.estimator.unknowns import Priors
from equipoise.experiments.stand import stand_up
from equipoise.logs.finding import LogFinding
from equipoise.logs.joint_names import map_joints
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import Log, RawImu, RawJoints, RawLog, assemble
from equipoise.recording.recording import Recording
from equipoise.recording.trials import LiftTrial
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.terminal.log_summary import print_log_report


@pytest.fixture(scope="module")
def log(bayesian_run):
    """All that a calibration of 40 s recorded, without its events."""
    return as_log(bayesian_run.recordings)


# Their torque constant is known, as by default it is not: else torques do not determine the mass.
KNOWN_MOTORS = Priors(torque_gain_common=1e-3)


def estimated(robot, log, **settings):
    read = Log(log, map_joints(robot, log.joint_names), {}, ())
    return estimate_log(robot, read, BayesianMethod(**settings))


@pytest.fixture(scope="module")
def found(a1, log):
    return estimated(a1, log)


def errors(result, truth):
    """(10,) errors and (10,) standard deviations of the whole robot."""
    return result.composite.values - components(truth.composite), result.composite.stds


def verdicts_of(found):
    return {quantity.name: quantity.verdict for quantity in found.result.composite}


def agrees(result, truth):
    """Nine of ten parameters within their 95 % intervals, and none far outside."""
    off, stds = errors(result, truth)
    z = np.abs(off / stds)
    assert (z < 1.96).sum() >= 9, dict(zip(COMPONENTS, z.round(1), strict=True))
    assert z.max() < 3.5
    return z


def test_a_log_without_events_agrees_with_the_run(found, bayesian_run):
    agrees(found.result, bayesian_run.truth)
    own_off, own_deviations = errors(bayesian_run.result, bayesian_run.truth)
    off, stds = errors(found.result, bayesian_run.truth)
    assert (stds < 1.3 * own_deviations).all()
    assert np.abs(off - own_off)[1:4].max() < 1e-3  # [m] of the centre of mass
    assert found.result.trustworthy
    used = [one for one in found.report.segments if one.kind == "lift" and one.used]
    assert len(used) >= sum(isinstance(one.trial, LiftTrial) for one in bayesian_run.recordings) - 2


def test_the_estimates_verdict_is_on_the_segment(found):
    for trial, one in zip(
        found.result.trials, [one for one in found.report.segments if one.recording is not None], strict=True
    ):
        assert trial.note == one.reason_unused


@pytest.mark.parametrize(
    "change",
    {
        "rates": lambda log: replace(log, joints=every(log.joints, 5), imu=every(log.imu, 2)),
        "late start and clock": lambda log: replace(log, imu=shifted(without(log.imu, 0, 3), 0.04)),
        "gaps": lambda log: replace(log, imu=without(log.imu, 9, 9.8), joints=without(log.joints, 25, 25.2)),
        "no velocities": lambda log: replace(log, joints=replace(log.joints, velocity=None)),
    }.items(),
    ids=lambda item: item[0],
)
def test_other_rates_starts_and_gaps(a1, log, bayesian_run, change):
    name, make = change
    other = estimated(a1, make(log), leg_prior="narrow", cable="none")
    agrees(other.result, bayesian_run.truth)
    off, _ = errors(other.result, bayesian_run.truth)
    assert np.abs(off[1:4]).max() < 3e-3
    messages = " ".join(finding.message for finding in other.report.findings)
    late = re.search(r"the IMU's time stamps are (\d+) ms late relative to the joints'", messages)
    assert (late is not None) == (name == "late start and clock")
    assert late is None or abs(int(late.group(1)) - 40) <= 5  # [ms]: the resolution of the legs
    assert (sum(one.kind == "gap" for one in other.report.segments) == 2) == (name == "gaps")


def test_a_slower_log_has_a_larger_std_and_a_finding(a1, log, found, bayesian_run):
    before = found.result.composite.stds
    for step, rate in ((5, 100), (10, 50)):
        slower = estimated(a1, replace(log, joints=every(log.joints, step), imu=every(log.imu, step)))
        agrees(slower.result, bayesian_run.truth)
        assert np.linalg.norm(slower.result.composite.stds[1:4]) > np.linalg.norm(before[1:4])
        before = slower.result.composite.stds
        messages = " ".join(finding.message for finding in slower.report.findings)
        assert (f"come at {rate} Hz; a lift lasts half a second" in messages) == (rate == 50)


def test_an_orientation_in_place_of_the_gyroscope_has_a_larger_std(a1, log, found, bayesian_run):
    """The orientation is that of a filter that relies on the gyroscope."""
    turned = attitudes(log.imu.time, log.imu.angular_velocity_in_imu)
    level, _ = Rotation.align_vectors([[0, 0, 1]], log.imu.acceleration_in_imu[:1])
    noise = Rotation.from_rotvec(1e-4 * np.random.default_rng(5).standard_normal((len(log.imu.time), 3)))
    quaternions = np.roll((level * turned * noise).as_quat(), 1, axis=1)
    raw = RawLog(
        RawJoints(log.joints.time, log.joint_names, log.joints.position, log.joints.velocity, log.joints.torque),
        RawImu(log.imu.time, None, log.imu.acceleration_in_imu, quaternions),
    )
    fused = estimate_log(a1, assemble(a1, raw), BayesianMethod())
    agrees(fused.result, bayesian_run.truth)
    assert (fused.result.composite.stds[1:4] > found.result.composite.stds[1:4]).all()
    assert any("derived from the fused orientation" in finding.message for finding in fused.report.findings)


def test_without_lifts_torques_determine_little(a1, log, found, bayesian_run):
    lifts = [one for one in found.report.segments if one.kind == "lift"]
    for one in lifts:
        log = replace(log, imu=without(log.imu, one.start, one.end), joints=without(log.joints, one.start, one.end))
    other = estimated(a1, log, priors=KNOWN_MOTORS)
    agrees(other.result, bayesian_run.truth)
    verdicts = verdicts_of(other)
    assert verdicts["mass"] == "doubtful"  # only torques determine it, which is a failed check
    assert other.result.composite.mass.std < 0.03 * bayesian_run.truth.composite.mass  # a tenth of its prior
    assert verdicts["Ixx"] == verdicts["Izz"] == "not identified"
    assert other.report.limitations[0].startswith("The log has no lift of two diagonal feet after a rest")
    assert other.report.limitations[-1].startswith("Not identified by this log: Ixx, Iyy, Izz")
    assert not other.result.trustworthy


def test_standing_alone_determines_the_mass(a1, bayesian_run):
    with simulate(a1, "realistic", seed=bayesian_run.seed, payload="1.5,0.05,-0.02,0.06") as simulation:
        standing, _ = stand_up(simulation.platform, a1, bayesian_run.stance)
        standing.play(standing.motion().hold(4.0))
        log = as_log([standing.finish()])
    other, unsure = estimated(a1, log, priors=KNOWN_MOTORS), estimated(a1, log)
    for one in (other, unsure):
        agrees(one.result, bayesian_run.truth)
        assert {segment.kind for segment in one.report.segments} == {"rest"}
    verdicts = verdicts_of(other)
    assert verdicts["mass"] == "doubtful"  # without lifts
    assert other.result.composite.mass.std < 0.15 * bayesian_run.truth.composite.mass  # half of its prior
    assert verdicts_of(unsure)["mass"] == "not identified"  # their torque constant is unknown
    assert verdicts["com_z"] == verdicts["Iyy"] == "not identified"
    assert any("no stance motion" in message for message in other.report.limitations)


def test_without_torques_the_scales_mass_counts(a1, log, bayesian_run):
    silent = replace(log, joints=replace(log.joints, torque=None))
    without_scale, with_scale = estimated(a1, silent), estimated(a1, silent, mass=bayesian_run.truth.composite.mass)
    agrees(with_scale.result, bayesian_run.truth)
    assert any("no joint torques and no --mass" in message for message in without_scale.report.limitations)
    assert not any("--mass" in message for message in with_scale.report.limitations)
    spread = [one.result.composite.inertia.Iyy.std for one in (without_scale, with_scale)]
    assert spread[1] < 0.7 * spread[0]


def test_a_log_without_anything_usable_shows_what_it_holds(a1, log, found):
    lift = next(one for one in found.report.segments if one.kind == "lift")
    moving = log.between(lift.start + 0.3, lift.end - 0.1)
    with pytest.raises(
        RecordingError, match=r"nothing in the log can be used. It contains motion: no rest in it"
    ) as raised:
        estimated(a1, moving)
    assert [one.kind for one in raised.value.report.segments] == ["motion"]
    assert raised.value.details["log"]["segments"][0]["used"] is False
    assert raised.value.exit_code == RecordingError.exit_code


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: with_joints(log, position=np.degrees), "are joint positions in degrees"),
        (lambda log: with_joints(log, velocity=np.degrees), "is it in degrees per second"),
        (
            lambda log: with_imu(log, angular_velocity_in_imu=np.degrees),
            r"gyroscope.*\(is it in degrees per second\?\)",
        ),
        (lambda log: with_imu(log, acceleration_in_imu=lambda values: values / 9.81), "is it in units of g"),
        (lambda log: with_imu(log, angular_velocity_in_imu=np.zeros_like), "readings are the same in the whole log"),
        (lambda log: with_joints(log, torque=np.negative), "do they have the wrong sign"),
        (lambda log: with_joints(log, torque=lambda values: 1000 * values), "are they those of the joints, in Nm"),
        (
            lambda log: with_joints(log, position=first_thigh, velocity=first_thigh),
            "'FL_thigh_joint' seems to have the wrong",
        ),
    ],
)
def test_wrong_units_and_signs_are_named(a1, log, change, message):
    with pytest.raises(RecordingError, match=message):
        estimated(a1, change(log))


def with_joints(log, **changes):
    return replace(log, joints=replace(log.joints, **{k: f(getattr(log.joints, k)) for k, f in changes.items()}))


def with_imu(log, **changes):
    return replace(log, imu=replace(log.imu, **{k: f(getattr(log.imu, k)) for k, f in changes.items()}))


def first_thigh(values):
    return values * np.where(np.arange(12) == 1, -1, 1)


def test_a_log_of_another_robot_does_not_pass(skewed, a1, log):
    """Other legs under the same names."""
    renamed = Recording(skewed.joint_names, log.joints, log.imu)
    with pytest.raises((RecordingError, MotionError)):  # nor is its IMU rotated
        estimated(skewed, renamed)


# --- the command line


@pytest.fixture(scope="module")
def bag(log, tmp_path_factory):
    """Log of another driver: joints permuted and renamed, an arm, another rate and start of the IMU."""
    order = np.random.default_rng(3).permutation(12)
    name = {"FL": "lf", "FR": "rf", "RL": "lh", "RR": "rh", "hip": "haa", "thigh": "hfe", "calf": "kfe"}
    names = ["_".join(name[word] for word in log.joint_names[k].split("_")[:2]) for k in order]
    joints, imu = every(log.joints, 2), every(log.imu, 3, 400)
    joints = replace(
        joints, **{quantity: np.pad(getattr(joints, quantity)[:, order], ((0, 0), (0, 1))) for quantity in QUANTITIES}
    )
    path = tmp_path_factory.mktemp("bags") / "wiggle"
    return Bag(path, "sqlite3").joints("/joint_states", [*names, "arm"], joints).imu("/imu/data", imu).write()


QUANTITIES = ("position", "velocity", "torque")


def test_a_foreign_bag_from_the_command_line(bag, bayesian_run, tmp_path, capsys):
    out = tmp_path / "found.json"
    known = ["--leg-prior", "narrow", "--cable", "none"]
    assert main(["estimate", str(bag), "--robot", "unitree_a1", *known, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for part in (
        "joints: /joint_states (sensor_msgs/msg/JointState)", "rates: joints 250 Hz, IMU 167 Hz", "FL_hip_joint", "lf_haa",
        "leg and place", "other joints, not used: arm", "lifts", "stance motion", "method bayesian", "identified", "saved: ",
    ):  # fmt: skip
        assert part in shown, part
    assert f"see {tmp_path / 'found.html'}" in shown
    assert "Around the centre of mass" in (tmp_path / "found.html").read_text(encoding="utf-8")
    saved = json.loads(out.read_text())
    assert saved["provenance"]["log"] == str(bag)
    truth = bayesian_run.truth.composite
    found = saved["composite"]["com_in_base"]
    np.testing.assert_allclose(found[:2], truth.com[:2], atol=2e-3)
    std = saved["composite"]["uncertainty"]["intervals"]["com_z"]["std"]
    assert std < 2.5e-3  # few lifts, at slow rates
    assert abs(found[2] - truth.com[2]) < 3 * std


def test_steps_that_are_left_out_are_explained_once(found, capsys):
    meaning = "Legs and IMU alone can mistake which feet are up"
    for count in (0, 2):
        findings = [LogFinding("contacts", "joint torques contradict 2 of 9 steps")] * count
        print_log_report(replace(found.report, findings=findings))
        assert capsys.readouterr().out.count(meaning) == min(count, 1)


def test_json_is_one_object_with_the_logs_section(log, a1, tmp_path, capsys):
    table = write_csv(
        tmp_path / "log.csv", columns_of(replace(log, joints=every(log.joints, 5), imu=every(log.imu, 5)))
    )
    arguments = ["estimate", str(table), "--robot", "unitree_a1", "--json", "--mass", "13.9"]
    assert main([*arguments, "--from", "2s", "--until", "30s"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["composite"]["mass"] == pytest.approx(13.9, abs=0.3)
    assert result["log"]["joints"]["FL_hip_joint"] == {"log": "FL_hip_joint", "how": "same name"}
    assert {"start", "end", "kind", "what", "used", "reason_unused"} == set(result["log"]["segments"][0])
    assert result["log"]["segments"][-1]["end"] < 30.1


def test_an_error_of_a_log_is_an_object_with_its_pieces(log, found, tmp_path, capsys):
    lift = next(one for one in found.report.segments if one.kind == "lift")
    path = write_bag(tmp_path / "bag", log.between(lift.start + 0.3, lift.end - 0.1))
    assert main(["estimate", str(path), "--robot", "unitree_a1", "--json"]) == 5
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["type"] == "RecordingError"
    assert error["log"]["segments"][0]["reason_unused"].startswith("no rest in it")
    assert main(["estimate", str(path), "--robot", "unitree_a1"]) == 5
    shown = capsys.readouterr()
    assert "no rest in it" in shown.out
    assert shown.err.startswith("error: nothing in the log can be used")


def test_flags_of_logs_and_of_runs_are_not_mixed(bag, tmp_path, capsys):
    assert main(["estimate", str(bag)]) == 5
    assert "pass --robot ROBOT for a log of another program" in capsys.readouterr().err
    assert main(["estimate", str(bag), "--imu-topic", "/imu/data"]) == 2
    assert "pass --robot too" in capsys.readouterr().err.replace("\n", " ")
    assert main(["estimate", str(bag), "--robot", "unitree_a1", "--feet", "measured"]) == 2
    assert "--feet belongs to --method paper; this is --method bayesian" in capsys.readouterr().err


def test_a_joint_map_from_the_command_line(bag, tmp_path, capsys):
    (tmp_path / "map.toml").write_text('FL_hip_joint = "elbow"\n')
    arguments = ["estimate", str(bag), "--robot", "unitree_a1", "--joint-map", str(tmp_path / "map.toml")]
    assert main(arguments) == 2
    assert "gives 'elbow' for FL_hip_joint; the log's joints are" in capsys.readouterr().err


def test_an_equipoise_run_is_read_as_before(bayesian_run, a1, tmp_path, capsys):
    from equipoise.calibration.run_folder import RunFolder  # noqa: PLC0415

    settings = bayesian_run.settings
    with RunFolder.create(tmp_path / "run", a1, settings, {}) as folder:
        for recording in bayesian_run.recordings:
            folder.keep(recording)
    assert main(["estimate", str(folder.path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert "log" not in result
    assert result["composite"]["mass"] == pytest.approx(bayesian_run.result.composite.mass.value)
