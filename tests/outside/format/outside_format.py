"""Format of a consumer that reads one number."""

from equipoise import Format, Subject, Written


def write(subject: Subject) -> Written:
    """Write the mass, and the header below it."""
    about = "whole robot frozen at its stance"
    return Written.text([f"{subject.composite.mass:.3f}", *subject.header(about)], about)


FORMAT = Format(
    "kilograms", ("composite",), "", False, "a scale's display", "mass.txt", write,
    lacks=("composite CoM", "composite inertia"),
)  # fmt: skip
