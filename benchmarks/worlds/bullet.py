"""A quadruped in PyBullet, with the errors that the package draws of sensors, legs and joint friction.

It is not part of the package, which has never been tuned on it.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.leg_errors import in_frame_of_hips
from equipoise.simulation.payload import Payload
from worlds.torque_driven import TIMESTEP, TorqueDriven
from worlds.urdf import urdf


class BulletPlatform(TorqueDriven):
    """Spherical feet on a plane, with the engine's contacts; rotors without inertia."""

    def __init__(self, robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None) -> None:
        self._engine = pybullet.connect(pybullet.DIRECT)
        self._in = {"physicsClientId": self._engine}
        pybullet.setGravity(*(GRAVITY * errors.gravity_direction), **self._in)
        pybullet.setTimeStep(TIMESTEP, **self._in)
        pybullet.setPhysicsEngineParameter(numSolverIterations=50, **self._in)
        floor = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **self._in)
        plane = pybullet.createMultiBody(0, floor, **self._in)
        with TemporaryDirectory() as folder:
            file = Path(folder, "robot.urdf")
            root = urdf(robot, stance, errors, payload)
            ElementTree.indent(root)  # the engine cannot read long lines
            file.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            self._body = pybullet.loadURDF(str(file), [0, 0, stance.base_height], flags=flags, **self._in)
        self._links = pybullet.getNumJoints(self._body, **self._in)
        names = [pybullet.getJointInfo(self._body, j, **self._in)[1].decode() for j in range(self._links)]
        self._order = [names.index(name) for name in robot.joint_names]
        for link in range(-1, self._links):
            quiet = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
            pybullet.changeDynamics(self._body, link, lateralFriction=1.0, **quiet, **self._in)
        pybullet.changeDynamics(plane, -1, lateralFriction=errors.floor_friction, **self._in)
        pybullet.setJointMotorControlArray(
            self._body, self._order, pybullet.VELOCITY_CONTROL, forces=[0] * len(self._order), **self._in
        )
        of_base = pybullet.getDynamicsInfo(self._body, -1, **self._in)
        self._base_com, self._base_axes = np.array(of_base[3]), Rotation.from_quat(of_base[4])
        super().__init__(robot, stance, errors)

    def close(self) -> None:
        super().close()
        if pybullet.isConnected(self._engine):
            pybullet.disconnect(self._engine)

    def truth(self, joint_position: FloatArray) -> InertialParameters:
        before = self._saved()
        self._place(joint_position, 0.0)
        links = pybullet.getLinkStates(self._body, range(self._links), computeForwardKinematics=True, **self._in)
        poses = [(self._base_com, self._base_axes)]
        poses += [(np.array(state[0]), Rotation.from_quat(state[1])) for state in links]
        total, moment, about = 0.0, np.zeros(3), np.zeros((3, 3))
        for link, (com, axes) in enumerate(poses, start=-1):
            mass, _, diagonal = pybullet.getDynamicsInfo(self._body, link, **self._in)[:3]
            turned = axes.as_matrix()
            total, moment = total + mass, moment + mass * com
            about += turned @ np.diag(diagonal) @ turned.T + mass * (com @ com * np.eye(3) - np.outer(com, com))
        self._restore(before)
        com = moment / total
        body = InertialParameters(total, com, about - total * (com @ com * np.eye(3) - np.outer(com, com)))
        return in_frame_of_hips(body, self._errors)

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        at = np.array([0, 0, base_height]) + self._base_com
        pybullet.resetBasePositionAndOrientation(self._body, at, self._base_axes.as_quat(), **self._in)
        pybullet.resetBaseVelocity(self._body, [0, 0, 0], [0, 0, 0], **self._in)
        for joint, value in zip(self._order, joint_position, strict=True):
            pybullet.resetJointState(self._body, joint, float(value), 0.0, **self._in)

    def _base(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        _, turned = pybullet.getBasePositionAndOrientation(self._body, **self._in)
        velocity, turning = map(np.array, pybullet.getBaseVelocity(self._body, **self._in))
        rotation = (Rotation.from_quat(turned) * self._base_axes.inv()).as_matrix()
        return rotation, turning, velocity - np.cross(turning, rotation @ self._base_com)

    def _joints(self) -> tuple[FloatArray, FloatArray]:
        states = pybullet.getJointStates(self._body, self._order, **self._in)
        return np.array([state[0] for state in states]), np.array([state[1] for state in states])

    def _drive(self, torque: FloatArray) -> None:
        pybullet.setJointMotorControlArray(
            self._body, self._order, pybullet.TORQUE_CONTROL, forces=torque.tolist(), **self._in
        )
        pybullet.stepSimulation(**self._in)

    def _saved(self) -> object:
        return pybullet.saveState(**self._in)

    def _restore(self, state: object) -> None:
        pybullet.restoreState(state, **self._in)
        pybullet.removeState(state, **self._in)
