"""Formats of consumers, and the sentence about mass, CoM and inertia in every file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from equipoise.exports.parameters import BASE
from equipoise.exports.subject import PAYLOAD, Subject, Written

FileUse = Literal["model", "given", ""]
_QUANTITIES = {
    "mass": "mass [kg]",
    "CoM": "CoM [m] in the frame of {0}",
    "inertia": "inertia [kg m2] about the CoM in axes of {0}",
}


@dataclass(frozen=True)
class Format:
    """Output format for one consumer.

    Attributes:
        name: name that --to takes.
        bodies: names of the bodies that it needs, "base", "composite" or both; they must be identified. Empty: none.
        file: user's file that is edited: the "model" of the run, one "given" with --file if there is one, or none.
        payload: whether it can hold the payload as a separate link.
        where: destination of the numbers, in words.
        output: default name of the file that is written; an edited file keeps its own.
        write: function that writes it.
        page: heading in docs/reference/exports.md, or an address; empty: none.
        samples: whether it lists drawn bodies too.
        parts: parts of a result that it can hold, of "base", "sensors", "motors" and "legs".
        lacks: quantities of its bodies that the consumer cannot hold: "composite CoM" and so on.
    """

    name: str
    bodies: tuple[str, ...]
    file: FileUse
    payload: bool
    where: str
    output: str
    write: Callable[[Subject], Written]
    page: str = ""
    samples: bool = False
    parts: tuple[str, ...] = (BASE,)
    lacks: tuple[str, ...] = ()

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the bodies and other parts that the format holds."""
        return (*self.bodies, *(part for part in self.parts if part != BASE))

    def contents(self, bodies: tuple[str, ...], subject: Subject) -> str:
        """Return the sentence that states which of mass, CoM and inertia is written, and what the consumer cannot hold.

        Args:
            bodies: names of the bodies that are written.
            subject: input of the writer.
        """
        if not bodies:
            return f"written: {' and '.join(subject.parts)}; no mass, CoM or inertia of a body"
        # A format of the base alone is used with the model file, and has that file's axes.
        frame = "that link" if subject.payload_link or self.bodies == (BASE,) else f"base link {subject.base_link!r}"
        return "; ".join(self._contents_of(body, frame, subject) for body in bodies)

    def _contents_of(self, body: str, frame: str, subject: Subject) -> str:
        lacks = [quantity for quantity in ("mass", "inertia", "CoM") if f"{body} {quantity}" in self.lacks]
        written = ", ".join(words.format(frame) for name, words in _QUANTITIES.items() if name not in lacks)
        name = f"link {PAYLOAD!r}" if subject.payload_link else f"the {body}{', as ranges' if self.samples else ''}"
        message = f"written of {name}: {written}"
        if not lacks:
            return message
        parameters = subject.base_in_file if self.bodies == (BASE,) else getattr(subject, body)
        place = ", ".join(f"{value:.5f}" for value in parameters.com)
        com = f", which is at ({place}) m in the frame of {frame}" if "CoM" in lacks else ""
        return f"{message}; {self.where} cannot hold the {body}'s {' and '.join(lacks)}{com}"
