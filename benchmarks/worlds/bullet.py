"""A quadruped in PyBullet, with the errors that the package draws of sensors, legs and joint friction.

It is no part of the package, which has never been tuned on it.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pybullet
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import EffectSizes
from equipoise.simulation.leg_errors import in_frame_of_hips
from equipoise.simulation.payload import Payload
from equipoise.simulation.simulated import SimulatedPlatform
from worlds.urdf import urdf

_SLOW = 0.02  # [rad/s] below which joint friction holds
TIMESTEP = 1e-3  # [s]


class BulletPlatform(SimulatedPlatform):
    """Torque-controlled joints, PD at every engine step; spherical feet on a plane, contacts as the engine has them.

    Rotors have no inertia, and friction is smooth: the engine knows neither.
    """

    LACKS: ClassVar[tuple[str, ...]] = (
        "armature", "floor_slope", "cable", *(row.name for row in EffectSizes.rows() if row.engines == ("mujoco",)),
    )  # fmt: skip

    def __init__(self, robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None) -> None:
        self._engine = pybullet.connect(pybullet.DIRECT)
        engine = {"physicsClientId": self._engine}
        pybullet.setGravity(0, 0, -GRAVITY, **engine)
        pybullet.setTimeStep(TIMESTEP, **engine)
        pybullet.setPhysicsEngineParameter(numSolverIterations=50, **engine)
        floor = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **engine)
        plane = pybullet.createMultiBody(0, floor, **engine)
        with TemporaryDirectory() as folder:
            file = Path(folder, "robot.urdf")
            root = urdf(robot, stance, errors, payload)
            ElementTree.indent(root)  # the engine cannot read long lines
            file.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            self._body = pybullet.loadURDF(str(file), [0, 0, stance.base_height], flags=flags, **engine)
        names = [pybullet.getJointInfo(self._body, j, **engine)[1].decode() for j in range(self._links)]
        self._order = [names.index(name) for name in robot.joint_names]
        for link in range(-1, self._links):
            quiet = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
            pybullet.changeDynamics(self._body, link, lateralFriction=1.0, **quiet, **engine)
        pybullet.changeDynamics(plane, -1, lateralFriction=errors.floor_friction, **engine)
        pybullet.setJointMotorControlArray(
            self._body, self._order, pybullet.VELOCITY_CONTROL, forces=[0] * len(self._order), **engine
        )
        of_base = pybullet.getDynamicsInfo(self._body, -1, **engine)
        self._base_com, self._base_axes = np.array(of_base[3]), Rotation.from_quat(of_base[4])
        kp, kd = robot.gains(stance.hip_height)
        count = len(robot.joint_names)
        self._limit = np.array(robot.effort_limit)
        super().__init__(robot, errors, np.full(count, kp), np.full(count, kd), TIMESTEP, 2e-3)
        self._imu_rotation = np.array(robot.imu_in_base.rotation) @ np.array(pin.exp3(errors.imu_tilt))
        self._imu_position = np.array(robot.imu_in_base.translation)
        self._held = np.array(stance.joint_position)  # the targets that act
        self._settle(stance, "standing")

    @property
    def _links(self) -> int:
        return pybullet.getNumJoints(self._body, physicsClientId=self._engine)

    def close(self) -> None:
        super().close()
        if pybullet.isConnected(self._engine):
            pybullet.disconnect(self._engine)

    def truth(self, joint_position: FloatArray) -> InertialParameters:
        """The whole robot at (nj,) joint positions in the base frame, by what the engine says of its bodies."""
        before, engine = pybullet.saveState(physicsClientId=self._engine), {"physicsClientId": self._engine}
        self._place(joint_position, 0.0)
        links = pybullet.getLinkStates(self._body, range(self._links), computeForwardKinematics=True, **engine)
        poses = [(self._base_com, self._base_axes)]
        poses += [(np.array(state[0]), Rotation.from_quat(state[1])) for state in links]
        total, moment, about = 0.0, np.zeros(3), np.zeros((3, 3))
        for link, (com, axes) in enumerate(poses, start=-1):
            mass, _, diagonal = pybullet.getDynamicsInfo(self._body, link, **engine)[:3]
            turned = axes.as_matrix()
            total, moment = total + mass, moment + mass * com
            about += turned @ np.diag(diagonal) @ turned.T + mass * (com @ com * np.eye(3) - np.outer(com, com))
        pybullet.restoreState(before, **engine)
        com = moment / total
        body = InertialParameters(total, com, about - total * (com @ com * np.eye(3) - np.outer(com, com)))
        return in_frame_of_hips(body, self._errors)

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        engine = {"physicsClientId": self._engine}
        at = np.array([0, 0, base_height]) + self._base_com
        pybullet.resetBasePositionAndOrientation(self._body, at, self._base_axes.as_quat(), **engine)
        pybullet.resetBaseVelocity(self._body, [0, 0, 0], [0, 0, 0], **engine)
        for joint, value in zip(self._order, joint_position, strict=True):
            pybullet.resetJointState(self._body, joint, float(value), 0.0, **engine)

    def _set_clock_to_zero(self) -> None:
        pass

    def _turn_by(self, angle: float) -> None:
        raise NotImplementedError

    def _base_up(self) -> float:
        return float(self._base()[0][2, 2])

    def _base(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rotation of the base to the world, its angular velocity and the velocity of its origin, in the world."""
        _, turned = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=self._engine)
        velocity, turning = map(np.array, pybullet.getBaseVelocity(self._body, physicsClientId=self._engine))
        rotation = (Rotation.from_quat(turned) * self._base_axes.inv()).as_matrix()
        return rotation, turning, velocity - np.cross(turning, rotation @ self._base_com)

    def _joints(self) -> tuple[FloatArray, FloatArray]:
        states = pybullet.getJointStates(self._body, self._order, physicsClientId=self._engine)
        return np.array([state[0] for state in states]), np.array([state[1] for state in states])

    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        joints, engine = len(self._order), {"physicsClientId": self._engine}
        rotations, twists = np.empty((len(control), 3, 3)), np.empty((len(control) + 1, 2, 3))
        speeds = np.empty((len(control) + 1, joints))
        for index, target in enumerate(control):
            position, speeds[index] = self._joints()
            rotations[index], *twists[index] = self._base()
            asked = self._kp * (target - position) - self._kd * speeds[index]
            torque = np.clip(asked, -self._limit, self._limit)
            raw[index, :joints], raw[index, 2 * joints : 3 * joints] = position, torque
            acting = self._errors.torque_gain * torque
            slid = self._errors.sliding_friction(speeds[index], acting) * np.tanh(speeds[index] / _SLOW)
            acting = acting - slid - self._errors.viscous_friction * speeds[index]
            pybullet.setJointMotorControlArray(
                self._body, self._order, pybullet.TORQUE_CONTROL, forces=acting.tolist(), **engine
            )
            pybullet.stepSimulation(**engine)
        self._held, speeds[-1] = control[-1], self._joints()[1]
        _, *twists[-1] = self._base()
        # The engine's velocity belongs to the middle of the step before a state: the mean of two belongs to the state.
        raw[:, joints : 2 * joints] = (speeds[:-1] + speeds[1:]) / 2
        turning, change = (twists[:-1, 0] + twists[1:, 0]) / 2, np.diff(twists, axis=0) / TIMESTEP
        arm = rotations @ self._imu_position
        felt = change[:, 1] + np.cross(change[:, 0], arm) + np.cross(turning, np.cross(turning, arm))
        felt[:, 2] += GRAVITY
        axes = rotations @ self._imu_rotation
        raw[:, -6:-3], raw[:, -3:] = np.einsum("nji,nj->ni", axes, turning), np.einsum("nji,nj->ni", axes, felt)

    def _raw_now(self) -> FloatArray:
        before, raw = pybullet.saveState(physicsClientId=self._engine), np.empty((1, self._raw_width))
        held = self._held
        self._run((self._late_control[0] if len(self._late_control) else held)[None], raw)
        self._held = held
        pybullet.restoreState(before, physicsClientId=self._engine)
        pybullet.removeState(before, physicsClientId=self._engine)
        return raw[0]
