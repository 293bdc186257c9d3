"""The guard over a simulated robot: after any fault the robot is put down and released."""

import re
from dataclasses import replace

import numpy as np
import pytest
from guarded import Seen, assert_put_down, assert_sane, hold, is_damped, lift, simulated

from equipoise import nominal_stance
from equipoise.errors import (
    CommunicationError,
    FallError,
    MotionError,
    OutputError,
    ReachError,
)
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard import footing
from equipoise.guard.endings import NOT_CONFIRMED
from equipoise.guard.footing import feet_are_lifted
from equipoise.guard.guard import Guard
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand, MotionInterrupted
from equipoise.robot.stance import lies

CALM = ["lowered", "damped", "released"]
UNCONFIRMED = f"damping commands were sent; {NOT_CONFIRMED}"


class TroubleError(Exception):
    """Error of the program, not of the robot."""


@pytest.fixture
def make(a1):
    """Makes a simulated robot that keeps what reaches it."""
    return lambda start="standing", **how: Seen(simulated(a1, start)[0], **how)


@pytest.fixture
def seen(make):
    return make()


def at(count, act):
    """Do something once, before the command of that number."""
    acts = [act]
    return lambda now: acts.pop()() if acts and now == count else None


def raiser(error):
    def act(*_):
        raise error

    return act


def use(seen, robot, work):
    """Do something with a guarded robot; return the steps of the ending, and what was raised."""
    guard = Guard(seen, robot)
    try:
        with guard:
            work(guard)
    except BaseException as error:
        return list(guard.report().ending), error
    return list(guard.report().ending), None


# --- how runs end


ERRORS = [
    None, TroubleError(), KeyboardInterrupt(), SystemExit(3), ReachError("too far"), OutputError("the disk is full"),
    MotionError("it did not come to rest"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("error", "in_air"),
    [*((error, True) for error in ERRORS), (None, False), (ERRORS[1], False)],
    ids=lambda value: type(value).__name__ if not isinstance(value, bool) else "on two feet" if value else "standing",
)
def test_however_a_run_ends_a_robot_that_follows_commands_is_lowered(a1, seen, error, in_air):
    def work(guard):
        lift(guard, a1) if in_air else hold(guard, seen, 0.1)
        if error is not None:
            raise error

    ending, raised = use(seen, a1, work)
    assert raised is error
    assert ending == ["feet down"] * in_air + CALM
    assert_put_down(seen, a1)


def test_a_link_that_is_gone_is_damped_at_once(a1, seen):
    def work(guard):
        lift(guard, a1)
        seen.act = at(len(seen.commands) + 5, raiser(CommunicationError("no sample has arrived")))
        hold(guard, seen, 0.1)

    ending, raised = use(seen, a1, work)
    assert type(raised) is CommunicationError
    assert ending == ["damped", "released"]
    limp = [is_damped(command) for command in seen.commands]
    assert all(limp[limp.index(True) :])
    assert sum(limp) * seen.control_period > 1.45


def test_a_robot_that_was_never_commanded_is_only_let_go_of(a1, seen):
    with Guard(seen, a1) as guard:
        guard.read()
    assert (seen.commands, seen.closed) == ([], 1)
    assert guard.report().ending == ("released",)


def test_it_ends_once(a1, seen):
    guard = Guard(seen, a1)
    with guard:
        hold(guard, seen, 0.02)
        guard.close()
        guard.close()
        sent = len(seen.commands)
        for again in (lambda: guard.step(JointCommand(seen.joints[-1])), lambda: hold(guard, seen, 0.02)):
            with pytest.raises(MotionError, match=r"^the robot was put down and released; start again to move it$"):
                again()
    assert len(seen.commands) == sent
    assert_put_down(seen, a1)


def test_the_robot_is_down_before_the_caller_gets_the_error(a1, seen):
    """Also without `with`."""
    guard = Guard(seen, a1)
    hold(guard, seen, 0.02)
    seen.act = at(len(seen.commands) + 5, raiser(TroubleError()))
    with pytest.raises(TroubleError):
        hold(guard, seen, 0.1)
    assert_put_down(seen, a1)


# --- what fails in the ending itself


@pytest.mark.parametrize("error", [RuntimeError, CommunicationError, KeyboardInterrupt, SystemExit, MemoryError])
def test_the_ending_reaches_its_end_whatever_sending_raises(a1, seen, error, monkeypatch):
    monkeypatch.setattr(footing, "_SUNK", 0.3)

    def work(guard):
        lift(guard, a1)
        seen.act = raiser(error("in the ending"))
        raise TroubleError

    ending, raised = use(seen, a1, work)
    assert type(raised) is TroubleError
    assert seen.closed == 1
    first = "feet down" if error is KeyboardInterrupt else "feet down, stopped: in the ending"
    assert ending == [first, UNCONFIRMED, "released"]


def test_commands_that_get_lost_while_the_robot_is_damped_do_not_end_that(a1, seen):
    def work(guard):
        lift(guard, a1)
        generator = np.random.default_rng(3)
        seen.act = lambda count: generator.random() < 0.3 and raiser(CommunicationError("lost"))()

    ending, raised = use(seen, a1, work)
    assert type(raised) is CommunicationError
    assert ending == ["feet down, stopped: lost", "damped", "released"]
    assert is_damped(seen.commands[-1])
    assert seen.closed == 1


def test_a_robot_that_goes_wrong_while_it_is_lowered_is_damped_and_that_is_an_error(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        sound, began = seen.shown, len(seen.commands)

        def unsound():
            state = sound()
            return state if len(seen.commands) < began + 150 else replace(state, joint_velocity=np.full(12, np.nan))

        seen.shown = unsound

    ending, raised = use(seen, a1, work)
    assert type(raised) is MotionError
    assert ending == [f"lowered, stopped: {raised}", UNCONFIRMED, "released"]
    assert is_damped(seen.commands[-1])


def test_a_robot_that_cannot_be_released_is_an_error(a1, seen):
    seen.close = raiser(OSError("no route"))
    ending, raised = use(seen, a1, lambda guard: hold(guard, seen, 0.02))
    assert type(raised) is CommunicationError
    assert str(raised) == (
        "the robot was not released: no route. Its motors may still hold it: use its own emergency stop"
    )
    assert ending == ["lowered", "damped", "not released: no route"]


def test_the_first_error_is_the_one_that_is_raised(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        seen.act = at(len(seen.commands) + 5, raiser(TroubleError()))
        hold(guard, seen, 0.1)

    seen.close = raiser(OSError("no route"))
    ending, raised = use(seen, a1, work)
    assert type(raised) is TroubleError
    assert ending[-1] == "not released: no route"


# --- Ctrl-C


def test_ctrl_c_in_a_motion_carries_its_recording(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        seen.act = at(len(seen.commands) + 30, raiser(KeyboardInterrupt()))
        hold(guard, seen, 1.0)

    ending, raised = use(seen, a1, work)
    assert type(raised) is MotionInterrupted
    assert len(raised.recording.commands.time) == 30
    assert ending == CALM
    assert_put_down(seen, a1)


@pytest.mark.parametrize(
    ("after", "ending"),
    [
        (5, ["feet down", "damped", "released"]),
        (150, ["feet down", "lowered, cut short", "damped", "released"]),
        (900, ["feet down", "lowered", "damped", "released"]),
    ],
)
def test_a_second_ctrl_c_skips_lowering_and_drops_no_robot(a1, seen, after, ending):
    """Feet come down within 75 control periods; the robot lies after 625 more."""

    def work(guard):
        lift(guard, a1)
        seen.act = at(len(seen.commands) + after, raiser(KeyboardInterrupt()))
        raise KeyboardInterrupt

    done, raised = use(seen, a1, work)
    assert type(raised) is KeyboardInterrupt
    assert done == ending
    assert_put_down(seen, a1)


# --- how runs begin


def test_a_standing_robot_is_taken_over_as_it_stands(a1, seen):
    with Guard(seen, a1) as guard:
        standing, _ = stand_up(guard, a1, nominal_stance(a1))
        first = seen.commands[0]
        assert np.abs(first.position - seen.joints[0]).max() < 2e-3
        assert all(command.kp is None for command in seen.commands)
        move_to(standing, nominal_stance(a1).feet_in_base)
    assert_put_down(seen, a1)


def test_a_robot_that_lies_gets_up_and_lies_down_again(a1, make):
    seen = make("lying")
    with Guard(seen, a1) as guard:
        standing, home = stand_up(guard, a1, nominal_stance(a1))
        stiffness = np.array([command.kp[0] for command in seen.commands if command.kp is not None])
        assert stiffness[0] < 0.01 * stiffness[-1]
        assert (np.diff(stiffness) >= 0).all()
        assert len(stiffness) == 250
        assert not lies(a1, nominal_stance(a1), seen.read().joint_position)
        move_to(standing, home)
    assert guard.report().ending == ("damped", "released")
    assert_put_down(seen, a1)


def test_a_robot_interrupted_while_it_gets_up_lies_down_again(a1, make):
    seen = make("lying", act=at(400, raiser(KeyboardInterrupt())))
    ending, raised = use(seen, a1, lambda guard: stand_up(guard, a1, nominal_stance(a1)))
    assert type(raised) is MotionInterrupted
    assert ending[-2:] == CALM[-2:]
    assert_put_down(seen, a1)


def away(state):
    return replace(state, joint_position=state.joint_position + 0.3 * (np.arange(12) == 1))


def turned(state):
    return replace(state, acceleration_in_imu=state.acceleration_in_imu[[2, 1, 0]])


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (
            away, MotionError,
            r"the first command would move joint 'FL_thigh_joint' at once from 1\.0\d\d to 0\.7\d\d rad; begin the "
            "motion at the robot's joint positions$",
        ),
        (
            turned, FallError,
            r"the base leans by \d\d deg before the first command\. If the robot has fallen, set it upright\. "
            "If the IMU is rotated: ",
        ),
        (
            lambda state: replace(state, acceleration_in_imu=0 * state.acceleration_in_imu),
            MotionError,
            r"the accelerometer reads 0\.0 m/s2",
        ),
    ],
)  # fmt: skip
def test_a_robot_that_is_not_as_it_should_be_is_not_even_touched(a1, seen, change, kind, message):
    here, sound = seen.read().joint_position, seen.read
    seen.read = lambda: change(sound())
    ending, raised = use(seen, a1, lambda guard: guard.step(JointCommand(here)))
    assert type(raised) is kind
    assert re.match(message, str(raised))
    assert (seen.commands, seen.closed, ending) == ([], 1, ["released"])


def test_a_robot_that_has_sunk_between_motions_is_not_pulled_up(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        for _ in range(150):  # it was without power for a while
            seen._platform.step(JointCommand(seen.joints[0], kp=np.zeros(12), kd=np.full(12, 0.5)))
        hold(guard, seen, 0.3)

    ending, raised = use(seen, a1, work)
    assert type(raised) is MotionError
    assert ending == ["damped", "released"]
    after = 255  # commands: the soft start, and the motion
    pulls = [command for command in seen.commands[after:] if not command.limp]
    assert len(pulls) * seen.control_period < 0.16  # with a bounded force, until it is noticed
    assert is_damped(seen.commands[-1])


# --- robots that lack something


@pytest.mark.parametrize(
    ("accepts", "hidden"),
    [
        (ACCEPTS_EVERYTHING, ("joint_torque", "joint_velocity")),
        (frozenset({"gains"}), ("joint_torque",)),
        (frozenset({"torque"}), ("joint_torque",)),
        (frozenset(), ()),
        (frozenset(), ("joint_torque", "joint_velocity")),
    ],
    ids=lambda names: " ".join(sorted(names)) or "nothing",
)
def test_a_robot_may_lack_gains_torques_and_speeds(a1, make, accepts, hidden):
    seen = make(accepts=accepts, hidden=hidden)
    with Guard(seen, a1) as guard:
        assert guard.accepts == accepts
        lift(guard, a1)
    assert seen.closed == 1
    assert_sane(seen, a1)
    last = seen.commands[-1]
    assert not feet_are_lifted(a1, nominal_stance(a1), last.position)
    if "gains" in accepts:
        assert guard.report().ending == ("feet down", "lowered", "damped", "released")
        assert is_damped(last)
    else:
        assert guard.report().ending == ("feet down", "lowered", "left to its own controller", "released")
        assert lies(a1, nominal_stance(a1), last.position)


def test_a_robot_that_cannot_be_damped_is_lowered_also_when_it_is_unsound(a1, make):
    """Else it would stand there for ever."""
    seen = make(accepts=frozenset())

    def work(guard):
        lift(guard, a1)
        seen.act = at(len(seen.commands) + 5, raiser(MotionError("frozen")))
        hold(guard, seen, 0.1)

    ending, _ = use(seen, a1, work)
    assert ending == ["feet down", "lowered", "left to its own controller", "released"]
    assert lies(a1, nominal_stance(a1), seen.read().joint_position)


# --- what passes through


def test_what_a_guarded_robot_is_sent_is_what_was_asked_for(a1, seen):
    with Guard(seen, a1) as guard:
        hold(guard, seen, 0.02)
        command = JointCommand(
            seen.commands[-1].position, np.full(12, 0.1), np.ones(12), np.full(12, 90.0), np.full(12, 2.0)
        )
        guard.step(command)
        sent = seen.commands[-1]
        for name in ("position", "velocity", "torque", "kp", "kd"):
            assert np.array_equal(getattr(sent, name), getattr(command, name))


def test_the_report_counts(a1, seen):
    with Guard(seen, a1) as guard:
        hold(guard, seen, 0.6)
        report = guard.report()
    assert report.commands == 250 + 150
    assert report.samples.fresh == 1 + 250 + 150
    assert (report.overruns, report.stalls, report.late_999) == (None, None, None)  # in simulation nothing is late
    assert (report.hottest_motor, report.lowest_voltage) == (None, None)
    assert 0 < report.largest_tilt < 0.05
    assert report.ending == ()
