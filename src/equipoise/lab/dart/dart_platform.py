"""Simulated robot in DART, a physics engine of Gazebo, with joint PD control at every engine step."""

from __future__ import annotations

import dartpy
import numpy as np

from equipoise.conventions import FloatArray
from equipoise.lab.dart.dart_model import SimulatedDartRobot
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.simulated import SimulatedPlatform, Start

# A standing foot above the floor within these limits lost its contact numerically and was not lifted.
_LOST_GAP, _LOST_SPEED = 1e-6, 1e-3  # [m], [m/s]
_PRESSED = 1e-6  # [m], penetration
_STICTION = 10.0  # stiffness of a sticking joint over its position gain
_FASTEST = 1e6  # limit of the squared norm of the generalised velocity


_State = tuple[FloatArray, FloatArray, FloatArray, FloatArray, int, float]
"""Positions, velocities, late rotor torque, strain, contacts and time: all that the next steps depend on."""


class DartPlatform(SimulatedPlatform):
    """Quadruped in DART.

    DART has no rotor inertia A. Its joint damping D is implicit, which adds D h to a joint's inertia in a step h. So half a
    rotor is D = A / 2h, with D v added to the torque. Contact impulses p ignore this: they change the joints' speed by
    dp = M^-1 J^T p. The torque of the other half, with the part of the first that impulses ignore, is -A (dv + dp) / 2h, with
    dv the whole change of speed. The last step's value is applied, because it hardly changes from step to step.
    Each step multiplies its error by A/2 (2P - 1) (M + A/2)^-1, with P = M^-1 J^T (J M^-1 J^T)^-1 J. It decays because 2P - 1
    is a reflection. The momentum of the whole robot is exact at each step.

    Joint friction is Coulomb's, with a spring that strains by 0.3 mrad before it slips. Above about thirty times the position
    gain, the spring oscillates with the late torque of the rotors. DART's own joint friction is a constraint: twelve of them
    with twelve of contacts exceed the robot's degrees of freedom, and the solver does not converge.

    DART's contacts are 30 nm deep. In a step a moving leg's foot strays as far, because joints move along their tangents.
    A foot that strays off the floor is free for a step and lands 20 um away. This happened nine times per second to a Go2
    that moved its body. Such a step is repeated with the foot pressed into the floor.

    Args:
        robot: model for the estimator; the simulated robot differs from it by its errors and payload.
        simulated: world of the engine.
        stance: nominal stance of the start; a lying robot starts under it.
        start: posture at the start, "standing" or "lying".
        control_period: control period [s]; a multiple of the engine's time step.
    """

    def __init__(
        self,
        robot: RobotModel,
        simulated: SimulatedDartRobot,
        stance: Stance,
        start: Start = "standing",
        control_period: float = 2e-3,
    ) -> None:
        self._simulated = simulated
        self._world, self._skeleton = simulated.world, simulated.skeleton
        timestep = self._world.getTimeStep()
        super().__init__(robot, simulated.errors, simulated.kp, simulated.kd, timestep, control_period)
        sizes = simulated.errors.sizes
        self._rotor = sizes.armature / 2 / timestep  # [Nm s/rad]
        self._late_rotor_torque = np.zeros(len(self.joint_names))
        self._stiction = _STICTION * simulated.kp  # [Nm/rad]
        self._strain = np.zeros(len(self.joint_names))  # [rad], of sticking joints
        self._contacts = 0
        mounted = robot.imu_in_base
        tilt = np.array(dartpy.math.expMapRot(simulated.errors.drawn["imu_tilt"]))
        self._imu_rotation = np.array(mounted.rotation) @ tilt
        self._imu_position = mounted.translation + simulated.errors.drawn["imu_position"]
        self._held = np.zeros(len(self.joint_names))  # present targets
        self._settle(stance, start)

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        skeleton = self._skeleton
        positions = np.zeros(skeleton.getNumDofs())
        positions[self._simulated.dofs] = joint_position
        skeleton.setPositions(positions)
        skeleton.setVelocities(np.zeros(skeleton.getNumDofs()))
        self._set_base_height(base_height)
        lowest = min(
            foot.getWorldTransform().translation()[2] - foot.getShape().getRadius() for foot in self._simulated.feet
        )
        if lowest < -_PRESSED:  # the simulated feet differ from the model's
            self._set_base_height(base_height - lowest)

    def _set_base_height(self, height: float) -> None:
        at = dartpy.math.Isometry3(np.eye(3), np.array([0, 0, height]))
        self._skeleton.getRootJoint().setTransform(at)

    def _turn_by(self, angle: float) -> None:
        pose = self._simulated.base.getTransform()
        turn = np.array(dartpy.math.expMapRot(np.array([0.0, 0.0, angle])))
        self._skeleton.getRootJoint().setTransform(dartpy.math.Isometry3(turn @ pose.rotation(), pose.translation()))

    def _set_clock_to_zero(self) -> None:
        self._world.setTime(0.0)

    def _base_up(self) -> float:
        return float(self._simulated.base.getTransform().rotation()[2, 2])

    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        before = self._state()
        try:
            self._step(control, raw)
        except BaseException:
            self._restore(before)
            raise
        self._held = control[-1]

    def _raw_now(self) -> FloatArray:
        before, raw = self._state(), np.empty((1, self._raw_width))
        try:
            self._step((self._late_control[0] if len(self._late_control) else self._held)[None], raw)
        finally:
            self._restore(before)
        return raw[0]

    def _state(self) -> _State:
        moving = self._skeleton.getPositions(), self._skeleton.getVelocities()
        return (*moving, self._late_rotor_torque, self._strain, self._contacts, self._world.getTime())

    def _restore(self, state: _State) -> None:
        positions, velocities, self._late_rotor_torque, self._strain, self._contacts, time = state
        self._skeleton.setPositions(positions)
        self._skeleton.setVelocities(velocities)
        self._world.setTime(time)

    def _step(self, control: FloatArray, raw: FloatArray) -> None:
        """Run engine steps, and fill in the sensor values of their initial states."""
        skeleton, base = self._skeleton, self._simulated.base
        dofs, limit, gain = self._simulated.dofs, self._robot.effort_limit, self._errors.torque_gain
        kp, kd, joints = self._kp, self._kd, len(dofs)
        forces = np.zeros(skeleton.getNumDofs())
        rotations, twists = np.empty((len(control), 3, 3)), np.empty((len(control) + 1, 2, 3))
        speeds = np.empty((len(control) + 1, joints))
        for index, target in enumerate(control):
            positions, velocities = skeleton.getPositions(), skeleton.getVelocities()
            if not velocities @ velocities < _FASTEST:
                raise self._became_unstable(self._world.getTime())
            position = positions[dofs]
            raw[index, :joints], speeds[index] = position, velocities[dofs]
            rotations[index] = base.getTransform().rotation()
            twists[index] = base.getAngularVelocity(), base.getLinearVelocity()
            torque = np.minimum(np.maximum(kp * (target - position) - kd * speeds[index], -limit), limit)
            raw[index, 2 * joints : 3 * joints] = torque
            forces[dofs] = gain * torque - self._friction_after(speeds[index], gain * torque)
            forces[dofs] += self._rotor * speeds[index] + self._late_rotor_torque
            self._step_once(positions, velocities, forces)
            changed = skeleton.getVelocities()[dofs] - speeds[index] + skeleton.getVelocityChanges()[dofs]
            self._late_rotor_torque = -self._rotor * changed
        speeds[-1] = skeleton.getVelocities()[dofs]
        twists[-1] = base.getAngularVelocity(), base.getLinearVelocity()
        # The engine's velocities are those of the middle of a step; the mean of two is the velocity at a state.
        raw[:, joints : 2 * joints] = (speeds[:-1] + speeds[1:]) / 2
        raw[:, -6:-3], raw[:, -3:] = self._imu(rotations, (twists[:-1] + twists[1:]) / 2, np.diff(twists, axis=0))

    def _friction_after(self, speed: FloatArray, torque: FloatArray) -> FloatArray:
        """Return the (nj,) friction of the joints, including viscous friction, after a step at a speed and torque [Nm]."""
        strained = self._stiction * (self._strain + self._timestep * speed)
        largest = self._errors.sliding_friction(speed, torque)
        friction = np.minimum(np.maximum(strained, -largest), largest)
        self._strain = friction / self._stiction
        return friction + self._errors.viscous_friction * speed

    def _step_once(self, positions: FloatArray, velocities: FloatArray, forces: FloatArray) -> None:
        """Run one engine step from a state; repeat it with lost feet pressed into the floor."""
        skeleton, world = self._skeleton, self._world
        skeleton.setForces(forces)
        self._apply_cable_force()
        world.step(True)
        contacts = world.getLastCollisionResult().getNumContacts()
        if contacts < self._contacts and (pressed := self._with_lost_feet_pressed(positions, velocities)) is not None:
            skeleton.setPositions(pressed)
            skeleton.setVelocities(velocities)
            skeleton.setForces(forces)
            self._apply_cable_force()
            world.setTime(world.getTime() - self._timestep)
            world.step(True)
            contacts = world.getLastCollisionResult().getNumContacts()
        self._contacts = contacts

    def _apply_cable_force(self) -> None:
        """Apply the cable's force at the base's CoM for one step."""
        if self._errors.sizes.cable:
            self._simulated.base.addExtForce(self._errors.cable_in_world, self._simulated.base.getLocalCOM(), False)

    def _with_lost_feet_pressed(self, positions: FloatArray, velocities: FloatArray) -> FloatArray | None:
        """Return positions with every lost foot pressed into the floor by its leg, or None if no foot was lost."""
        simulated, skeleton = self._simulated, self._skeleton
        present, pressed = skeleton.getPositions(), positions.copy()
        skeleton.setPositions(positions)
        for foot in simulated.feet:
            gap = foot.getWorldTransform().translation()[2] - foot.getShape().getRadius()
            offset = foot.getRelativeTransform().translation()
            rise = skeleton.getLinearJacobian(foot.getBodyNodePtr(), offset)[2]
            if 0 <= gap < _LOST_GAP and abs(rise @ velocities) < _LOST_SPEED:
                by_joints = rise[simulated.dofs]
                pressed[simulated.dofs] -= (gap + _PRESSED) * by_joints / (by_joints @ by_joints)
        skeleton.setPositions(present)
        return None if np.array_equal(pressed, positions) else pressed

    def _imu(self, rotations: FloatArray, twists: FloatArray, changes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n, 3) angular velocity and specific force in the IMU's axes.

        Args:
            rotations: (n, 3, 3) rotations of the base, base axes to the world's.
            twists: (n, 2, 3) angular [rad/s] and linear velocity [m/s] of the base frame, in the world.
            changes: (n, 2, 3) changes of the twists over a step, in the world.
        """
        turning, acceleration = twists[:, 0], changes / self._timestep
        arm = rotations @ self._imu_position
        force = acceleration[:, 1] + np.cross(acceleration[:, 0], arm) + np.cross(turning, np.cross(turning, arm))
        force -= self._world.getGravity()
        axes = rotations @ self._imu_rotation
        return np.einsum("nji,nj->ni", axes, turning), np.einsum("nji,nj->ni", axes, force)
