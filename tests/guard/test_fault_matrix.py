"""Faults at every phase of a guarded calibration: each ends in the error that names it, or does no harm, or is named beside
the result; and always with the robot put down and a recording that can be read."""

import re
import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from faults import Fault, Faulty, grease
from guarded import SLOW, hold, simulated

from equipoise import Precise, RunFolder, calibrate, load_robot, nominal_stance, simulate
from equipoise.clearance.clearance import contact_in
from equipoise.errors import (
    CommunicationError,
    EquipoiseError,
    FallError,
    LimitError,
    MissingDependencyError,
    MotionError,
    SensorError,
    TrackingError,
)
from equipoise.guard import footing
from equipoise.guard.guard import Guard
from equipoise.motors.method import Motors
from equipoise.platform.platform import Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.precise.lift_design import LiftDesign
from equipoise.precise.safe_lift import found_doubt
from equipoise.precise.trials import PreciseTrials
from equipoise.recording.run_log_reader import read_log
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import lies

SETTINGS = Precise(budget=32, sway=False)
CALF, THIGH = 2, 1  # of the front left leg
SIZES = {"delay": 0.3, "spike": 0.3, "overheat": 90.0}
FALLS = (FallError, TrackingError, LimitError)


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


# What is wrong decides how it ends, and the phase where the feet are then: each ending is tried in every phase with one fault.
PHASES = ("stand", "move", "rest", "unload", "lift", "watch", "lower")
CASES = [
    *(Case("nan", phase, SensorError, "encoder of joint 'FL_calf_joint' says what is no number") for phase in PHASES),
    *(Case("spike", phase, SensorError, "encoder of joint 'FL_calf_joint' jumped") for phase in ("stand", "watch")),
    *(Case("kill link", phase, CommunicationError, "the link is gone") for phase in ("stand", "move", "watch")),
    *(
        Case("drop", phase, (CommunicationError, TrackingError), "no sample has arrived for 1|is it on")
        for phase in PHASES
    ),
    *(Case("repeat", phase, SensorError, "samples repeat themselves") for phase in ("stand", "watch")),
    *(Case("delay", phase, SensorError, "out of order|repeat themselves") for phase in ("move", "watch")),
    *(Case("overheat", phase, LimitError, "motor of joint 'FL_calf_joint' has 90 deg C") for phase in PHASES),
    *(Case("lose torque", phase, FALLS, "FL_calf_joint|falling") for phase in ("stand", "move", "watch")),
    *(
        Case("freeze encoder", phase, SensorError, "encoder of joint 'FL_calf_joint' is frozen")
        for phase in ("move", "lift")
    ),
    *(
        Case("freeze imu", phase, (SensorError, FallError), "IMU is frozen|falling")
        for phase in ("stand", "move", "lower")
    ),
    *(
        Case("stick joint", phase, TrackingError, "joint 'FL_calf_joint' was sent through")
        for phase in ("move", "lift")
    ),
    *(
        Case("outside", phase, FALLS, "falling|FL|FR|RL|RR", push=400.0)
        for phase in ("stand", "move", "watch", "lower")
    ),
]


class Seen(PlatformWrapper):
    """The robot's own side: what reached it."""

    def __init__(self, inner):
        super().__init__(inner)
        self.commands, self.states, self.closed = [], [], False

    def step(self, command):
        state = super().step(command)
        self.commands.append(command)
        self.states.append(state)
        return state

    def close(self):
        self.closed = True
        super().close()


def act_of(case, disturbance):
    """What happens to the robot from outside, if anything."""
    if case.kind != "outside":
        return None
    if case.push:
        return lambda begins: disturbance.push(np.array([0.0, case.push, 0.0]) * begins)
    return lambda begins: grease(disturbance, "FL", 0.05 if begins else 0.8)


class OneSwing(Precise):
    """A lift in which the two lifted feet swing, and nothing else."""

    def run(self, planted, stance, recordings, report=None):
        trials = PreciseTrials(planted, stance, composite_parameters(planted.robot, stance.joint_position).com)
        trials.doubt = found_doubt(stance)
        trials.lift(LiftDesign(BodyPosture(), "FR_RL", 1, swing="ahead"))


def run(robot, cases, folder, duration=None, settings=SETTINGS):
    """A guarded calibration with faults: its result or error, the truth, what the robot saw, and the guard's report."""
    platform, disturbance, truth = simulated(robot, payload="1,0.05,0.02,0.08")
    gains, guard = robot.gains(nominal_stance(robot).hip_height), None
    with platform:
        faulty = peer = Seen(platform)
        faults = []
        for case in cases:
            lasts, size = 0.3 if case.push else duration, SIZES.get(case.kind, 0.0)
            fault = Fault(case.kind, case.phase, case.after, lasts, case.joint, size, act_of(case, disturbance))
            faulty = Faulty(faulty, fault, lambda: guard.phase if guard else "", gains)
            faults.append(faulty)
        with RunFolder.create(folder, robot, settings, {}) as kept:
            guard = Guard(faulty, robot, log=kept.log)
            try:
                with guard:
                    outcome = calibrate(guard, robot, settings, kept.keep)
            except EquipoiseError as error:
                outcome = error
        assert all(fault.begun for fault in faults)
        return outcome, truth.composite, peer, guard.report()


def assert_put_down(robot, case, peer, report):
    """The robot was released, and before that, if it could still be reached, damped with its feet down."""
    assert peer.closed
    assert report.ending[-1] == "released"
    last = peer.commands[-1]
    if case.kind == "kill link":  # nothing reaches it: its motor boards' own watchdog must do the rest
        assert all(np.array_equal(c.position, c.position) for c in peer.commands)
        return
    sound = np.arange(len(robot.joint_names)) != (case.joint if case.kind in ("lose torque", "stick joint") else -1)
    assert last.kp is not None
    assert not last.kp[sound].any()
    assert last.kd[sound].all()
    targets = np.array([command.position[sound] for command in peer.commands])
    assert np.isfinite(targets).all()
    assert (np.abs(np.diff(targets, axis=0)) <= 1.01 * robot.velocity_limit[sound] * SLOW).all()


@pytest.fixture(autouse=True)
def _briefly_damped(monkeypatch):
    """A robot that nobody can see is damped for seconds, which test_guard.py counts."""
    monkeypatch.setattr(footing, "_SUNK", 0.3)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_fault_ends_in_its_error_with_the_robot_put_down(a1, case, tmp_path):
    outcome, _, peer, report = run(a1, [case], tmp_path / "run")
    assert isinstance(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, peer, report)
    content = read_log(tmp_path / "run" / "recording.mcap")
    recorded = sum(len(play.recording.joints.time) for play in content.plays)
    assert recorded > 10 or case.phase == "stand"


SWINGING = [
    Case("nan", "watch", SensorError, "encoder of joint 'FL_calf_joint' says what is no number"),
    Case("drop", "watch", (CommunicationError, TrackingError), "no sample has arrived for 1|is it on"),
    Case("lose torque", "watch", FALLS, "FL_|falling"),
    Case("stick joint", "watch", TrackingError, "joint 'FL_thigh_joint' was sent through", joint=THIGH),
    Case("outside", "watch", FALLS, "falling|FL|FR|RL|RR", push=250.0),
]


@pytest.mark.parametrize("case", SWINGING, ids=str)
def test_a_fault_while_lifted_feet_swing_ends_as_any_other(a1, case, tmp_path):
    """The front left leg is in the air."""
    outcome, _, peer, report = run(a1, [case], tmp_path / "run", settings=OneSwing())
    assert isinstance(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, peer, report)


# The robot lies on its belly and turns its legs up: nothing is left to be put down, and all joints are damped.
LEGS_UP = Motors(motor_time=3.0)
_NO_POWER = "FL_calf_joint.*is it on"
_STUCK = "joint 'FL_calf_joint' was sent through"
LYING = [
    Case("drop", "lie", CommunicationError, "no sample has arrived for 1"),
    Case("lose torque", "lie", TrackingError, _NO_POWER),
    Case("stick joint", "lie", TrackingError, _STUCK),
    Case("spike", "raise", SensorError, "encoder of joint 'FL_calf_joint' jumped"),
    Case("kill link", "raise", CommunicationError, "the link is gone"),
    Case("freeze imu", "raise", SensorError, "IMU is frozen"),
    Case("stick joint", "raise", TrackingError, _STUCK),
    Case("nan", "swing", SensorError, "encoder of joint 'FL_calf_joint' says what is no number"),
    Case("repeat", "swing", SensorError, "samples repeat themselves"),
    Case("overheat", "swing", LimitError, "motor of joint 'FL_calf_joint' has 90 deg C"),
    # Limp and upright, the thigh hangs in its friction.
    Case("lose torque", "swing", TrackingError, "joint 'FL_thigh_joint' .* has its motor lost power", joint=THIGH),
    Case("freeze encoder", "swing", SensorError, "encoder of joint 'FL_calf_joint' is frozen"),
    Case("stick joint", "swing", TrackingError, _STUCK),
    Case("outside", "swing", FallError, "falling", push=250.0),
    Case("lose torque", "fold", TrackingError, _NO_POWER),
    Case("stick joint", "fold", TrackingError, _STUCK),
    Case("nan", "fold", SensorError, "encoder of joint 'FL_calf_joint' says what is no number", after=4.3),  # it rises
]


@pytest.mark.parametrize("case", LYING, ids=str)
def test_a_fault_of_a_robot_with_its_legs_up_ends_as_any_other(a1, case, tmp_path):
    outcome, _, peer, report = run(a1, [case], tmp_path / "run", settings=LEGS_UP)
    assert isinstance(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, peer, report)
    if case.kind != "kill link":
        assert report.ending == ("damped", "released")
    plays = read_log(tmp_path / "run" / "recording.mcap").plays
    assert sum(len(play.recording.joints.time) for play in plays) > 200
    phases = [event.data["name"] for play in plays for event in play.recording.events if event.name == "phase"]
    assert case.phase in phases


@pytest.mark.parametrize(
    "case", [case for case in LYING if case.phase == "swing" and case.kind in ("nan", "overheat")], ids=str
)
def test_legs_that_are_up_come_down_before_they_are_let_go(a1, case, tmp_path, monkeypatch):
    """Blindly for as long as it takes; and until nothing moves, where that is seen."""
    monkeypatch.setattr(footing, "_SUNK", 4.0)
    _, _, peer, _ = run(a1, [case], tmp_path / "run", settings=LEGS_UP)
    limp = np.array([command.limp for command in peer.commands])
    speed = np.abs([state.joint_velocity for state in peer.states])[limp].max(axis=1)
    assert speed.max() < 1.0
    assert speed[-20:].max() < 0.15  # a third of it noise
    end = peer.states[-1]
    assert lies(a1, nominal_stance(a1), end.joint_position)
    assert end.acceleration_in_imu[2] > 0.98 * np.linalg.norm(end.acceleration_in_imu)  # level, on its belly


# The robot stands on three feet, its front left leg in the air: that foot is put down, and all joints are damped.
THREE_FEET = Motors(motor_time=6.0, motor_stance="three-feet")
_OTHER_CALF = 5  # of a leg that stands
STANDING = [
    Case("drop", "move", CommunicationError, "no sample has arrived for 1"),
    Case("stick joint", "move", TrackingError, "joint 'FR_calf_joint' was sent through", joint=_OTHER_CALF),
    Case("nan", "unload", SensorError, "encoder of joint 'FL_calf_joint' says what is no number"),
    Case("lose torque", "lift", FALLS, "FL_calf_joint|falling"),
    Case("outside", "lift", FALLS, "falling|FL|FR|RL|RR", push=250.0),
    Case("nan", "swing", SensorError, "encoder of joint 'FL_calf_joint' says what is no number"),
    Case("overheat", "swing", LimitError, "motor of joint 'FL_calf_joint' has 90 deg C"),
    Case("kill link", "swing", CommunicationError, "the link is gone"),
    Case("lose torque", "swing", TrackingError, "FL_calf_joint.*lost power|FL_calf_joint.*is it on"),
    Case("lose torque", "swing", FALLS, "FR_calf_joint|falling", joint=_OTHER_CALF),
    Case("stick joint", "swing", TrackingError, _STUCK),
    Case("outside", "swing", FALLS, "falling|FL|FR|RL|RR", push=250.0),
    Case("drop", "lower", CommunicationError, "no sample has arrived for 1"),
    Case("lose torque", "lower", FALLS, "FL_|falling"),
]


@pytest.mark.parametrize("case", STANDING, ids=str)
def test_a_fault_of_a_robot_on_three_feet_ends_as_any_other(a1, case, tmp_path):
    outcome, _, peer, report = run(a1, [case], tmp_path / "run", settings=THREE_FEET)
    assert isinstance(outcome, case.error), outcome
    assert re.search(case.words, str(outcome)), outcome
    assert_put_down(a1, case, peer, report)
    if case.phase in ("lift", "swing") and case.kind != "kill link":  # elsewhere the foot is down, or nobody is heard
        assert report.ending[0] == "feet down"
    if case.kind in ("nan", "overheat"):  # its legs do as they are told
        assert report.ending[-3:] == ("centred", "damped", "released")
    plays = read_log(tmp_path / "run" / "recording.mcap").plays
    assert sum(len(play.recording.joints.time) for play in plays) > 200


def test_a_robot_over_three_feet_is_damped_where_its_legs_carry_alike(tmp_path, monkeypatch):
    """Damped where it was, HyQ rolled over: the leg that carried most sank first."""
    monkeypatch.setattr(footing, "_SUNK", 4.0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            hyq = load_robot("hyq")
    except MissingDependencyError as error:
        pytest.skip(str(error))
    case = Case("overheat", "settle", LimitError, "has 90 deg C", after=0.1)
    outcome, _, peer, report = run(hyq, [case], tmp_path / "run", settings=Motors(motor_time=8.0))
    assert isinstance(outcome, case.error), outcome
    assert_put_down(hyq, case, peer, report)
    up = np.array([state.acceleration_in_imu / np.linalg.norm(state.acceleration_in_imu) for state in peer.states])
    assert np.mean(up[-50:], axis=0) @ np.mean(up[:50], axis=0) > np.cos(0.1)
    assert report.largest_tilt < 0.35


HARMLESS = [
    Case("reorder", "watch", MotionError, ""),
    Case("outside", "rest", MotionError, "", push=12.0),
]


def test_faults_that_do_no_harm_leave_the_result_right(a1, tmp_path):
    outcome, truth, peer, report = run(a1, HARMLESS, tmp_path / "run", duration=0.3)
    assert not isinstance(outcome, EquipoiseError), outcome
    com = outcome.composite.com_in_base
    assert (np.abs(com.values - truth.com) < 5 * com.deviations).all()
    assert_put_down(a1, HARMLESS[0], peer, report)


def test_what_does_no_harm_to_a_swing_leaves_its_result_right(a1, tmp_path):
    harmless = [Case("reorder", "swing", MotionError, ""), Case("freeze encoder", "swing", MotionError, "", after=1.0)]
    outcome, _, peer, report = run(a1, harmless, tmp_path / "run", duration=0.1, settings=LEGS_UP)
    assert not isinstance(outcome, EquipoiseError), outcome
    with simulate(a1, payload="1,0.05,0.02,0.08", seed=3, timestep=SLOW / 4) as same:
        found = outcome.with_truth_of_parts(same.truth_of_parts).motors
    missed = [one.missed for motor in found.values() for one in motor.quantities.values()]
    assert np.mean(missed) < 0.15
    assert not any(one.missed for one in found["FL_calf_joint"].quantities.values())
    assert_put_down(a1, harmless[0], peer, report)


def test_a_foot_without_hold_is_named_beside_the_result(a1, tmp_path):
    slips = Case("outside", "move", MotionError, "")
    outcome, _, peer, report = run(a1, [slips], tmp_path / "run")
    if isinstance(outcome, EquipoiseError):
        assert isinstance(outcome, FALLS)
    else:
        assert any("slip" in warning for warning in outcome.warnings)
    assert_put_down(a1, slips, peer, report)


def crossing(robot, start, control_period):
    """A motion from (nj,) joint positions in which the front feet meet within a second."""
    crossed = np.array(start)
    crossed[[robot.joint_names.index(f"{leg}_hip_joint") for leg in ("FL", "FR")]] += [-0.45, 0.45]
    share = np.linspace(0, 1, round(1.0 / control_period))[:, None]
    return Trajectory(start + share * (crossed - start))


@pytest.mark.parametrize("how", ["play", "step"])
def test_self_collision_is_refused_before_links_touch(a1, how):
    """A program whose plan nobody checked: of a motion nothing is sent, of steps those that are clear."""
    platform, _, _ = simulated(a1, noise="ideal")
    peer = Seen(platform)
    with Guard(peer, a1) as guard:
        hold(guard, peer, 0.1)
        sent = peer.commands[-1].position
        way = crossing(a1, sent, guard.control_period)
        with pytest.raises(
            LimitError, match=r"^link 'FL_foot' would come within \d\.\d mm of link 'FR_foot': it was not "
        ):
            guard.play(way) if how == "play" else play_by_stepping(guard, way)
        ended = guard.report().ending
    assert ended[0].startswith("lying down")  # legs that are crossed may be in its way
    assert ended[1:] == ("damped", "released")
    moved = [command.position for command in peer.commands if (command.position[0] < sent[0] - 1e-3)]
    assert bool(moved) == (how == "step")
    contacts = [contact_in(a1, command.position) for command in peer.commands[::5]]
    assert all(contact is None or contact.distance > 0 for contact in contacts)


def test_there_are_forty_cases_and_more():
    assert len(CASES) + len(HARMLESS) + 1 >= 40
