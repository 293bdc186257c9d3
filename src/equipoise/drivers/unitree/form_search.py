"""Detection of a robot's packet form: requests are sent in each form in turn, and the answer determines the form."""

from __future__ import annotations

from collections.abc import Mapping

from equipoise.drivers.unitree.packet_formats import PacketFormat
from equipoise.drivers.unitree.packets import DAMAGES, Damage, SensorReadings, read_state

_TURN = 0.25  # [s] for each form
_QUIET = 0.05  # [s] at its end without requests, so that an answer belongs to one form; a cable takes less than 1 ms


class FormSearch:
    """Search for a robot's packet form among several.

    If more than one form can decode the answer, the form of the request is chosen. A Go1's forms have one size, and a robot
    that accepts scrambled commands may answer plainly.

    Args:
        forms: formats by name, the likeliest first.
        check: whether answers with a wrong checksum are ignored.

    Attributes:
        form: name of the form; None: not detected yet. A single form needs no detection.
    """

    def __init__(self, forms: Mapping[str, PacketFormat], check: bool) -> None:
        self._forms, self._check = forms, check
        self._names = tuple(forms)
        self.form = self._names[0] if len(forms) == 1 else None
        self._turns: list[tuple[float, str]] = []

    def request_form(self, now: float) -> str | None:
        """Return the form of a request at a time [s]; None while answers to the last form may arrive."""
        if self.form is not None:
            return self.form
        since = now - self._turns[-1][0] if self._turns else _TURN
        if since >= _TURN:
            self._turns.append((now, self._names[len(self._turns) % len(self._names)]))
        return None if _TURN - _QUIET <= since < _TURN else self._turns[-1][1]

    def add(self, data: bytes, received: float) -> None:
        """Add a datagram of the robot with its time of arrival [s]."""
        if self.form is not None:
            return
        readable = [name for name in self._names if isinstance(self._read(name, data), SensorReadings)]
        if readable:
            requested = self._requested_form(received)
            self.form = requested if requested in readable else readable[0]

    def read(self, data: bytes) -> SensorReadings | Damage:
        """Decode a datagram, or return its damage, in the best form before the detection."""
        if self.form is not None:
            return self._read(self.form, data)
        read = (self._read(name, data) for name in self._names)
        return DAMAGES[max(DAMAGES.index(damage) for damage in read if not isinstance(damage, SensorReadings))]

    def _read(self, name: str, data: bytes) -> SensorReadings | Damage:
        return read_state(self._forms[name], data, self._check)

    def _requested_form(self, moment: float) -> str:
        """Return the form of the last request before a time; the likeliest one if only another program sent requests."""
        return next((name for began, name in reversed(self._turns) if began <= moment), self._names[0])
