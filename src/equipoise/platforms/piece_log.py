"""What a running motion records, handed on in pieces by a thread of its own: the control loop waits for no disk."""

from __future__ import annotations

import queue
import threading
from dataclasses import dataclass

from equipoise.platforms.platform import Steps
from equipoise.recordings.recording import Event
from equipoise.recordings.run_log import RunLog

_PIECE_TIME = 0.25  # [s]


@dataclass(frozen=True, eq=False)
class _Piece:
    """Steps from one on, up to another."""

    steps: Steps
    first: int
    last: int
    events: tuple[Event, ...]


class PieceLog:
    """Hands pieces of motions to a log while they are played.

    Args:
        log: takes them; None: nobody wants them.
        control_period: [s].
    """

    def __init__(self, log: RunLog | None, control_period: float) -> None:
        self._log = log
        self._every = max(1, round(_PIECE_TIME / control_period))
        self._events: tuple[Event, ...] = ()
        self._done = 0
        self._pieces: queue.Queue[_Piece | None] = queue.Queue()
        self._trouble: BaseException | None = None
        self._writer: threading.Thread | None = None

    def begin(self, commands: int, events: tuple[Event, ...]) -> None:
        """A motion of so many commands begins."""
        self._events, self._done = events, 0
        if self._log is None:
            return
        self._log.begin(commands)
        if self._writer is None:
            self._writer = threading.Thread(target=self._write, name="recording", daemon=True)
            self._writer.start()

    def written(self, steps: Steps) -> None:
        """A step was done; raises what writing raised meanwhile."""
        if self._trouble is not None:
            raise self._trouble
        if self._log is not None and steps.count - self._done >= self._every:
            self._hand_on(steps)

    def finish(self, steps: Steps) -> None:
        """The motion is over: returns when all of it has been written."""
        if self._log is None:
            return
        if steps.count > self._done:
            self._hand_on(steps)
        self._pieces.join()
        if self._trouble is not None:
            raise self._trouble

    def close(self) -> None:
        """No more pieces."""
        if self._writer is not None:
            self._pieces.put(None)
            self._writer.join(timeout=5.0)

    def _hand_on(self, steps: Steps) -> None:
        self._pieces.put(_Piece(steps, self._done, steps.count, self._events))
        self._done = steps.count

    def _write(self) -> None:
        while (piece := self._pieces.get()) is not None:
            try:
                if self._trouble is None and self._log is not None:
                    self._log.add(piece.steps.recording(piece.events, piece.first, piece.last))
            except BaseException as error:
                self._trouble = error
            self._pieces.task_done()
