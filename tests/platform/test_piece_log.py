"""Pieces of running motions on their way to a log: in order, whole, and never waited for where that is not safe."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from guarded import PERIOD, Pieces, at_rest

from equipoise.errors import OutputError
from equipoise.platform import piece_log
from equipoise.platform.piece_log import PieceLog
from equipoise.platform.stepping import StepLog
from equipoise.recording.recording import PHASE, Event, Recording

EVENTS = (Event(0.0, PHASE, {"name": "move"}), Event(0.5, PHASE, {"name": "rest"}))


class Standing:
    """As much of a platform as steps need."""

    control_period = PERIOD

    def __init__(self, robot):
        self.joint_names = robot.joint_names


def whole_motion(robot, log, count):
    motion(robot, log, count)
    log.finish(wait=True)


def motion(robot, log, count, events=EVENTS, first=0):
    """Steps of a robot at rest that go through a log."""
    steps = StepLog(Standing(robot), at_rest(robot, first))
    log.begin(steps, count, events)
    for index in range(first + 1, first + count + 1):
        steps.add(np.zeros(12), lambda index=index: at_rest(robot, index))
        log.step()
    return steps


def test_the_pieces_are_the_recording(a1):
    kept = Pieces()
    log = PieceLog(kept, PERIOD)
    steps = motion(a1, log, 400)
    log.finish(wait=True)
    whole, joined = steps.recording(EVENTS), Recording.concatenate(kept.recordings)
    assert kept[0] == 400
    assert len(kept) == 1 + 4  # quarters of a second, and the rest
    assert np.array_equal(joined.joints.time, whole.joints.time)
    assert np.array_equal(joined.commands.position, whole.commands.position)
    assert joined.events == whole.events
    log.close()


def test_a_motion_that_breaks_off_is_written_when_all_is_over(a1):
    kept = Pieces()
    log = PieceLog(kept, PERIOD)
    motion(a1, log, 300)
    log.close()
    assert sum(len(piece.joints.time) for piece in kept.recordings) == 300


def test_motions_that_nobody_waited_for_come_in_order(a1):
    """A robot on two feet does not wait for a disk: the next motion begins meanwhile."""
    gate, kept = threading.Event(), Pieces()

    class Slow:
        def begin(self, commands):
            gate.wait(10.0)
            kept.begin(commands)

        def add(self, piece):
            kept.add(piece)

    log = PieceLog(Slow(), PERIOD)
    motion(a1, log, 200)
    log.finish(wait=False)
    motion(a1, log, 130, first=200)
    assert kept == []
    gate.set()
    log.finish(wait=True)
    assert [piece if isinstance(piece, int) else len(piece.joints.time) for piece in kept] == [
        200,
        125,
        75,
        130,
        125,
        5,
    ]
    log.close()


@pytest.mark.parametrize("fails_in", ["begin", "add"])
def test_a_full_disk_is_an_output_error(a1, fails_in):
    class Full(Pieces):
        pass

    def fail(self, what):
        raise OSError(28, "No space left on device")

    setattr(Full, fails_in, fail)
    log = PieceLog(Full(), PERIOD)
    with pytest.raises(OutputError) as caught:
        whole_motion(a1, log, 400)
    assert str(caught.value) == "the recording cannot be written: [Errno 28] No space left on device"
    with pytest.raises(OutputError):
        log.close()


def test_what_was_written_before_the_disk_was_full_stays(a1):
    class Full(Pieces):
        def add(self, piece):
            if len(self) == 3:
                raise OutputError("the disk is full")
            self.append(piece)

    kept = Full()
    log = PieceLog(kept, PERIOD)
    with pytest.raises(OutputError, match=r"^the disk is full$"):
        whole_motion(a1, log, 2000)
    assert sum(len(piece.joints.time) for piece in kept.recordings) == 250


def test_a_disk_that_hangs_is_not_waited_for_for_ever(a1, monkeypatch):
    monkeypatch.setattr(piece_log, "_PATIENCE", 0.05)
    monkeypatch.setattr(piece_log, "_LAST_PATIENCE", 0.05)
    gate = threading.Event()

    class Hung(Pieces):
        def add(self, piece):
            gate.wait(30.0)

    log = PieceLog(Hung(), PERIOD)
    motion(a1, log, 10)
    begun = time.monotonic()
    message = (
        "nothing of the recording has been written for 0.05 s, and some of it is not written yet: is the disk full, or on a "
        "network that is gone?"
    )
    with pytest.raises(OutputError) as caught:
        log.finish(wait=True)
    assert str(caught.value) == message
    with pytest.raises(OutputError):
        log.close()
    assert time.monotonic() - begun < 20.0
    gate.set()


def test_a_slow_disk_is_waited_for_as_long_as_it_takes_something(a1, monkeypatch):
    now = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=time.sleep)
    monkeypatch.setattr(piece_log, "time", clock)

    class Slow(Pieces):
        def add(self, piece):
            time.sleep(0.01)
            now[0] += 0.9 * piece_log._PATIENCE
            self.append(piece)

    kept = Slow()
    log = PieceLog(kept, PERIOD)
    motion(a1, log, 1250)
    log.finish(wait=True)
    assert len(kept.recordings) == 10
    motion(a1, log, 1250, first=1250)
    log.close()
    assert len(kept.recordings) == 20


def test_what_cannot_be_written_keeps_nothing_else_from_being(a1):
    class Once(Pieces):
        def add(self, piece):
            if len(self) == 3:
                self.append(0)
                raise OutputError("no memory just now")
            self.append(piece)

    kept = Once()
    log = PieceLog(kept, PERIOD)
    steps = motion(a1, log, 300)
    last = steps.recording(first=0, last=10)
    log.add(10, last)
    with pytest.raises(OutputError, match=r"^no memory just now$"):
        log.close()
    assert kept[-2:] == [10, last]


def test_nobody_wants_the_pieces(a1):
    log = PieceLog(None, PERIOD)
    motion(a1, log, 300)
    log.finish(wait=True)
    log.close()
