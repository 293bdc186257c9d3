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
from equipoise.robot.inertial import InertialParameters, components
from equipoise.robot.model import RobotModel

PAYLOAD = "equipoise_payload"
"""Name of the link that `--add-payload-link` writes."""
COMPOSITE_WORDS = "composite: the whole robot frozen at the stance"
_BASE_WORDS = (
    "base link {!r} with all links fixed to it or locked; with the model's legs it makes the estimated composite"
)
_FLATTEST = 1e-3  # least second moment of mass of the nearest physical body, over its largest
_PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class UsersFile:
    """User's file that is edited."""

    path: Path
    content: bytes


@dataclass(frozen=True)
class Written:
    """Content of a file, and words for the body or the parts that it holds."""

    content: bytes
    about: str
    notes: tuple[str, ...] = ()  # objections that arise while writing

    @classmethod
    def text(cls, lines: list[str], about: str, notes: tuple[str, ...] = ()) -> Written:
        """Return the content from lines of text."""
        return cls(("\n".join(lines) + "\n").encode(), about, notes)


@dataclass(frozen=True, eq=False)
class Subject:
    """Input of a writer.

    Attributes:
        result: result of the calibration.
        run: name of the run, as the user gave it; empty for a result in memory.
        file: user's own file, if there is one.
        payload_link: whether the payload is a separate link.
        samples: number of bodies to draw and list.
        seed: seed of all random draws.
        notes: objections to the numbers, worst first.
        forced: whether to write the nearest physical body if the estimate is not physical.
        parts: parts of the result to write, of "base", "sensors", "motors" and "legs".
        columns: columns of sensors, motors and legs to write.
        contents: sentence that states which of mass, CoM and inertia is written, in which frame, and what is left out.
        reference: other model of the robot, from which the base's difference is written.
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
    reference: RobotModel | None = None

    @property
    def composite(self) -> InertialParameters:
        """The whole robot frozen at the stance, in the base frame."""
        return self.result.composite.parameters()

    @property
    def base(self) -> InertialParameters:
        """The base link with all links fixed to it or locked.

        With the model's own legs it makes the estimated composite, which a run determines best. The calibration's own base
        belongs to adjusted legs, which a file that gets the base alone does not have.
        """
        return self.base_and_notes[0]

    @cached_property
    def base_and_notes(self) -> tuple[InertialParameters, tuple[str, ...]]:
        """The base, and notes on it."""
        what = f"base link {self.base_link!r}, minus the model's legs,"
        remedy = "check the masses of the model's legs with 'equipoise audit'"
        return self.nearest_body(self.result.base_for_model_legs, what, remedy)

    def nearest_body(self, vector: FloatArray, what: str, remedy: str) -> tuple[InertialParameters, tuple[str, ...]]:
        """Return a body of (10,) parameters, or, if its inertia is not physical, the nearest within the run's intervals.

        A flat trunk is so close to the physical limit that half of all estimates lie beyond it.

        Args:
            vector: mass, first moment and inertia about the origin, in Pinocchio's order.
            what: name of the body, for messages.
            remedy: remedy, for messages.

        Returns:
            the body; and notes on it.

        Raises:
            NotEstimatedError: its mass is not positive, or no physical body is near enough and `forced` is false.
        """
        if not vector[0] > 0:
            raise NotEstimatedError(f"{what} would have a mass of {vector[0]:.6g} kg; {remedy}")
        body = InertialParameters.from_vector(vector)
        if (defect := body.physical_defect()) is None:
            return body, ()
        nearest = InertialParameters(body.mass, body.com, physical_inertia(body.inertia, body.mass, _FLATTEST))
        change = nearest.inertia - body.inertia
        half_widths = NORMAL_95 * self.result.composite.inertia.stds
        within = bool((np.abs(change) <= half_widths).all())  # nan: no interval
        if not within and not self.forced:
            raise NotEstimatedError(
                f"{what} is not physical: {defect}, and the nearest physical body lies beyond the intervals: {remedy}, or "
                "write that body with --force"
            )
        prefix = "within the intervals" if within else "FORCED, beyond the intervals"
        moments = ", ".join(f"{value:+.3g}" for value in change.diagonal())
        return nearest, (
            f"{prefix}: {what} is not physical ({defect}); its inertia is the nearest physical one, Ixx, Iyy, Izz changed by "
            f"{moments} kg m2; its mass and CoM are as estimated",
        )

    def covariance_seen_from(self, placement: pin.SE3) -> FloatArray:
        """Return the (10, 10) covariance of the composite in other axes at the base's origin, in the order of COMPONENTS.

        Args:
            placement: placement of these axes in the base frame; its translation is zero.

        Raises:
            NotEstimatedError: the method computes no covariance.
        """
        covariance = self.result.composite.covariance
        if covariance is None:
            raise NotEstimatedError("this calibration has no covariance; calibrate with --method bayesian")
        units = (InertialParameters.from_components(one) for one in np.eye(10))
        turn = np.column_stack([components(seen_from(one, placement)) for one in units])
        return turn @ covariance @ turn.T

    @property
    def base_link(self) -> str:
        """Name of the base link in the model."""
        return self.result.model["base_link"]

    @property
    def file_link(self) -> str:
        """Name of the base link in the model file; it differs if another axis than x points forward there."""
        return self._in_file[0]

    def in_file(self, body: InertialParameters) -> InertialParameters:
        """Return a body of the base frame in the axes of the model file's base link."""
        return seen_from(body, self.file_placement)

    @property
    def file_placement(self) -> pin.SE3:
        """Placement of the model file's base link in the base frame: a rotation."""
        return self._in_file[1]

    @property
    def base_in_file(self) -> InertialParameters:
        """`base` in the axes of the model file."""
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
        """Return the first lines of every file, one sentence per line.

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

    def text(self, about: str, lines: Iterable[str], notes: tuple[str, ...] = (), mark: str = "# ") -> Written:
        """Return a file of lines of text, after the header as comments of one line."""
        return Written.text([*(mark + line for line in self.header(about, *notes)), *lines], about, notes)

    def column(self, name: str) -> dict[str, float]:
        """Return the written numbers of one kind, by joint or axis; empty if there are none."""
        found = [column for column in self.columns if column.name == name]
        return {key: column.number(key) for column in found for key in column.values}

    @property
    def joints(self) -> list[str]:
        """Joints with a written value, in the model's order."""
        written = {key for column in self.columns for key in column.values}
        return [joint for joint in self.result.joint_position if joint in written]

    @property
    def columns_words(self) -> str:
        """Words for the written columns."""
        parts = " and ".join(dict.fromkeys(column.part for column in self.columns))
        return f"{parts} as estimated; torques in the motors' mean reported unit"

    @property
    def base_words(self) -> str:
        """Words for `base`."""
        return _BASE_WORDS.format(self.base_link)

    @property
    def words_in_file(self) -> str:
        """Words for `base_in_file`."""
        return _BASE_WORDS.format(self.file_link)


def seen_from(body: InertialParameters, placement: pin.SE3) -> InertialParameters:
    """Return a body in another frame's axes, about the same CoM.

    Args:
        placement: placement of that frame in the body's frame.
    """
    return InertialParameters.from_pinocchio(placement.inverse().act(body.to_pinocchio()))


def _one_line(text: str) -> str:
    """Return a text on one line, without unprintable characters, which names of robots and files may hold."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def number(value: float) -> str:
    """Return the shortest text that reads as the same number, without a negative zero."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float]) -> str:
    """Return several numbers, separated by spaces."""
    return " ".join(number(value) for value in values)


def products(inertia: FloatArray) -> dict[str, float]:
    """Return ixx, ixy, ixz, iyy, iyz, izz of a tensor."""
    return {f"i{'xyz'[row]}{'xyz'[column]}": float(inertia[row, column]) for row, column in _PRODUCTS}
