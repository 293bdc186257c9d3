"""Fixtures that many tests share."""

from pathlib import Path

import pytest
from hypothesis import settings

import equipoise
from equipoise import load_robot

# A loaded machine is slow now and then, and the same commit passes or fails always.
settings.register_profile("equipoise", deadline=None, derandomize=True)
settings.load_profile("equipoise")


@pytest.fixture(scope="session")
def a1():
    """The built-in Unitree A1."""
    return load_robot("unitree_a1")


@pytest.fixture(scope="session")
def a1_urdf():
    """Text of the built-in A1's URDF."""
    return (Path(equipoise.__file__).parent / "robot" / "models" / "a1.urdf").read_text(encoding="utf-8")
