"""A quadruped in Drake: hydroelastic contact of its feet, solver SAP.

It is not part of the package, which has never been tuned on it.
"""

from __future__ import annotations

from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import AddContactMaterial, AddRigidHydroelasticProperties, HalfSpace, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.leg_errors import in_frame_of_hips
from equipoise.simulation.payload import Payload
from worlds.torque_driven import TIMESTEP, TorqueDriven
from worlds.urdf import urdf

_OF_FEET = {"hydroelastic_modulus": 1e8, "mesh_resolution_hint": 5e-3, "hunt_crossley_dissipation": 1.0}  # Pa, m, s/m


class DrakePlatform(TorqueDriven):
    """Compliant spherical feet on a rigid plane; rotors with their inertia."""

    LACKS: ClassVar[tuple[str, ...]] = tuple(name for name in TorqueDriven.LACKS if name != "armature")

    def __init__(self, robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=TIMESTEP,
            contact_model="hydroelastic",
            discrete_contact_approximation="sap",
            use_sampled_output_ports=False,
        )
        plant, _ = AddMultibodyPlant(config, builder)
        root = urdf(robot, stance, errors, payload)
        friction = {"mu_dynamic": errors.floor_friction, "mu_static": errors.floor_friction}
        for collision in root.iter("collision"):
            properties = ElementTree.SubElement(collision, "drake:proximity_properties")
            ElementTree.SubElement(properties, "drake:compliant_hydroelastic")
            for name, value in (_OF_FEET | friction).items():
                ElementTree.SubElement(properties, f"drake:{name}", value=repr(float(value)))
        (self._model,) = Parser(plant).AddModelsFromString(ElementTree.tostring(root, encoding="unicode"), "urdf")
        floor = ProximityProperties()
        AddRigidHydroelasticProperties(floor)
        AddContactMaterial(friction=CoulombFriction(errors.floor_friction, errors.floor_friction), properties=floor)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", floor)
        plant.mutable_gravity_field().set_gravity_vector(GRAVITY * errors.gravity_direction)
        joints = [plant.GetJointByName(name) for name in robot.joint_names]
        for joint in joints:
            plant.AddJointActuator(joint.name(), joint).set_default_rotor_inertia(errors.sizes.armature)
        plant.Finalize()
        self._plant, self._diagram = plant, builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._in = plant.GetMyMutableContextFromRoot(self._context)
        self._trunk = plant.GetBodyByName("base")
        self._positions = [joint.position_start() for joint in joints]
        self._velocities = [joint.velocity_start() for joint in joints]
        super().__init__(robot, stance, errors)

    def truth(self, joint_position: FloatArray) -> InertialParameters:
        before = self._saved()
        self._place(joint_position, 0.0)
        bodies = self._plant.GetBodyIndices(self._model)
        inertia = self._plant.CalcSpatialInertia(self._in, self._trunk.body_frame(), bodies)
        self._restore(before)
        com = np.array(inertia.get_com())
        about_com = inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
        return in_frame_of_hips(InertialParameters(inertia.get_mass(), com, about_com), self._errors)

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        position = np.array(self._plant.GetPositions(self._in))
        position[self._positions] = joint_position
        self._plant.SetPositions(self._in, position)
        self._plant.SetFreeBodyPose(self._in, self._trunk, RigidTransform([0, 0, base_height]))
        self._plant.SetVelocities(self._in, np.zeros(self._plant.num_velocities()))

    def _joints(self) -> tuple[FloatArray, FloatArray]:
        position, velocity = self._plant.GetPositions(self._in), self._plant.GetVelocities(self._in)
        return position[self._positions], velocity[self._velocities]

    def _base(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        velocity = self._trunk.EvalSpatialVelocityInWorld(self._in)
        rotation = self._trunk.EvalPoseInWorld(self._in).rotation().matrix()
        return rotation, velocity.rotational(), velocity.translational()

    def _drive(self, torque: FloatArray) -> None:
        self._plant.get_actuation_input_port().FixValue(self._in, torque)
        self._context.SetDiscreteState(self._diagram.EvalUniquePeriodicDiscreteUpdate(self._context))

    def _saved(self) -> FloatArray:
        return np.array(self._plant.GetPositionsAndVelocities(self._in))

    def _restore(self, state: FloatArray) -> None:
        self._plant.SetPositionsAndVelocities(self._in, state)
