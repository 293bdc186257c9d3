"""Faults at every phase of a guarded calibration: each ends in the error that names it, or does no harm, or is reported with
the result; and always with the robot put down and a recording that can be read."""

import re
import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from faults import Fault, Faulty, grease, push
from guarded import SLOW, hold, simulated

from equipoise import BayesianMethod, RunFolder, calibrate, load_robot, nominal_stance, simulate
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.safe_lift import search_covariance
from equipoise.bayesian.trials import BayesianTrials
from equipoise.clearance.clearance import contact_in
from equipoise.errors import (
    CommunicationError,
    EquipoiseError,
    FallError,
    MissingDependencyError,
    MotionError,
    StoppedError,
)
from equipoise.guard import footing
from equipoise.guard.endings import DAMPED_TIME, NOT_CONFIRMED
from equipoise.guard.guard import Guard
from equipoise.guard.limits import Limits
from equipoise.motors.method import Motors
from equipoise.platform.logged_platform import Logged
from equipoise.platform.platform import Trajectory
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.run_log_reader import read_log
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_jacobians
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import lies
from equipoise.simulation.mujoco import MujocoPlatform

SETTINGS = BayesianMethod(duration=24, excitation=False)
CALF, THIGH = 2, 1  # of the front left leg
SIZES = {"delay": 0.3, "spike": 0.3, "overheat": 90.0, "empty battery": 0.08}
FALLS = (FallError, MotionError)


@dataclass(frozen=True)
class Case:
    """A fault, when it begins, and how the run must end: an error and words of its message."""

    kind: str
    phase: str
    error: type | tuple
    words: str
    joint: int = CALF
    push: float = 0.0
    after: float = 0.02

    def __str__(self):
        late = f" after {self.after:g} s" if self.after > 0.1 else ""
        return f"{self.kind}{f' {self.push:g} N' if self.push else ''} in {self.phase}{late}"


# What is wrong decides how it ends, and the phase where the feet are then: damping and lowering are tried in every phase with
# one fault, and any other fault in the phases in which it is detected differently.
PHASES = ("stand", "move", "rest", "unload", "lift", "watch", "lower")
CASES = [
    *(Case("nan", phase, MotionError, "encoder reading of joint 'FL_calf_joint' is not finite") for phase in PHASES),
    *(Case("spike", phase, MotionError, "encoder of joint 'FL_calf_joint' jumped") for phase in ("stand", "watch")),
    *(Case("kill link", phase, CommunicationError, "the link is gone") for phase in ("stand", "move", "watch")),
    *(
        Case("drop", phase, (CommunicationError, MotionError), "no sample has arrived for 1|is the motor on")
        for phase in ("stand", "move", "lift", "lower")
    ),
    Case("repeat", "watch", MotionError, "samples are repeated"),
    *(Case("delay", phase, MotionError, "out of order|are repeated") for phase in ("move", "watch")),
    *(Case("overheat", phase, StoppedError, "motor of joint 'FL_calf_joint' is at 90 deg C") for phase in PHASES),
    Case("empty battery", "move", StoppedError, "battery charge is 8%"),
    Case("remote damp", "watch", StoppedError, "asked to damp the robot"),
    Case("remote lie down", "watch", StoppedError, "asked to lower the robot"),
    *(Case("lose torque", phase, FALLS, "FL_calf_joint|falling") for phase in ("stand", "move", "watch")),
    *(
        Case("freeze encoder", phase, MotionError, "encoder of joint 'FL_calf_joint' is frozen")
        for phase in ("move", "lift")
    ),
    *(
        Case("freeze imu", phase, (MotionError, FallError), "IMU is frozen|falling")
        for phase in ("stand", "move", "lower")
    ),
    *(Case("stick joint", phase, MotionError, "joint 'FL_calf_joint' moved by") for phase in ("move", "lift")),
    *(
        Case("outside", phase, FALLS, "falling|FL|FR|RL|RR", push=400.0)
        for phase in ("stand", "move", "watch", "lower")
    ),
]


class Seen(PlatformWrapper):
    """Commands that reached the robot. `asked` is the guard's side of the fault: its commands and samples."""

    def __init__(self, inner):
        super().__init__(inner)
        self.commands, self.states, self.closed, self.asked = [], [], False, None

    def step(self, command):
        self.commands.append(command)
        self.states.append(super().step(command))
        return self.states[-1]

    def close(self):
        self.closed = True
        super().close()


def act_of(case, platform):
    """The disturbance of the robot, if any."""
    if case.kind != "outside":
        return None
    if case.push:
        return lambda begins: push(platform, np.array([0.0, case.push, 0.0]) * begins)
    return lambda begins: grease(platform, "FL", 0.05 if begins else 0.8)


class OneSwing(BayesianMethod):
    """A lift in which the two lifted feet swing, and nothing else."""

    def run(self, standing, stance, recordings, report=None):
        trials = BayesianTrials(standing, stance, composite_parameters(standing.robot, stance.joint_position).com)
        trials.com_covariance = search_covariance(stance)
        trials.lift(LiftDesign(BodyPosture(), "FR_RL", 1, swing="ahead"))


def run(robot, cases, folder, duration=None, settings=SETTINGS):
    """A guarded calibration with faults: its result or error, the truth, what the robot saw, and the guard's report."""
    platform, truth = simulated(robot, payload="1,0.05,0.02,0.08")
    gains, guard = robot.gains(nominal_stance(robot).hip_height), None
    with platform:
        faulty = recorder = Seen(platform)
        faults = []
        for case in cases:
            lasts, size = 0.3 if case.push else duration, SIZES.get(case.kind, 0.0)
            fault = Fault(case.kind, case.phase, case.after, lasts, case.joint, size, act_of(case, platform))
            faulty = Faulty(faulty, fault, lambda: guard.phase if guard else "", gains)
            faults.append(faulty)
        with RunFolder.create(folder, robot, settings, {}) as kept:
            recorder.asked = Seen(faulty)
            guard = Guard(recorder.asked, robot)
            try:
                with guard:
                    outcome = calibrate(Logged(guard, kept.log), robot, settings, kept.keep)
            except EquipoiseError as error:
                outcome = error
        assert all(fault.begun for fault in faults)
        return outcome, truth.composite, recorder, guard.report()


def assert_put_down(robot, case, outcome, recorder, report):
    """A sound robot was lowered, and one that is not was damped at once; then it was released."""
    assert recorder.closed
    assert report.ending[-1] == "released"
    sent = recorder.asked.commands
    began = next(index for index, command in enumerate(sent) if command.limp)
    assert all(command.limp for command in sent[began:])
    assert (len(sent) - began) * SLOW >= DAMPED_TIME
    sound = isinstance(outcome, StoppedError) and case.kind != "remote damp"
    if isinstance(outcome, StoppedError):
        assert outcome.exit_code == (13 if case.kind.startswith("remote") else 12)
    *before, damped, _ = report.ending
    assert all(step in ("feet down", "lowered") for step in before)
    if not sound:
        assert not before
    elif not lies(robot, nominal_stance(robot), sent[began].position):
        assert before[-1:] == ["lowered"]
    confirmed = damped == "damped"
    assert confirmed or damped == f"damping commands were sent; {NOT_CONFIRMED}"
    if case.kind in ("kill link", "drop", "repeat"):
        assert not confirmed
    targets = np.array([command.position for command in sent])
    assert np.isfinite(targets).all()
    unbounded = np.abs(np.diff(targets, axis=0)) <= 1.01 * robot.velocity_limit * SLOW
    assert unbounded.all() or case.kind in ("stick joint", "lose torque", "spike", "freeze encoder", "outside", "delay")


def assert_calm_or_put_down(robot, case, outcome, recorder, report):
    """The same; a run without an error ends by lowering the robot, if it does not lie."""
    if isinstance(outcome, EquipoiseError):
        assert_put_down(robot, case, outcome, recorder, report)
    else:
        assert report.ending == ("lowered", "damped", "released")
        assert recorder.closed


@pytest.fixture(autouse=True)
def _briefly_damped(monkeypatch):
    """A robot without samples is damped for seconds, which test_guard.py counts."""
    monkeypatch.setattr(footing, "_SUNK", 0.3)


def is_of(outcome, errors):
    """Return whether an outcome is one of these errors; MotionError excludes its subclasses."""
    return any(
        type(outcome) is MotionError if error is MotionError else isinstance(outcome, error)
        for error in (errors if isinstance(errors, tuple) else (errors,))
    )


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_fault_ends_in_its_error_with_the_robot_put_down(a1, case, tmp_path):
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run")
    assert is_of(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, outcome, recorder, report)
    content = read_log(tmp_path / "run")
    recorded = sum(len(play.recording.joints.time) for play in content.plays)
    assert recorded > 10 or case.phase == "stand"


SWINGING = [
    Case("nan", "watch", MotionError, "encoder reading of joint 'FL_calf_joint' is not finite"),
    Case("drop", "watch", (CommunicationError, MotionError), "no sample has arrived for 1|is the motor on"),
    Case("lose torque", "watch", FALLS, "FL_|falling"),
    Case("stick joint", "watch", MotionError, "joint 'FL_thigh_joint' moved by", joint=THIGH),
    Case("outside", "watch", FALLS, "falling|FL|FR|RL|RR", push=250.0),
]


@pytest.mark.parametrize("case", SWINGING, ids=str)
def test_a_fault_while_lifted_feet_swing_ends_as_any_other(a1, case, tmp_path):
    """The front left leg is in the air."""
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run", settings=OneSwing())
    assert is_of(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, outcome, recorder, report)


# The robot lies on its belly and turns its legs up: nothing is left to be put down, and all joints are damped.
LEGS_UP = Motors(motor_time=3.0)
_NO_POWER = "FL_calf_joint.*is the motor on"
_STUCK = "joint 'FL_calf_joint' moved by"
LYING = [
    Case("drop", "lie", CommunicationError, "no sample has arrived for 1"),
    Case("stick joint", "lie", MotionError, _STUCK),
    Case("spike", "raise", MotionError, "encoder of joint 'FL_calf_joint' jumped"),
    Case("kill link", "raise", CommunicationError, "the link is gone"),
    Case("freeze imu", "raise", MotionError, "IMU is frozen"),
    Case("nan", "swing", MotionError, "encoder reading of joint 'FL_calf_joint' is not finite"),
    Case("repeat", "swing", MotionError, "samples are repeated"),
    Case("overheat", "swing", StoppedError, "motor of joint 'FL_calf_joint' is at 90 deg C"),
    # Limp and upright, the thigh hangs in its friction.
    Case("lose torque", "swing", MotionError, "FL_thigh_joint.* (is the motor on|lost power)", joint=THIGH),
    Case("freeze encoder", "swing", MotionError, "encoder of joint 'FL_calf_joint' is frozen"),
    Case("stick joint", "swing", MotionError, _STUCK),
    Case("outside", "swing", FallError, "falling", push=250.0),
    Case("lose torque", "fold", MotionError, _NO_POWER),
    Case("nan", "fold", MotionError, "encoder reading of joint 'FL_calf_joint' is not finite", after=4.3),  # it rises
]


@pytest.mark.parametrize("case", LYING, ids=str)
def test_a_fault_of_a_robot_with_its_legs_up_ends_as_any_other(a1, case, tmp_path):
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run", settings=LEGS_UP)
    assert is_of(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, outcome, recorder, report)
    assert len(report.ending) == 2  # nothing is to be put down
    plays = read_log(tmp_path / "run").plays
    assert sum(len(play.recording.joints.time) for play in plays) > 200
    phases = [event.data["name"] for play in plays for event in play.recording.events if event.name == "phase"]
    assert case.phase in phases


@pytest.mark.parametrize(
    "case", [case for case in LYING if case.phase == "swing" and case.kind in ("nan", "overheat")], ids=str
)
def test_legs_that_are_up_come_down_before_they_are_let_go(a1, case, tmp_path, monkeypatch):
    """Blindly for as long as it takes; and until nothing moves, where that is seen."""
    monkeypatch.setattr(footing, "_SUNK", 4.0)
    _, _, recorder, _ = run(a1, [case], tmp_path / "run", settings=LEGS_UP)
    limp = np.array([command.limp for command in recorder.commands])
    speed = np.abs([state.joint_velocity for state in recorder.states])[limp].max(axis=1)
    assert speed[round(0.1 / SLOW) :].max() < 1.0  # after what the swing began with
    assert speed[-20:].max() < 0.15  # a third of it noise
    end = recorder.states[-1]
    assert lies(a1, nominal_stance(a1), end.joint_position)
    assert end.acceleration_in_imu[2] > 0.98 * np.linalg.norm(end.acceleration_in_imu)  # level, on its belly


# The robot stands on three feet, its front left leg in the air.
THREE_FEET = Motors(motor_time=6.0, motor_stance="three-feet")
_OTHER_CALF = 5  # of a leg that stands
STANDING = [
    Case("drop", "move", CommunicationError, "no sample has arrived for 1"),
    Case("stick joint", "move", MotionError, "joint 'FR_calf_joint' moved by", joint=_OTHER_CALF),
    Case("nan", "unload", MotionError, "encoder reading of joint 'FL_calf_joint' is not finite"),
    Case("lose torque", "lift", FALLS, "FL_calf_joint|falling"),
    Case("outside", "lift", FALLS, "falling|FL|FR|RL|RR", push=250.0),
    Case("nan", "swing", MotionError, "encoder reading of joint 'FL_calf_joint' is not finite"),
    Case("overheat", "swing", StoppedError, "motor of joint 'FL_calf_joint' is at 90 deg C"),
    Case("kill link", "swing", CommunicationError, "the link is gone"),
    Case("lose torque", "swing", MotionError, "FL_calf_joint.*lost power|FL_calf_joint.*is the motor on"),
    Case("lose torque", "swing", FALLS, "FR_calf_joint|falling", joint=_OTHER_CALF),
    Case("stick joint", "swing", MotionError, _STUCK),
    Case("outside", "swing", FALLS, "falling|FL|FR|RL|RR", push=250.0),
    Case("drop", "lower", CommunicationError, "no sample has arrived for 1"),
    Case("lose torque", "lower", FALLS, "FL_|falling"),
]


@pytest.mark.parametrize("case", STANDING, ids=str)
def test_a_fault_of_a_robot_on_three_feet_ends_as_any_other(a1, case, tmp_path):
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run", settings=THREE_FEET)
    assert is_of(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, outcome, recorder, report)
    if case.kind == "overheat":
        assert report.ending == ("feet down", "lowered", "damped", "released")
    plays = read_log(tmp_path / "run").plays
    assert sum(len(play.recording.joints.time) for play in plays) > 200


def test_a_hot_robot_over_three_feet_is_lowered_level(tmp_path, monkeypatch):
    """Damped where it was, HyQ rolls over: the leg that carries most sinks first."""
    monkeypatch.setattr(footing, "_SUNK", 4.0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            hyq = load_robot("hyq")
    except MissingDependencyError as error:
        pytest.skip(str(error))
    case = Case("overheat", "settle", StoppedError, "is at 90 deg C", after=0.1)
    outcome, _, recorder, report = run(hyq, [case], tmp_path / "run", settings=Motors(motor_time=8.0))
    assert is_of(outcome, case.error), outcome
    assert_put_down(hyq, case, outcome, recorder, report)
    up = np.array([state.acceleration_in_imu / np.linalg.norm(state.acceleration_in_imu) for state in recorder.states])
    assert np.mean(up[-50:], axis=0) @ np.mean(up[:50], axis=0) > np.cos(0.1)
    assert report.largest_tilt < 0.35


@pytest.mark.parametrize(("phase", "joint"), [("lift", CALF), ("watch", THIGH)])
def test_a_blocked_joint_presses_with_a_bounded_force(a1, phase, joint, tmp_path):
    """By 30 % of its motor's torque or 60 N at the foot beyond what the motion needs, on its way to the error."""
    case = Case("stick joint", phase, MotionError, "joint 'FL_(calf|thigh)_joint'", joint=joint)
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run", settings=OneSwing())
    assert is_of(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, outcome, recorder, report)
    kp, _ = a1.gains(nominal_stance(a1).hip_height)
    lever = np.linalg.norm(foot_jacobians(a1, nominal_stance(a1).joint_position), axis=1).ravel()
    excess = np.array([
        (kp if command.kp is None else command.kp) * np.abs(command.position - state.joint_position)
        for state, command in pairwise_of(recorder.asked) if not command.limp
    ])  # fmt: skip
    most = np.minimum(0.3 * a1.effort_limit, 60.0 * lever)
    assert (excess <= most + 1e-6).all()
    assert excess[:, joint].max() == pytest.approx(most[joint])


def pairwise_of(seen):
    """Each command with the state that was known before it."""
    return zip(seen.states[:-1], seen.commands[1:], strict=True)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_pushed_over_in_a_lift_is_damped_within_a_tenth_of_a_second(a1, side, tmp_path, monkeypatch):
    """By 100 N for 0.3 s; from when it leans as far as it may in a lift."""
    leans = []

    def step(self, command, inner=MujocoPlatform.step):
        state = inner(self, command)
        _, x, y, _ = self._data.qpos[3:7]
        leans.append(2 * np.arcsin(np.hypot(x, y)))
        return state

    monkeypatch.setattr(MujocoPlatform, "step", step)
    case = Case("outside", "watch", FallError, "falling", push=side * 100.0)
    outcome, _, recorder, report = run(a1, [case], tmp_path / "run")
    assert is_of(outcome, case.error), outcome
    assert_put_down(a1, case, outcome, recorder, report)
    passed = next(index for index, lean in enumerate(leans) if lean > Limits().lean_in_lift)
    damped = next(index for index, command in enumerate(recorder.commands) if command.limp)
    assert abs(damped - passed) * SLOW < 0.1


HARMLESS = [
    Case("reorder", "watch", MotionError, ""),
    Case("outside", "rest", MotionError, "", push=12.0),
]


def test_faults_that_do_no_harm_leave_the_result_right(a1, tmp_path):
    outcome, truth, recorder, report = run(a1, HARMLESS, tmp_path / "run", duration=0.3)
    assert not isinstance(outcome, EquipoiseError), outcome
    com = outcome.composite.com_in_base
    assert (np.abs(com.values - truth.com) < 5 * com.stds).all()
    assert_calm_or_put_down(a1, HARMLESS[0], outcome, recorder, report)


def test_what_does_no_harm_to_a_swing_leaves_its_result_right(a1, tmp_path):
    harmless = [Case("reorder", "swing", MotionError, ""), Case("freeze encoder", "swing", MotionError, "", after=1.0)]
    outcome, _, recorder, report = run(a1, harmless, tmp_path / "run", duration=0.1, settings=LEGS_UP)
    assert not isinstance(outcome, EquipoiseError), outcome
    with simulate(a1, payload="1,0.05,0.02,0.08", seed=3, timestep=SLOW / 4) as same:
        found = outcome.with_truth_of_parts(same.truth_of_parts).motors
    missed = [one.missed for motor in found.values() for one in motor.quantities.values()]
    assert np.mean(missed) < 0.15
    assert not any(one.missed for one in found["FL_calf_joint"].quantities.values())
    assert_calm_or_put_down(a1, harmless[0], outcome, recorder, report)


def test_a_foot_that_slips_is_reported_with_the_result(a1, tmp_path):
    slips = Case("outside", "move", MotionError, "")
    outcome, _, recorder, report = run(a1, [slips], tmp_path / "run")
    if isinstance(outcome, EquipoiseError):
        assert is_of(outcome, FALLS)
    else:
        assert any("slip" in warning for warning in outcome.warnings)
    assert_calm_or_put_down(a1, slips, outcome, recorder, report)


def crossing(robot, start, control_period):
    """A motion from (nj,) joint positions in which the front feet meet within a second."""
    crossed = np.array(start)
    crossed[[robot.joint_names.index(f"{leg}_hip_joint") for leg in ("FL", "FR")]] += [-0.45, 0.45]
    share = np.linspace(0, 1, round(1.0 / control_period))[:, None]
    return Trajectory(start + share * (crossed - start))


@pytest.mark.parametrize("how", ["play", "step"])
def test_self_collision_is_refused_before_links_touch(a1, how):
    """A program with an unchecked plan: no command of a motion is sent, and only the clear steps."""
    platform, _ = simulated(a1, preset="ideal")
    recorder = Seen(platform)
    with Guard(recorder, a1) as guard:
        hold(guard, recorder, 0.1)
        sent = recorder.commands[-1].position
        way = crossing(a1, sent, guard.control_period)
        with pytest.raises(
            MotionError,
            match=r"^link 'FL_foot' would come within \d\.\d mm of link 'FR_foot': the command was not sent",
        ):
            guard.play(way) if how == "play" else play_by_stepping(guard, way)
        ended = guard.report().ending
    assert ended[0].startswith("lowered")  # legs that are crossed may be in its way
    assert ended[1:] == ("damped", "released")
    moved = [command.position for command in recorder.commands if (command.position[0] < sent[0] - 1e-3)]
    assert bool(moved) == (how == "step")
    contacts = [contact_in(a1, command.position) for command in recorder.commands[::5]]
    assert all(contact is None or contact.distance > 0 for contact in contacts)


def test_there_are_forty_cases_and_more():
    assert len(CASES) + len(HARMLESS) + 1 >= 40
