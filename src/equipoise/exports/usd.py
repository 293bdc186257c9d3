"""The user's own USD, for Isaac Sim and Isaac Lab, with the base's mass properties, and joints' armature and friction.

Edits go into the file's root layer, which overrides the files that it composes. Numbers are in the stage's units. Angles are
in degrees there, so viscous friction is torque per degree per second.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from equipoise.errors import MissingDependencyError, ModelError, SettingsError
from equipoise.exports.parameters import BASE
from equipoise.exports.subject import FloatArray, Subject, Written
from equipoise.robot.inertial import InertialParameters

_SCALED = 1e-4  # tolerance of a body's scale to one: files are in single precision
_AXIS = "PhysxJointAxisAPI:angular"
_PREFIX = "physxJointAxis:angular:"
_JOINTS = "joints' armature and friction (PhysX schema) as estimated, torques in the motors' reported unit"


@dataclass(frozen=True)
class _Stage:
    """Stage that is read, and a copy of its root layer that is edited.

    Attributes:
        usd: modules of usd-core.
        path: path of the user's file.
        read: stage, with all files that it composes.
        layer: layer that is edited.
        length: metres per length unit of the stage.
        mass: kilograms per mass unit of the stage.
    """

    usd: Any
    path: Path
    read: Any
    layer: Any
    length: float
    mass: float

    @property
    def inertia(self) -> float:
        """Kilogram metres squared, or newton metres, per unit of the stage."""
        return self.mass * self.length**2

    def set(self, prim: Any, name: str, kind: str, value: Any) -> None:
        """Set a prim's attribute."""
        spec = self.usd.Sdf.CreatePrimInLayer(self.layer, prim.GetPath())
        attribute = spec.attributes.get(name)
        if attribute is None:
            attribute = self.usd.Sdf.AttributeSpec(spec, name, getattr(self.usd.Sdf.ValueTypeNames, kind))
        attribute.default = value

    def apply(self, prim: Any, schema: str) -> None:
        """Apply a schema to a prim that does not have it."""
        if schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            return
        spec = self.usd.Sdf.CreatePrimInLayer(self.layer, prim.GetPath())
        schemas = spec.GetInfo("apiSchemas") if spec.HasInfo("apiSchemas") else self.usd.Sdf.TokenListOp()
        if schemas.isExplicit:
            schemas.explicitItems = [*schemas.explicitItems, schema]
        else:
            schemas.prependedItems = [*schemas.prependedItems, schema]
        spec.SetInfo("apiSchemas", schemas)

    def annotate(self, prim: Any, lines: tuple[str, ...]) -> None:
        """Write a comment at a prim, in place of an earlier one."""
        spec = self.usd.Sdf.CreatePrimInLayer(self.layer, prim.GetPath())
        spec.SetInfo("customData", {**dict(spec.customData), "equipoise": "\n".join(lines)})

    def content(self, binary: bool) -> bytes:
        """Return the edited file, in its original format."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / self.path.name
            arguments = {"format": "usdc" if binary else "usda"} if self.path.suffix == ".usd" else {}
            self.layer.Export(str(file), args=arguments)
            return file.read_bytes()


def write(subject: Subject) -> Written:
    """Write the file with other mass properties of the base, other joints, or both."""
    if subject.file is None:
        raise SettingsError("format usd edits your own stage: name it with --file robot.usd")
    stage = _open(subject.file.path)
    base = _base(stage, subject.file_link)
    words = [subject.words_in_file] if BASE in subject.parts else []
    words += [_JOINTS] if subject.columns else []
    about = "; ".join(words)
    if BASE in subject.parts:
        _refuse_fixed_bodies(stage, base, set(subject.result.locked_joints))
        _set_body(stage, base, subject.base_in_file)
    for name in subject.joints:
        _set_joint(stage, _joint(stage, name), {key: subject.column(key).get(name) for key in _OF_JOINTS})
    notes = _composed(stage)
    stage.annotate(base, subject.header(about, *notes))
    return Written(stage.content(subject.file.content.startswith(b"PXR-USDC")), about, notes)


def _open(path: Path) -> _Stage:
    try:
        names = ("Sdf", "Tf", "Usd", "UsdGeom", "UsdPhysics", "Gf")
        usd: Any = SimpleNamespace(**{name: import_module(f"pxr.{name}") for name in names})
    except ImportError as error:
        raise MissingDependencyError("USD needs usd-core: pip install 'equipoise[usd]'") from error
    if path.suffix not in (".usd", ".usda", ".usdc"):
        raise ModelError(f"{str(path)!r} must end in .usd, .usda or .usdc; unpack a .usdz first")
    try:
        stage, layer = usd.Usd.Stage.Open(str(path)), usd.Sdf.Layer.OpenAsAnonymous(str(path))
    except usd.Tf.ErrorException as error:
        raise ModelError(f"{str(path)!r} is not valid USD: {_words_of(error)}") from error
    length, mass = usd.UsdGeom.GetStageMetersPerUnit(stage), usd.UsdPhysics.GetStageKilogramsPerUnit(stage)
    return _Stage(usd, path, stage, layer, length, mass)


def _words_of(error: Exception) -> str:
    """Return the message of usd-core without its source location."""
    return str(error).strip().splitlines()[-1].rpartition(" : ")[2].strip("' \t")


def _base(stage: _Stage, name: str) -> Any:
    """Return the rigid body of that name, whose frame is the link's."""
    bodies = [prim for prim in stage.read.Traverse() if prim.HasAPI(stage.usd.UsdPhysics.RigidBodyAPI)]
    found = [prim for prim in bodies if prim.GetName() == name]
    if len(found) != 1:
        names = ", ".join(prim.GetName() for prim in bodies) or "none"
        raise ModelError(f"{str(stage.path)!r} has {len(found)} rigid bodies called {name!r}; it has {names}")
    placement = stage.usd.UsdGeom.Xformable(found[0]).ComputeLocalToWorldTransform(0)
    scales = np.linalg.norm(np.array(placement)[:3, :3], axis=1)
    if np.abs(scales - 1.0).max() > _SCALED:
        raise ModelError(
            f"{str(stage.path)!r} scales {name!r} by {scales.round(6).tolist()}; it must be 1 for its masses to apply"
        )
    return found[0]


def _refuse_fixed_bodies(stage: _Stage, base: Any, locked: set[str]) -> None:
    """Raise ModelError for bodies that are fixed to the base or behind locked joints, which would be counted twice.

    Args:
        locked: names of the locked joints.
    """
    for prim in stage.read.Traverse():
        if prim.IsA(stage.usd.UsdPhysics.Joint) and prim.GetName() in locked:
            raise ModelError(
                f"{str(stage.path)!r} has joint {prim.GetName()!r}, which was locked: the bodies behind it are part of the "
                "estimated base and would be counted twice; export a URDF or MJCF and import that"
            )
        if not prim.IsA(stage.usd.UsdPhysics.FixedJoint):
            continue
        joint = stage.usd.UsdPhysics.Joint(prim)
        ends = {*joint.GetBody0Rel().GetTargets(), *joint.GetBody1Rel().GetTargets()}
        if len(ends) == 2 and base.GetPath() in ends:
            raise ModelError(
                f"{str(stage.path)!r} fixes bodies to {base.GetName()!r} (joint {prim.GetName()!r}), whose masses would be "
                "counted twice: import the robot with merge_fixed_joints"
            )


def _set_body(stage: _Stage, prim: Any, body: InertialParameters) -> None:
    """Set mass, CoM, and inertia by its principal axes, of a body in the prim's frame."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, for this format alone

    moments, axes = _principal(body.inertia)
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    stage.apply(prim, "PhysicsMassAPI")
    stage.set(prim, "physics:mass", "Float", body.mass / stage.mass)
    stage.set(prim, "physics:centerOfMass", "Point3f", stage.usd.Gf.Vec3f(*map(float, body.com / stage.length)))
    stage.set(prim, "physics:diagonalInertia", "Float3", stage.usd.Gf.Vec3f(*map(float, moments / stage.inertia)))
    stage.set(prim, "physics:principalAxes", "Quatf", stage.usd.Gf.Quatf(float(w), float(x), float(y), float(z)))


def _principal(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (3,) principal moments, and (3, 3) their axes as columns, right-handed."""
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return moments, axes


def _joint(stage: _Stage, name: str) -> Any:
    found = [p for p in stage.read.Traverse() if p.IsA(stage.usd.UsdPhysics.RevoluteJoint) and p.GetName() == name]
    if len(found) != 1:
        raise ModelError(f"{str(stage.path)!r} has {len(found)} revolute joints called {name!r}; it must have one")
    return found[0]


_OF_JOINTS = ("armature", "coulomb_friction", "stribeck_friction", "viscous_friction")


def _set_joint(stage: _Stage, prim: Any, found: dict[str, float | None]) -> None:
    values = {key: max(0.0, value) / stage.inertia for key, value in found.items() if value is not None}
    if not values:
        return
    stage.apply(prim, _AXIS)
    if "armature" in values:
        stage.set(prim, f"{_PREFIX}armature", "Float", values["armature"])
    if "coulomb_friction" in values:
        at_rest = values["coulomb_friction"] + values.get("stribeck_friction", 0.0)
        stage.set(prim, f"{_PREFIX}staticFrictionEffort", "Float", at_rest)
        stage.set(prim, f"{_PREFIX}dynamicFrictionEffort", "Float", values["coulomb_friction"])
    if "viscous_friction" in values:
        per_degree = math.radians(values["viscous_friction"])
        stage.set(prim, f"{_PREFIX}viscousFrictionCoefficient", "Float", per_degree)


def _composed(stage: _Stage) -> tuple[str, ...]:
    """Return a note on the other files that the file needs in its folder."""
    others = sorted(stage.layer.GetCompositionAssetDependencies())
    if not others:
        return ()
    return (f"{stage.path.name} is composed of {', '.join(others)}: write the output to the same folder with --out",)
