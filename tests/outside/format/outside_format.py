"""A consumer that wants one number."""

from equipoise import Format, Subject, Written


def write(subject: Subject) -> Written:
    """The mass, and below it what is said of it."""
    about = "whole robot frozen at its stance"
    return Written.text([f"{subject.composite.mass:.3f}", *subject.header(about)], about)


FORMAT = Format(
    "kilograms", ("composite",), "", False, "a scale's display", "mass.txt", write,
    lacks=("composite CoM", "composite inertia"),
)  # fmt: skip
