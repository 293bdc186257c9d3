"""Input of the writers of exported files: numbers, header and notes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import pinocchio as pin

from equipoise._version import __version__
from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.exports.parameters import Column
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.cleaning.urdf import physical_inertia
from equipoise.robot.description import Forward
from equipoise.robot.forward import link_in_file
from equipoise.robot.inertial import InertialParameters

PAYLOAD = "equipoise_payload"
"""Name of the link that `--add-payload-link` writes."""
COMPOSITE_WORDS = "composite: the whole robot frozen at the stance"
_BASE_WORDS = (
    "base link {!r} with all that is fixed to it or held; with the model's legs it makes the composite that was found"
)
_FLATTEST = 1e-3  # second moment of mass of a body that is written for one that cannot be, over its largest
_PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class UsersFile:
    """A file that is edited."""

    path: Path
    content: bytes


@dataclass(frozen=True)
class Written:
    """A file's content, and words for the body or the parts that it holds."""

    content: bytes
    about: str
    notes: tuple[str, ...] = ()  # what speaks against it, found while writing

    @classmethod
    def text(cls, lines: list[str], about: str) -> Written:
        """From lines of text."""
        return cls(("\n".join(lines) + "\n").encode(), about)


@dataclass(frozen=True, eq=False)
class Subject:
    """Input of a writer.

    Attributes:
        result: result of the calibration.
        run: name of the run it is from, as the user gave it; empty for one in memory.
        file: user's own file, if there is one.
        payload_link: whether what was added is to be a link of its own.
        samples: number of bodies to draw and list.
        seed: seed of everything drawn.
        notes: objections to the numbers, worst first.
        forced: whether to write the nearest body where no body can have what was added.
        parts: what of the result is to be written, of "base", "sensors", "motors" and "legs".
        columns: what is written of sensors, motors and legs.
        contents: sentence that states which of mass, CoM and inertia is written, in which frame, and what has no place.
    """

    result: Calibration
    run: str = ""
    file: UsersFile | None = None
    payload_link: bool = False
    samples: int = 0
    seed: int = 0
    notes: tuple[str, ...] = ()
    forced: bool = False
    parts: tuple[str, ...] = ("base",)
    columns: tuple[Column, ...] = ()
    contents: str = ""

    @property
    def composite(self) -> InertialParameters:
        """The whole robot frozen at the stance, in the base frame."""
        return self.result.composite.parameters()

    @property
    def base(self) -> InertialParameters:
        """The base link with all that is fixed to it or held.

        It is such that the model's own legs make it the composite that was found, which a run determines best. The
        calibration's own base goes with legs that were adjusted too, which no file has that gets the base alone.
        """
        return self._base[0]

    @property
    def base_notes(self) -> tuple[str, ...]:
        """Notes on the base; raises as `base` does."""
        return self._base[1]

    @cached_property
    def _base(self) -> tuple[InertialParameters, tuple[str, ...]]:
        what = f"base link {self.base_link!r}, less the model's legs,"
        remedy = "do the model's legs weigh what it says? See 'equipoise audit'"
        return self.nearest_body(self.result.base_for_model_legs, what, remedy)

    def nearest_body(self, vector: FloatArray, what: str, remedy: str) -> tuple[InertialParameters, tuple[str, ...]]:
        """A body of (10,) parameters, or, where none can have its inertia, the nearest within the run's intervals.

        A flat trunk is as near to what no body can be as the intervals are wide: half of all runs would miss it.

        Args:
            vector: mass, first moment and inertia about the origin, in Pinocchio's order.
            what: the body, for messages.
            remedy: words that say what to do where there is none.

        Returns:
            the body; and what is to be said of it.

        Raises:
            NotEstimatedError: its mass is none, or no body near enough can have it and that is not overridden.
        """
        if not vector[0] > 0:
            raise NotEstimatedError(f"{what} would have a mass of {vector[0]:.6g} kg; {remedy}")
        body = InertialParameters.from_vector(vector)
        if (defect := body.physical_defect()) is None:
            return body, ()
        nearest = InertialParameters(body.mass, body.com, physical_inertia(body.inertia, body.mass, _FLATTEST))
        change = nearest.inertia - body.inertia
        if not (within := self.within_intervals(change)) and not self.forced:
            raise NotEstimatedError(
                f"{what} is no body: {defect}, and the nearest one that is lies beyond the intervals: {remedy}, or write that "
                "one with --force"
            )
        how = "within the intervals" if within else "FORCED, beyond the intervals"
        moments = ", ".join(f"{value:+.3g}" for value in change.diagonal())
        return nearest, (
            f"{how}: {what} is no body ({defect}); its inertia is the nearest that one can have, Ixx, Iyy, Izz off by "
            f"{moments} kg m2; its mass and place are those found",
        )

    def added_to(self, composite: InertialParameters) -> FloatArray:
        """(10,) what the robot that was found has more than one with this composite; Pinocchio's order, about the origin."""
        return self.composite.vector - composite.vector

    def within_intervals(self, change: FloatArray) -> bool:
        """Return whether a change of the inertia [kg m2] (3, 3) is within the 95 % intervals of the whole robot's."""
        return bool((np.abs(change) <= NORMAL_95 * self.result.composite.inertia.stds).all())  # nan: none given

    @property
    def base_link(self) -> str:
        """Its name in the model."""
        return self.result.model["base_link"]

    @property
    def file_link(self) -> str:
        """The base link's name in the model file: another one where another axis than x points forward there."""
        return self._in_file[0]

    def in_file(self, body: InertialParameters) -> InertialParameters:
        """A body of the base frame in the axes of the model file's base link."""
        return seen_from(body, self._in_file[1])

    @property
    def base_in_file(self) -> InertialParameters:
        """`base`, for who reads the model file."""
        return self.in_file(self.base)

    @property
    def _in_file(self) -> tuple[str, pin.SE3]:
        return link_in_file(self.base_link, cast(Forward, self.result.model["forward"]))

    @property
    def stance(self) -> str:
        """Joint positions in words [rad]."""
        joints = [*self.result.joint_position.items(), *self.result.locked_joints.items()]
        return ", ".join(f"{name} {round(q, 6) + 0.0:g}" for name, q in joints)

    def header(self, about: str, *notes: str) -> tuple[str, ...]:
        """Return the lines that every file begins with, a sentence a line.

        Args:
            about: words for the body or the parts that are written.
            notes: further objections to the numbers.
        """
        result = self.result
        time = result.provenance.get("time")
        made = ", ".join([result.robot, f"method {result.method}", *([str(time)] if time else [])])
        origin = f"run {self.run} ({made})" if self.run else f"a calibration in memory ({made})"
        model = result.model
        lines = (
            f"equipoise {__version__}: {about}",
            self.contents,
            f"from {origin}",
            f"stance [rad]: {self.stance}",
            f"model: {model['format']}, sha256 {model['sha256']}",
            *notes,
            *self.notes,
        )
        return tuple(map(_one_line, lines))

    def comment(self, about: str, mark: str = "# ") -> list[str]:
        """The header as comments of one line."""
        return [mark + line for line in self.header(about)]

    def column(self, name: str) -> dict[str, float]:
        """Numbers of one kind that are written, by joint or axis; none, if there is nothing to write of it."""
        found = [column for column in self.columns if column.name == name]
        return {key: column.number(key) for column in found for key in column.values}

    @property
    def joints(self) -> list[str]:
        """Joints that something is written of, in the model's order."""
        told = {key for column in self.columns for key in column.values}
        return [joint for joint in self.result.joint_position if joint in told]

    @property
    def columns_words(self) -> str:
        """About sensors, motors and legs."""
        parts = " and ".join(dict.fromkeys(column.part for column in self.columns))
        return f"{parts} as found; torques in the unit in which the motors report them on average"

    @property
    def base_words(self) -> str:
        """About the base."""
        return _BASE_WORDS.format(self.base_link)

    @property
    def words_in_file(self) -> str:
        """About `base_in_file`."""
        return _BASE_WORDS.format(self.file_link)


def seen_from(body: InertialParameters, placement: pin.SE3) -> InertialParameters:
    """A body in another frame's axes, about the same CoM.

    Args:
        placement: placement of that frame in the one that the body is given in.
    """
    rotation = np.array(placement.rotation)
    com = rotation.T @ (body.com - np.array(placement.translation))
    return InertialParameters(body.mass, com, rotation.T @ body.inertia @ rotation)


def _one_line(text: str) -> str:
    """Return a text as a comment of one line may hold it; names of robots and files may hold anything."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def number(value: float) -> str:
    """The shortest text that reads as the same number, without a negative zero."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float]) -> str:
    """Several, with spaces."""
    return " ".join(number(value) for value in values)


def products(inertia: FloatArray) -> dict[str, float]:
    """ixx, ixy, ixz, iyy, iyz, izz of a tensor."""
    return {f"i{'xyz'[row]}{'xyz'[column]}": float(inertia[row, column]) for row, column in _PRODUCTS}
