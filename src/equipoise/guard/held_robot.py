"""A robot that stands where it was sent while nobody moves it, as long as the program that should is alive.

A thread repeats the last command and looks at every sample as in a motion: from the first deadline after a motion on, since
the next one takes milliseconds to plan. What a limit stops then, and a program that gives no sign of life any more, ends the
run from that thread: whoever moves the robot next is told.
"""

from __future__ import annotations

import contextlib
import gc
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import replace

from equipoise.alive import alive, last_sign
from equipoise.errors import HungError, OverrunError
from equipoise.guard.control_loop import ControlLoop
from equipoise.guard.watchdog import Watchdog
from equipoise.platform.platform import JointCommand, RobotState

_IDLE = 5  # control periods without a step after which the last command is repeated in a motion, too
_PAUSE = 0.25  # [s] between two motions whose samples are the second's
_FRESH = 2  # control periods in which a sample is the present
_PATIENCE = 1.3  # [s] without a sign of life: with feet that come down and stiffness that fades, damped after 2.1 s
_BEAT = 0.2  # [s] between signs of life to the watchdog
_YIELD = 0.1e-3  # [s] in which somebody who wants to move the robot gets the lock


class HeldRobot:
    """Steps of a control loop, one thread at a time.

    While it is moved, Python does not look for unused objects, which would take milliseconds; while it is held for longer than
    between two motions, it does.

    Args:
        loop: control loop that steps the robot.
        period: control period [s].
        stall: the longest time without a command [s].
        end: function that ends the run by an error; called by the thread that holds.

    Attributes:
        lock: lock of the robot.
    """

    def __init__(self, loop: ControlLoop, period: float, stall: float, end: Callable[[BaseException], None]) -> None:
        self._loop, self._period, self._stall, self._end = loop, period, stall, end
        self.lock = threading.RLock()
        self._wanted = False
        self._resting = False  # a motion is over, and no other has begun
        self._stepped = self._moved = self._beaten = -float("inf")
        self._sent = -float("inf")  # when the last command left: a step that takes long leaves the robot alone, too
        self._seen: tuple[RobotState, ...] = ()  # between two motions
        self._told = -float("inf")  # the newest sign of life that the watchdog knows of
        self._thinker = 0
        self._watchdog: Watchdog | None = None
        self._over, self._called = threading.Event(), threading.Event()
        self._collects = gc.isenabled()
        self._holder: threading.Thread | None = None

    def begin(self, watchdog: Watchdog | None) -> None:
        """From now on, the first command was sent, it must not be left alone."""
        self._watchdog = watchdog
        self._sent = time.monotonic()  # the first command may have taken seconds
        if watchdog is not None:
            watchdog.moves()
        if self._collects:
            gc.freeze()  # a look at all that was imported takes 60 ms, in which nothing is sent
        self._holder = threading.Thread(target=self._hold, name="hold", daemon=True)
        self._holder.start()

    def stop(self) -> None:
        """Hold no more."""
        self._over.set()
        self._called.set()
        if self._collects:
            gc.unfreeze()
            gc.enable()

    @contextlib.contextmanager
    def moving(self) -> Generator[None]:
        """A motion, from before its first sample on: whoever makes it sends every command. Then the robot is held at once.

        Not if it raises: what comes next is the ending.
        """
        self._resting = False
        yield
        self._resting = True
        self._called.set()

    def read(self) -> RobotState:
        """As the loop's."""
        with self.turn():
            return self._loop.read()

    def present(self) -> RobotState:
        """The state in which a motion begins, with the samples of a short pause before it.

        One that has just come is not looked at again: the next would be waited for beyond the deadline.
        """
        with self.turn():
            state = None if self._loop.known is None else self._loop.known.state
            if state is None or state.received is None or time.monotonic() - state.received > _FRESH * self._period:
                state = self._loop.read()
            return replace(state, earlier=(*self._seen, *state.earlier)) if self._seen else state

    def step(self, command: JointCommand) -> RobotState:
        """As the loop's; raises OverrunError if nothing was sent for too long, by the thread that holds neither."""
        with self.turn():
            if self._holds:
                self._check_gap()
            try:
                return self._loop.step(command)
            except OverrunError:
                if self._holds:
                    self._check_gap()  # its words say what to do
                raise
            finally:
                self._note()

    def push(self, command: JointCommand) -> RobotState:
        """As the loop's."""
        with self.turn():
            try:
                return self._loop.push(command)
            finally:
                self._note()

    def _note(self) -> None:
        """Somebody has moved the robot."""
        self._stepped = self._moved = time.monotonic()
        self._resting, self._seen = False, ()

    @contextlib.contextmanager
    def turn(self) -> Generator[None]:
        """The robot is the calling thread's, whose signs of life count from now on."""
        self._wanted = True
        with self.lock:
            self._wanted = False
            self._thinker = threading.get_ident()
            alive()
            if self._holds:
                gc.disable()
            yield
            self._pass_on()

    def _pass_on(self) -> None:
        """Tell the watchdog of a sign of life that it does not know of yet."""
        now, sign = time.monotonic(), last_sign(self._thinker)
        if self._watchdog is not None and sign > self._told and now - self._beaten > _BEAT:
            self._told, self._beaten = sign, now
            self._watchdog.beat()

    def _check_gap(self) -> None:
        """Before a command: nothing is sent to a robot that has had to do without for too long. It may lie by now."""
        now = time.monotonic()
        if now - self._sent > self._stall:
            raise OverrunError(
                f"this computer sent nothing for {(now - self._sent) * 1000:.0f} ms while it moved or held the robot: end "
                "other programs, or give this one a core of its own; do not stop it (Ctrl-Z), nor have it call what keeps "
                "Python's other threads waiting"
            )
        self._sent = now

    @property
    def _holds(self) -> bool:
        """Whether the robot must not be left alone: it was moved, is not simulated, and is not being put down."""
        return self._holder is not None and not self._over.is_set()

    @property
    def _idle(self) -> bool:
        return not self._wanted and (self._resting or time.monotonic() - self._stepped > _IDLE * self._period)

    def _hold(self) -> None:
        """Until the run is over: step where nobody does."""
        while not self._over.is_set():
            self._called.wait(_YIELD if self._idle else _IDLE * self._period)
            self._called.clear()
            if not self._idle:  # who moves the robot never waits for this thread
                continue
            with self.lock:
                if self._over.is_set() or not self._idle:
                    continue
                try:
                    self._repeat()
                except BaseException as error:
                    self._end(error)

    def _repeat(self) -> None:
        """The last command again, with everything that is checked in a motion."""
        self._check_gap()
        now, sign = time.monotonic(), last_sign(self._thinker)
        if now - sign > _PATIENCE:
            raise HungError(
                f"the program that moves the robot gave no sign of life for {now - sign:.1f} s, and the robot was let down: "
                "a loop that does not end, a disk or a terminal that does not answer? What computes for long calls "
                "equipoise.alive.alive()"
            )
        short = now - self._moved < _PAUSE
        if self._collects and not short:
            gc.enable()
        self._stepped = now
        try:
            state = self._loop.hold()
        except OverrunError:
            self._check_gap()  # as above: a thread that was kept on its way to the deadline
            raise
        self._seen = (*self._seen, *state.earlier, replace(state, earlier=())) if short else ()
        self._pass_on()
