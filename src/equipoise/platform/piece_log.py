"""What a running motion records, handed on in pieces by a thread of its own: the control loop waits for no disk."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass
from typing import Protocol

from equipoise.alive import alive
from equipoise.errors import EquipoiseError, OutputError
from equipoise.platform.stepping import StepLog
from equipoise.recording.recording import Event, Recording

_PIECE_TIME = 0.25  # [s]
_PATIENCE = 2.0  # [s] with a disk that takes nothing, while the robot stands on four feet
_LAST_PATIENCE = 20.0  # [s] once it has been put down


class MotionLog(Protocol):
    """What keeps motions while they are played. Called by one thread, in order."""

    def begin(self, commands: int) -> None:
        """A motion of so many commands begins; the pieces that are added until the next one does are its."""
        ...

    def add(self, piece: Recording) -> None:
        """What was just played."""
        ...


@dataclass(frozen=True, eq=False)
class _Piece:
    """Steps from one on, up to another."""

    steps: StepLog
    first: int
    last: int
    events: tuple[Event, ...]


class PieceLog:
    """Hands pieces of motions to a log while they are played, by one thread: nobody else writes to it meanwhile.

    What cannot be written keeps nothing after it from being tried.

    Args:
        log: log that takes the pieces; None: nobody wants them.
        control_period: time between commands [s].
    """

    def __init__(self, log: MotionLog | None, control_period: float) -> None:
        self._log = log
        self._every = max(1, round(_PIECE_TIME / control_period))
        self._steps: StepLog | None = None
        self._events: tuple[Event, ...] = ()
        self._commands = self._done = 0
        self._pieces: queue.Queue[_Piece | Recording | int | None] = queue.Queue()
        self._trouble: BaseException | None = None
        self._writer: threading.Thread | None = None

    def begin(self, steps: StepLog, commands: int, events: tuple[Event, ...]) -> None:
        """A motion of so many commands begins. The log hears of it with its first piece: now nothing may wake the writer."""
        self._steps, self._events, self._commands, self._done = steps, events, commands, 0

    def add(self, commands: int, motion: Recording) -> None:
        """A whole motion of so many commands, behind what was played before it."""
        self._hand_on_rest()
        self._put(commands)
        self._put(motion)

    def step(self) -> None:
        """A step was done; raises what writing raised meanwhile."""
        self._check()
        if self._steps is not None and self._steps.count - self._done >= self._every:
            self._hand_on(self._steps)

    def finish(self, wait: bool) -> None:
        """The motion is over.

        Args:
            wait: whether to wait until all of it has been written; nobody looks after the robot meanwhile.

        Raises:
            OutputError: it could not be written, or the disk takes nothing.
        """
        self._hand_on_rest()
        self._check()
        if wait:
            self._wait(_PATIENCE)

    def close(self) -> None:
        """No more pieces; raises OutputError if some could not be written."""
        self._hand_on_rest()
        try:
            self._wait(_LAST_PATIENCE)
        finally:
            self._pieces.put(None)

    def _hand_on_rest(self) -> None:
        if self._steps is not None and self._steps.count > self._done:
            self._hand_on(self._steps)
        self._steps = None

    def _check(self) -> None:
        trouble = self._trouble
        if isinstance(trouble, OSError) and not isinstance(trouble, EquipoiseError):
            raise OutputError(f"the recording cannot be written: {trouble}") from trouble
        if trouble is not None:
            raise trouble

    def _hand_on(self, steps: StepLog) -> None:
        if not self._done:
            self._put(self._commands)
        self._put(_Piece(steps, self._done, steps.count, self._events))
        self._done = steps.count

    def _put(self, piece: _Piece | Recording | int) -> None:
        if self._log is None:
            return
        self._pieces.put(piece)
        if self._writer is None:
            self._writer = threading.Thread(target=self._write, args=(self._log,), name="recording", daemon=True)
            self._writer.start()

    def _wait(self, patience: float) -> None:
        """Until all has been tried, as long as the disk takes a piece now and then."""
        left, since = 0, 0.0
        while now_left := self._pieces.unfinished_tasks:
            now = time.monotonic()
            if now_left != left:
                left, since = now_left, now
            elif now - since > patience:
                self._check()
                raise OutputError(
                    f"nothing of the recording has been written for {patience:g} s, and some of it is not written yet: is the "
                    "disk full, or on a network that is gone?"
                )
            alive()  # it waits no longer than its patience
            time.sleep(1e-3)
        self._check()

    def _write(self, log: MotionLog) -> None:
        piece: _Piece | Recording | int | None = 0
        while piece is not None:
            piece = self._pieces.get()
            try:
                if piece is not None:
                    self._keep(log, piece)
            except BaseException as error:
                self._trouble = self._trouble or error
            self._pieces.task_done()

    def _keep(self, log: MotionLog, piece: _Piece | Recording | int) -> None:
        if isinstance(piece, int):
            log.begin(piece)
        elif isinstance(piece, Recording):
            log.add(piece)
        else:
            log.add(piece.steps.recording(piece.events, piece.first, piece.last))
