"""Candidates of a robot that equals its model, cached on disk because they take half the planning time.

The file name is a hash of all inputs: the model, its robot configuration, the priors, and the code.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
from functools import lru_cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

import equipoise
from equipoise._version import __version__
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.bayesian.predict import Predictor
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors
from equipoise.json_form import from_json
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import nominal_stance
from equipoise.user_cache import keep_cached, read_cached

_FORMAT = "equipoise.candidates/1"
_PACKAGES = ("robot", "experiments", "bayesian")  # whose code the candidates depend on


@lru_cache(maxsize=2)
def nominal_candidates(robot: RobotModel, priors: Priors, swings: bool = False) -> Candidates:
    """Return the candidates of a robot at its nominal stance; raises ReachError if no lift is possible."""
    name = f"candidates-{_key(robot, priors, swings)}.npz"
    empty = _empty(robot, priors, swings)
    content = read_cached(name)
    if content is not None and (found := _read(empty, content)) is not None:
        return found
    made = Candidates.of(robot, empty.predictor.stance, empty.predictor.com, priors, swings=swings)
    keep_cached(name, _written(made))
    return made


def _empty(robot: RobotModel, priors: Priors, swings: bool) -> Candidates:
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com
    return Candidates(Predictor(robot, stance, com), Unknowns(robot, stance, priors), swings=swings)


def _written(candidates: Candidates) -> bytes:
    file = io.BytesIO()
    content = {
        "format": _FORMAT,
        "lifts": [dataclasses.asdict(lift) for lift in candidates.lifts],
        "postures": [dataclasses.asdict(posture) for posture in candidates.postures],
        "left_out": candidates.left_out,
    }
    np.savez(
        file,
        designs=np.array(json.dumps(content)),
        counts=np.array([len(rows) for rows in candidates.rows]),
        rows=np.concatenate(candidates.rows),
    )
    return file.getvalue()


def _read(empty: Candidates, content: bytes) -> Candidates | None:
    """Return the stored candidates; None if the file is damaged."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            table: dict[str, Any] = json.loads(str(file["designs"]))
            counts, rows = file["counts"], np.asarray(file["rows"], dtype=float)
        lifts = [from_json(LiftDesign, lift) for lift in table["lifts"]]
        postures = [from_json(BodyPosture, posture) for posture in table["postures"]]
        whole = rows.shape == (counts.sum(), empty.unknowns.size) and len(counts) == len(lifts) + len(postures)
        if table["format"] != _FORMAT or not whole or not lifts or not np.isfinite(rows).all():
            return None
        parts = np.split(rows, np.cumsum(counts)[:-1])
        return dataclasses.replace(empty, lifts=lifts, postures=postures, rows=parts, left_out=list(table["left_out"]))
    except (OSError, EOFError, ValueError, KeyError, TypeError, AttributeError, BadZipFile):
        return None


def _key(robot: RobotModel, priors: Priors, swings: bool) -> str:
    """Return the hash of all inputs of the candidates."""
    model = (
        robot.source.xml,
        repr(robot.source.effort_limits),
        repr(robot.description),
        robot.pinocchio.saveToString(),
    )
    parts = (_FORMAT, __version__, _code(), *model, repr(priors), repr(swings))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def _code() -> str:
    """Return the hash of the code, which may change within a version."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((Path(equipoise.__file__).parent / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
