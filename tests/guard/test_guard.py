"""The guard over a simulated robot: whatever happens, and whatever fails meanwhile, the robot is put down and let go of."""

import re
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest
from guarded import Pieces, Seen, assert_put_down, assert_sane, hold, is_damped, lift, simulated

from equipoise import nominal_stance
from equipoise.errors import (
    CommunicationError,
    FallError,
    LimitError,
    MotionError,
    OutputError,
    ReachError,
    SensorError,
    TrackingError,
)
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard.footing import feet_are_lifted
from equipoise.guard.guard import Guard
from equipoise.platform import piece_log
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand, MotionInterrupted
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log
from equipoise.robot.stance import lies

CALM = ["lying down", "damped", "released"]


class TroubleError(Exception):
    """Of the program, not of the robot."""


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


def use(seen, robot, work, **how):
    """Do something with a guarded robot; returns what the guard says of the ending, and what was raised."""
    guard = Guard(seen, robot, **how)
    try:
        with guard:
            work(guard)
    except BaseException as error:
        return list(guard.report().ending), error
    return list(guard.report().ending), None


# --- how runs end


WELL = [
    None, TroubleError(), KeyboardInterrupt(), SystemExit(3), ReachError("too far"), OutputError("the disk is full"),
]  # fmt: skip
UNWELL = [TrackingError("it did not come to rest"), FallError("it leans"), SensorError("frozen")]


@pytest.mark.parametrize(
    ("error", "in_air"),
    [*((error, True) for error in (*WELL, *UNWELL)), (None, False), (WELL[1], False), (UNWELL[0], False)],
    ids=lambda value: type(value).__name__ if not isinstance(value, bool) else "on two feet" if value else "standing",
)
def test_however_a_run_ends_the_robot_is_put_down(a1, seen, error, in_air):
    def work(guard):
        lift(guard, a1) if in_air else hold(guard, seen, 0.1)
        if error is not None:
            raise error

    ending, raised = use(seen, a1, work)
    assert raised is error
    assert ending == ["feet down"] * in_air + (CALM if error in WELL else CALM[1:])
    assert_put_down(seen, a1)


def test_a_link_that_is_gone_is_damped_at_once(a1, seen):
    def work(guard):
        lift(guard, a1)
        seen.act = at(len(seen.commands) + 5, raiser(CommunicationError("no sample has arrived")))
        hold(guard, seen, 0.1)

    ending, raised = use(seen, a1, work)
    assert type(raised) is CommunicationError
    assert ending == ["damped", "released"]
    assert is_damped(seen.commands[-1])
    assert sum(map(is_damped, seen.commands)) > 900  # the robot may hear again, and nobody can see that it lies


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


def test_the_robot_is_down_when_the_caller_hears_of_it(a1, seen):
    """Also of who catches the error, and of who does not use `with`."""
    guard = Guard(seen, a1)
    hold(guard, seen, 0.02)
    seen.act = at(len(seen.commands) + 5, raiser(TroubleError()))
    with pytest.raises(TroubleError):
        hold(guard, seen, 0.1)
    assert_put_down(seen, a1)


def test_reading_that_fails_puts_the_robot_down_too(a1, seen):
    guard = Guard(seen, a1)
    hold(guard, seen, 0.02)
    seen.read = lambda sound=seen.read: replace(sound(), time=sound().time + 1, joint_position=np.full(12, np.nan))
    with pytest.raises(SensorError):
        guard.read()
    assert seen.closed == 1
    assert is_damped(seen.commands[-1])


def test_any_thread_may_close(a1, seen):
    guard, errors = Guard(seen, a1), []

    def work():
        try:
            while True:
                hold(guard, seen, 0.02)
        except MotionError as error:
            errors.append(str(error))

    moving = threading.Event()
    seen.act = lambda count: moving.set() if count > 270 else None
    worker = threading.Thread(target=work)
    worker.start()
    assert moving.wait(60.0)
    guard.close()
    worker.join(60.0)
    assert not worker.is_alive()
    assert len(errors) == 1
    assert_put_down(seen, a1)


# --- what fails in the ending itself


@pytest.mark.parametrize("error", [RuntimeError, CommunicationError, KeyboardInterrupt, SystemExit, MemoryError])
def test_the_ending_reaches_its_end_whatever_sending_raises(a1, seen, error):
    def work(guard):
        lift(guard, a1)
        seen.act = raiser(error("in the ending"))
        raise TroubleError

    ending, raised = use(seen, a1, work)
    assert type(raised) is TroubleError
    assert seen.closed == 1
    assert ending[-1] == "released"
    assert [stage.split(",")[0] for stage in ending[:-1]] == ["feet down", "lying down", "damped"]
    assert all(stage.endswith("stopped: in the ending") for stage in ending[:-1])


def test_commands_that_get_lost_in_the_ending_do_not_end_it(a1, seen):
    with Guard(seen, a1) as guard:
        lift(guard, a1)
        generator = np.random.default_rng(3)
        seen.act = lambda count: generator.random() < 0.3 and raiser(CommunicationError("lost"))()
    assert is_damped(seen.commands[-1])
    assert not feet_are_lifted(a1, nominal_stance(a1), seen.commands[-1].position)
    assert seen.closed == 1


def test_a_robot_that_goes_wrong_while_it_lies_down_is_damped(a1, seen):
    with Guard(seen, a1) as guard:
        hold(guard, seen, 0.02)
        sound, began = seen.shown, len(seen.commands)

        def unsound():
            state = sound()
            return state if len(seen.commands) < began + 150 else replace(state, joint_velocity=np.full(12, np.nan))

        seen.shown = unsound
    down, damped, released = guard.report().ending
    assert down.startswith("lying down, stopped: the velocity of joint 'FL_hip_joint' says what is no number")
    assert (damped, released) == ("damped", "released")
    assert is_damped(seen.commands[-1])


def test_a_robot_that_cannot_be_let_go_of_is_told_of(a1, seen):
    seen.close = raiser(OSError("no route"))
    ending, raised = use(seen, a1, lambda guard: hold(guard, seen, 0.02))
    assert type(raised) is CommunicationError
    assert str(raised) == (
        "the robot could not be released: no route. Its motors may still hold it: use its own emergency stop"
    )
    assert ending == ["lying down", "damped", "not released: no route"]


class Full(Pieces):
    """A disk with room for one piece."""

    def add(self, piece):
        if self.recordings:
            raise OSError(28, "No space left on device")
        self.append(piece)


def test_the_first_error_is_the_one_that_is_told(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        seen.act = at(len(seen.commands) + 5, raiser(TroubleError()))
        hold(guard, seen, 0.1)

    seen.close = raiser(OSError("no route"))
    ending, raised = use(seen, a1, work, log=Full())
    assert type(raised) is TroubleError
    assert ending[-1] == "not released: no route"


def test_a_full_disk_ends_the_run_and_the_robot_lies_down(a1, seen):
    log = Full()
    ending, raised = use(seen, a1, lambda guard: hold(guard, seen, 5.0), log=log)
    assert type(raised) is OutputError
    assert str(raised) == "the recording cannot be written: [Errno 28] No space left on device"
    assert ending == CALM
    assert_put_down(seen, a1)
    assert len(log.recordings[0].joints.time) == 62


class Stalls:
    """A file of a disk that stalls in the middle of the third piece that a thread of its own writes."""

    def __init__(self, file):
        self._file, self._left, self.gate = file, 3, threading.Event()

    def __getattr__(self, name):
        return getattr(self._file, name)

    def write(self, data):
        if threading.current_thread() is not threading.main_thread():
            self._left -= 1
            if self._left == 0:
                count = self._file.write(data[: len(data) // 2])
                self.gate.wait(30.0)
                return count
        return self._file.write(data)


def test_a_disk_that_stalls_leaves_the_log_readable(a1, seen, tmp_path, monkeypatch):
    """One thread writes, also the ending; and who closes the log waits for it."""
    monkeypatch.setattr(piece_log, "_PATIENCE", 0.05)
    monkeypatch.setattr(piece_log, "_LAST_PATIENCE", 0.05)
    log = RunLog(tmp_path / "log.mcap")
    file = log.file._file = Stalls(log.file._file)
    _, raised = use(seen, a1, lambda guard: hold(guard, seen, 1.5), log=log)
    assert str(raised).startswith("nothing of the recording has been written for 0.05 s")
    closing = threading.Thread(target=log.close)
    closing.start()
    closing.join(0.2)
    file.gate.set()
    closing.join()
    content = read_log(tmp_path / "log.mcap")
    assert content.closed
    [play, *_] = content.plays
    assert len(play.recording.joints.time) >= 3 * 62  # what had begun to be written
    assert np.diff(play.recording.joints.time) == pytest.approx(seen.control_period)


# --- signals


def test_ctrl_c_waits_for_the_end_of_a_control_period(a1, seen):
    log = Pieces()
    with Guard(seen, a1, log=log) as guard:
        hold(guard, seen, 0.02)
        sent = len(seen.commands)
        seen.act = at(sent + 30, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(MotionInterrupted) as caught:
            hold(guard, seen, 1.0)
    assert len(caught.value.recording.commands.time) == 31
    assert list(guard.report().ending) == CALM
    assert_put_down(seen, a1)
    assert [len(piece.joints.time) for piece in log.recordings[:-1]] == [5, 31]
    assert log.recordings[-1].has_phase("ending")


def test_sigterm_is_no_other_than_ctrl_c(a1, seen):
    seen.act = at(270, lambda: signal.raise_signal(signal.SIGTERM))
    ending, raised = use(seen, a1, lambda guard: hold(guard, seen, 1.0))
    assert type(raised) is MotionInterrupted
    assert str(raised.__cause__) == "ended by SIGTERM"
    assert ending == CALM
    assert_put_down(seen, a1)


@pytest.mark.parametrize(
    ("after", "ending"),
    [
        (5, ["feet down", "damped", "released"]),
        (150, ["feet down", "lying down, cut short", "damped", "released"]),
        (900, ["feet down", "lying down", "damped", "released"]),
    ],
)
def test_asked_again_the_ending_is_shorter_but_drops_nobody(a1, seen, after, ending):
    """Feet come down within 75 control periods; the robot lies after 625 more."""

    def work(guard):
        lift(guard, a1)
        seen.act = at(len(seen.commands) + after, lambda: signal.raise_signal(signal.SIGINT))
        raise KeyboardInterrupt

    done, raised = use(seen, a1, work)
    assert type(raised) is KeyboardInterrupt
    assert done == ending
    assert_put_down(seen, a1)


# --- how runs begin


def test_a_standing_robot_is_taken_over_as_it_stands(a1, seen):
    with Guard(seen, a1) as guard:
        planted, _ = stand_up(guard, a1, nominal_stance(a1))
        first = seen.commands[0]
        assert np.abs(first.position - seen.joints[0]).max() < 2e-3
        assert all(command.kp is None for command in seen.commands)
        move_to(planted, nominal_stance(a1).feet_in_base)
    assert_put_down(seen, a1)


def test_a_robot_that_lies_gets_up_and_lies_down_again(a1, make):
    seen = make("lying")
    with Guard(seen, a1) as guard:
        planted, home = stand_up(guard, a1, nominal_stance(a1))
        stiffness = np.array([command.kp[0] for command in seen.commands if command.kp is not None])
        assert stiffness[0] < 0.01 * stiffness[-1]
        assert (np.diff(stiffness) >= 0).all()
        assert len(stiffness) == 250
        assert not lies(a1, nominal_stance(a1), seen.read().joint_position)
        move_to(planted, home)
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
            away, LimitError,
            r"the first command would move joint 'FL_thigh_joint' at once from 1\.0\d\d to 0\.7\d\d rad; motions start where "
            "the robot is$",
        ),
        (
            turned, FallError,
            r"the base leans by \d\d deg before anything has moved: the robot has fallen, or the IMU is mounted turned \(give "
            r"its pose under imu_rpy in a robot description\)",
        ),
        (
            lambda state: replace(state, acceleration_in_imu=0 * state.acceleration_in_imu),
            SensorError,
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


def test_a_robot_that_was_moved_while_nobody_looked_is_not_pulled_back(a1, seen):
    def work(guard):
        hold(guard, seen, 0.02)
        for _ in range(150):  # it was without power for a while
            seen._platform.step(JointCommand(seen.joints[0], kp=np.zeros(12), kd=np.full(12, 0.5)))
        hold(guard, seen, 0.1)

    ending, raised = use(seen, a1, work)
    assert type(raised) is TrackingError
    assert "from where it was sent to hold: has somebody moved the robot, has it sunk?" in str(raised)
    assert ending == ["damped", "released"]
    after = 255  # commands: the soft start, and the motion
    pulls = [np.abs(command.position - joints).max() for command, joints in
             zip(seen.commands[after:], seen.joints[after:], strict=True) if command.kp.any()]  # fmt: skip
    assert not pulls  # it has sunk
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
        assert guard.report().ending == ("feet down", "lying down", "damped", "released")
        assert is_damped(last)
    else:
        assert guard.report().ending == ("feet down", "lying down", "left to its own controller", "released")
        assert lies(a1, nominal_stance(a1), last.position)


def test_a_robot_whose_stiffness_cannot_fade_lies_down_also_when_it_is_not_well(a1, make):
    """Else it would stand there for ever."""

    seen = make(accepts=frozenset())

    def work(guard):
        hold(guard, seen, 0.02)
        raise TrackingError("it did not come to rest")

    ending, _ = use(seen, a1, work)
    assert ending == ["lying down", "left to its own controller", "released"]


# --- what passes through


def test_what_a_guarded_robot_is_sent_is_what_was_asked_for(a1, seen):
    with Guard(seen, a1) as guard:
        hold(guard, seen, 0.02)
        command = JointCommand(
            seen.commands[-1].position, np.full(12, 0.1), np.ones(12), np.full(12, 90.0), np.full(12, 2.0)
        )
        guard.step(command)
        assert seen.commands[-1] is command


def test_the_log_holds_what_play_returns(a1, seen):
    log = Pieces()
    with Guard(seen, a1, log=log) as guard:
        first, second = hold(guard, seen, 0.6), hold(guard, seen, 0.3)
    pieces = log.recordings
    assert log[0] == 150
    assert np.array_equal(np.concatenate([piece.joints.time for piece in pieces[:3]]), first.joints.time)
    assert np.array_equal(np.concatenate([piece.joints.position for piece in pieces[3:-1]]), second.joints.position)
    assert pieces[-1].has_phase("ending")
    assert pieces[-1].joints.time[0] > second.joints.time[-1]
    assert np.abs(pieces[-1].joints.position[-1] - second.joints.position[-1]).max() > 0.5  # it lies


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
