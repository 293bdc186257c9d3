"""Search for the form of a robot's packets: it is asked in one after the other, and its answer determines the form."""

from __future__ import annotations

from collections.abc import Mapping

from equipoise.drivers.unitree.packet_formats import PacketFormat
from equipoise.drivers.unitree.packets import DAMAGES, Damage, SensorReadings, read_state

_TURN = 0.25  # [s] that a form is asked in
_QUIET = (
    0.05  # [s] at its end without asking, so that an answer belongs to one form; on a cable it takes less than 1 ms
)


class FormSearch:
    """Which of several forms a robot speaks.

    Where more than one form can read its answer (a Go1's are of one size, and who takes scrambled commands may answer
    plainly), it is the one that it was asked in.

    Args:
        forms: formats by name, the likeliest first.
        check: whether answers with a wrong checksum are none.

    Attributes:
        learnt: name of the form; None: not yet. A single form need not be learnt.
    """

    def __init__(self, forms: Mapping[str, PacketFormat], check: bool) -> None:
        self._forms, self._check = forms, check
        self._names = tuple(forms)
        self.learnt = self._names[0] if len(forms) == 1 else None
        self._turns: list[tuple[float, str]] = []

    def asks_in(self, now: float) -> str | None:
        """Name of the form to ask in now [s]; None while the last one's answers are waited for."""
        if self.learnt is not None:
            return self.learnt
        since = now - self._turns[-1][0] if self._turns else _TURN
        if since >= _TURN:
            self._turns.append((now, self._names[len(self._turns) % len(self._names)]))
        return None if _TURN - _QUIET <= since < _TURN else self._turns[-1][1]

    def hear(self, data: bytes, received: float) -> None:
        """Learn from a datagram of the robot, and when it arrived [s]."""
        if self.learnt is not None:
            return
        readable = [name for name in self._names if isinstance(self._read(name, data), SensorReadings)]
        if readable:
            asked = self._asked_in(received)
            self.learnt = asked if asked in readable else readable[0]

    def read(self, data: bytes) -> SensorReadings | Damage:
        """A state, or what is wrong with it; of forms that are not ruled out, by the one that fits best."""
        if self.learnt is not None:
            return self._read(self.learnt, data)
        read = (self._read(name, data) for name in self._names)
        return DAMAGES[max(DAMAGES.index(damage) for damage in read if not isinstance(damage, SensorReadings))]

    def _read(self, name: str, data: bytes) -> SensorReadings | Damage:
        return read_state(self._forms[name], data, self._check)

    def _asked_in(self, moment: float) -> str:
        """Return the form that was asked in last before a moment; the likeliest one if another program asked before."""
        return next((name for began, name in reversed(self._turns) if began <= moment), self._names[0])
