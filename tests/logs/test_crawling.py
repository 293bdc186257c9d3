"""Logs of a robot that crawls: times on three feet are detected and compared with foot loads."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_logs import estimated

from equipoise import nominal_stance, simulate
from equipoise.errors import RecordingError
from equipoise.lab.gaits.crawl import ORDER, SHIFT, STANDING, SWING, crawl
from equipoise.logs.motions.loads import FootLoads
from equipoise.logs.motions.segments import find_segments
from equipoise.logs.motions.track import Track
from equipoise.recording.trials import CrawlTrial, Step, read_trial
from equipoise.robot.inertial import components
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import LEG_NAMES

DURATION = 9.2  # [s]
STEPS = 5


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture(scope="module")
def crawled(a1):
    """Log of a crawling robot, and its true parameters."""
    with simulate(a1, "realistic", "1.2,0.06,0.02,0.08", seed=7) as simulation:
        return SimpleNamespace(log=crawl(simulation.platform, a1, DURATION), truth=simulation.truth.composite)


@pytest.fixture(scope="module")
def found(a1, crawled):
    return estimated(a1, crawled)


def without_torques(log):
    return replace(log, joints=replace(log.joints, torque=None))


def steps_of(segments):
    return [step for one in segments if one.recording for step in getattr(one.recording.trial, "steps", ())]


def test_every_foot_is_seen_to_be_up_in_turn(found, stance):
    steps = steps_of(found.report.segments)
    assert [step.lifted for step in steps] == [*ORDER, ORDER[0]]
    for number, step in enumerate(steps):
        up = stance.scale.time * (STANDING + number * (SHIFT + SWING) + SHIFT)
        assert up - 0.05 < step.start < step.end < up + stance.scale.time * SWING + 0.05
    assert {one.kind for one in found.report.segments if one.recording} == {"rest", "crawl"}


def test_torques_of_a_crawl_determine_the_planar_com(a1, crawled, found):
    true, whole = components(crawled.truth), found.result.composite
    errors, stds = whole.values - true, whole.stds
    assert (np.abs(errors[1:3]) < (0.006, 0.004)).all()
    assert sum(one.lower <= value <= one.upper for one, value in zip(whole, true, strict=True)) == 10
    assert (stds[1:3] < (0.005, 0.003)).all()
    standing = estimated(a1, crawled, crawled.log.between(0.0, 1.1)).result.composite
    assert (stds[1:3] < 0.7 * standing.stds[1:3]).all()


def test_limitations_of_a_crawl_are_reported(found):
    assert "The robot crawls with at least three feet on the floor: the CoM's height" in " ".join(
        found.report.limitations
    )
    assert found.result.composite.com_in_base.z.verdict == "not identified"


def test_a_crawl_without_torques_is_refused_with_what_is_missing(a1, crawled):
    with pytest.raises(
        RecordingError, match="on three feet: no joint torques: times on three feet determine nothing without"
    ):
        estimated(a1, crawled, without_torques(crawled.log))


@pytest.mark.parametrize(("factor", "message"), [(0.02, "the joint torques carry only"), (-1.0, "check their sign")])
def test_torques_that_do_not_carry_the_robot_are_not_used(a1, stance, crawled, factor, message):
    log = crawled.log.between(1.5, np.inf)  # in a rest they are screened
    wrong = replace(log, joints=replace(log.joints, torque=factor * log.joints.torque))
    crawls = [one for one in find_segments(a1, stance, wrong) if one.kind == "crawl"]
    assert crawls
    assert all(message in one.reason_unused for one in crawls)


def test_a_crawl_needs_no_rest(a1, stance, crawled):
    segments = find_segments(a1, stance, crawled.log.between(1.5, np.inf))
    assert len(steps_of(segments)) == STEPS
    assert {one.kind for one in segments if one.used} == {"crawl"}


# --- what the feet carry

OFFSET, COUNTS = np.array([40.0, -15.0, 3.0, 120.0]), np.array([1.5, 2.2, 1.8, 3.0])


def sensed(a1, log):
    """Readings of foot force sensors, in whole counts."""
    force = feet_and_forces(a1, log.joints.position, log.joints.torque)[1][:, :, 2]
    return FootLoads("foot forces", log.joints.time, np.round(OFFSET + COUNTS * force))


def confirmed(a1, stance, log, forces):
    findings = []
    steps = steps_of(find_segments(a1, stance, log, forces, findings))
    return steps, " ".join(one.message for one in findings if "foot forces" in one.message)


def test_sensors_of_the_feet_confirm_steps_in_any_unit(a1, stance, crawled, found):
    steps, message = confirmed(a1, stance, crawled.log, sensed(a1, crawled.log))
    assert [step.lifted for step in steps] == [step.lifted for step in steps_of(found.report.segments)]
    assert message == ""


def test_a_foot_that_carries_all_the_time_is_not_up(a1, stance, crawled, found):
    """Only the foot sensor reads so."""
    _, dragged, *_ = steps_of(found.report.segments)
    forces = sensed(a1, crawled.log)
    wrong = forces.load.copy()
    leg = LEG_NAMES.index(dragged.lifted)
    wrong[(forces.time > dragged.start - 0.2) & (forces.time < dragged.end + 0.2), leg] = OFFSET[leg] + 50 * COUNTS[leg]
    steps, message = confirmed(a1, stance, crawled.log, FootLoads("foot forces", forces.time, wrong))
    assert [step.lifted for step in steps] == [ORDER[0], *ORDER[2:], ORDER[0]]
    assert "foot forces contradict 1 of 5 steps found by legs and IMU: a lifted foot carries load" in message


def test_sensors_of_other_feet_are_named_and_not_used(a1, stance, crawled):
    forces = sensed(a1, crawled.log)
    swapped = FootLoads("foot forces", forces.time, forces.load[:, [1, 0, 3, 2]])
    steps, message = confirmed(a1, stance, crawled.log, swapped)
    assert "foot forces contradict most of 5 steps found by legs and IMU, and are not used" in message
    assert len(steps) == STEPS


def loads(*rows):
    return FootLoads("foot forces", 0.01 * np.arange(len(rows)), np.array(rows))


def test_feet_that_are_up_carry_nothing_and_those_that_stand_do():
    step = Step(("FL", "RR"), 0.0, 1.0)
    assert not loads(*[[1.8, 0.6, 0.2, 2.0]] * 10).contradicts(step)
    assert loads(*[[1.8, 0.8, 0.2, 2.0]] * 10).contradicts(step)
    assert loads(*[[0.2, 0.1, 0.1, 2.0]] * 10).contradicts(step)
    assert not loads(*[[1.8, 0.1, 0.1, 2.0]] * 8, *[[1.0, 6.0, 0.1, 1.0]] * 2).contradicts(step)  # it lands
    assert not loads(*[[1.8, np.nan, 0.1, 2.0]] * 10).contradicts(step)  # no sensor to believe


def on_three(lifted, start, end):
    return Step(tuple(leg for leg in LEG_NAMES if leg != lifted), start, end)


@pytest.mark.parametrize("rest", [0.0, 300.0])
def test_a_long_rest_is_not_the_unloaded_reading(rest):
    """Each foot is up for half a second, three times: little of five minutes."""
    step = 0.01
    time = step * (np.arange(round((rest + 20) / step)) + 0.5)
    force, steps = np.full((len(time), 4), 100.0), []
    for k in range(12):
        start, lifted = rest + 1 + 1.5 * k, k % 4
        up = (time >= start) & (time < start + 0.5)
        force[up] = 400 / 3
        force[up, lifted] = 0.0
        steps.append(on_three(LEG_NAMES[lifted], start + 0.05, start + 0.45))
    none = np.zeros((len(time), 3))
    track = Track(time, step, np.zeros((len(time), 12)), none, none, None, 0.0, 0.0)
    loads = FootLoads.by_sensors(track, FootLoads("foot forces", time, force), steps)
    assert not any(loads.contradicts(one) for one in steps)


def test_a_step_is_cut_to_when_its_foot_is_up():
    step, up, down = on_three("FR", 0.0, 0.49), [1.3, 0.1, 1.3, 1.3], [1.0, 1.0, 1.0, 1.0]
    cut = loads(*[up] * 5, *[down] * 5, *[up] * 30, *[down] * 10).cut(step, 0.25)
    assert (cut.lifted, cut.start, cut.end) == ("FR", pytest.approx(0.1), pytest.approx(0.39))
    assert loads(*[up] * 20, *[down] * 30).cut(step, 0.25) is None


def test_a_crawl_is_written_and_read():
    trial = CrawlTrial(steps=(on_three("FL", 1.0, 1.4), on_three("RR", 2.6, 3.0)), found_at=1.0)
    assert read_trial(trial.to_data()) == trial
    assert trial.duration == 2.0
    assert trial.steps[0].standing == ("FR", "RL", "RR")
    with pytest.raises(RecordingError, match="are not two or three legs"):
        read_trial({**trial.to_data(), "steps": [{"standing": ["FL", "FR", "tail"], "start": 0, "end": 1}]})
