"""Audit of a model file: the inertias in it, and findings about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from equipoise.errors import ReachError
from equipoise.json_form import to_json
from equipoise.robot.bodies import RigidBody, bodies_of, links_of
from equipoise.robot.findings import ModelFinding, find
from equipoise.robot.imu import ImuPose
from equipoise.robot.inertial import InertialParameters, base_parameters, nominal_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance

_WRITTEN = (
    "robot", "mass", "base_link", "composite", "base", "stance_effective", "ratio_composite_over_base", "bodies",
    "findings", "imu",
)  # fmt: skip
"""Fields and properties in the JSON form, in this order; the stance follows."""


@dataclass(frozen=True, eq=False)
class Audit:
    """Inertias of a model file, and findings about them.

    Attributes:
        robot: name of the robot.
        mass: mass of the whole robot [kg].
        base_link: name of the base link.
        base: inertial parameters of the base link with everything fixed to it, in the base frame.
        composite: inertial parameters of the whole robot frozen at the nominal stance, in the base frame; None without
            a stance.
        stance_effective: inertial parameters of base, hips and thighs at the nominal stance; None without a stance.
        stance: the nominal stance, or None; a finding gives the reason.
        joint_names: (nj) names of the stance's joint positions.
        bodies: the base, then the leg links in joint order.
        findings: findings about the model, errors first.
        imu: pose of the IMU, and its source.
    """

    robot: str
    mass: float
    base_link: str
    base: InertialParameters
    composite: InertialParameters | None
    stance_effective: InertialParameters | None
    stance: Stance | None
    joint_names: tuple[str, ...]
    bodies: tuple[RigidBody, ...]
    findings: tuple[ModelFinding, ...]
    imu: ImuPose

    @property
    def ratio_composite_over_base(self) -> tuple[float, float, float] | None:
        """Ixx, Iyy and Izz of the composite over the base's, each about its own CoM; None without a stance or inertia."""
        moments = self.base.inertia.diagonal()
        if self.composite is None or moments.min() <= 0:
            return None
        x, y, z = (float(value) for value in self.composite.inertia.diagonal() / moments)
        return x, y, z

    @property
    def ratio_message(self) -> str | None:
        """Statement of the factors from the base inertia to the composite one."""
        ratio = self.ratio_composite_over_base
        if ratio is None:
            return None
        x, y, z = ratio
        return f"the composite's Ixx, Iyy, Izz are {x:.1f}, {y:.1f} and {z:.1f} x the base's (link {self.base_link!r})"

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form; null without a stance."""
        table = {name: to_json(getattr(self, name)) for name in _WRITTEN}
        if self.stance is None:
            return {**table, "stance": None}
        position = dict(zip(self.joint_names, self.stance.joint_position.tolist(), strict=True))
        return {**table, "stance": {"joint_position": position, "hip_height": self.stance.hip_height}}


def audit(robot: RobotModel) -> Audit:
    """Check the inertias of a model: unphysical ones, placeholders, and left against right.

    Front and rear legs may differ; many robots' do.

    Raises:
        SettingsError: the robot configuration gives a stance that cannot be used.
    """
    stance, without_stance = None, list[ModelFinding]()
    try:
        stance = nominal_stance(robot)
    except ReachError as error:
        text = f"it has no nominal stance, so its composite inertia is unknown: {error}"
        without_stance.append(ModelFinding("error", "", text))
    inertia = None if stance is None else nominal_inertia(robot, stance.joint_position)
    composite = None if inertia is None else inertia.composite
    bodies = bodies_of(robot)
    return Audit(
        robot=robot.name,
        mass=robot.mass,
        base_link=robot.base_link,
        base=base_parameters(robot),
        composite=composite,
        stance_effective=None if inertia is None else inertia.stance_effective,
        stance=stance,
        joint_names=robot.joint_names,
        bodies=tuple(bodies.values()),
        findings=(*without_stance, *find(robot, bodies, list(links_of(robot, bodies)), composite, stance)),
        imu=robot.imu,
    )
