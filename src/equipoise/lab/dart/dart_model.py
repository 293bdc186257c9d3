"""Model of a simulated robot in DART: skeleton from the Pinocchio model, feet, floor and errors."""

from __future__ import annotations

from dataclasses import dataclass

import dartpy
import numpy as np
from dartpy import collision, constraint, dynamics, simulation
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import ModelError
from equipoise.robot.links import link_names
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import BELLY_RATIO, Stance
from equipoise.robot.tree import joint_axis
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.payload import Payload

_FLOOR_SIZE = (200.0, 200.0, 1.0)  # [m]
# Friction solver with warm start. Feet need four sweeps. A lying belly is statically indeterminate and does not converge. With
# the default tolerance of 1e-5, feet creep ten times as fast.
_TOLERANCE, _MOST_SWEEPS = 1e-12, 100
_TIMESTEPS = (0.5e-3, 0.25e-3, 0.125e-3)  # [s]


@dataclass(frozen=True, eq=False)
class SimulatedDartRobot:
    """DART world with a robot, and the indices of its joints.

    Attributes:
        world: world with the robot and the floor.
        skeleton: skeleton of the robot, with the base at the root and only the leg joints movable.
        errors: drawn sensor and actuator errors.
        dofs: (nj,) indices of the leg joints in the skeleton's vectors, in the robot's joint order.
        kp, kd: (nj,) gains of the joint PD control [Nm/rad], [Nm s/rad].
        feet: shapes of the feet FL FR RL RR.
    """

    world: simulation.World
    skeleton: dynamics.Skeleton
    errors: DrawnErrors
    dofs: NDArray[np.intp]
    kp: FloatArray
    kd: FloatArray
    feet: tuple[dynamics.ShapeNode, ...]

    @property
    def base(self) -> dynamics.BodyNode:
        return self.skeleton.getRootBodyNode()


def build_dart_robot(
    robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None, timestep: float | None = None
) -> SimulatedDartRobot:
    """Build the DART world of a robot.

    The skeleton has the joints, placements and inertias of the Pinocchio model. Only the feet (spheres) and the belly (a box,
    for lying) touch the floor.

    Args:
        stance: stance whose hip height scales the gains.
        errors: actuator errors, floor and leg masses of the model; the platform adds sensor errors.
        timestep: time step of the engine [s]; default: 0.5 ms, or less if damping requires it for stability.

    Raises:
        ModelError: a link has no mass.
    """
    legs = LegErrors.of(robot, stance, errors)
    skeleton = dynamics.Skeleton(robot.name)
    bodies = _add_bodies(robot, skeleton, legs)
    _set_inertias(robot, bodies, errors, legs, payload)
    dofs = np.array([skeleton.getJoint(name).getIndexInSkeleton(0) for name in robot.joint_names], dtype=np.intp)
    kp, kd = robot.gains(stance.hip_height)
    if timestep is None:
        timestep = _stable_timestep(
            skeleton, dofs, stance, kd + float(errors.viscous_friction.max()), errors.sizes.armature
        )
    for name in robot.joint_names:
        joint = skeleton.getJoint(name)
        joint.setDampingCoefficient(0, errors.sizes.armature / 2 / timestep)  # see DartPlatform
    feet = _add_contacts(robot, stance, bodies, legs, errors.floor_friction)
    world = _world(skeleton, errors, timestep)
    return SimulatedDartRobot(world, skeleton, errors, dofs, np.full(len(dofs), kp), np.full(len(dofs), kd), feet)


def _add_bodies(robot: RobotModel, skeleton: dynamics.Skeleton, legs: LegErrors) -> list[dynamics.BodyNode]:
    """Add massless bodies: the base, and the body that each leg joint moves, in the order of Pinocchio's joints."""
    model = robot.pinocchio
    bodies = [skeleton.createFreeJointAndBodyNodePair()[1]]
    shifts = _joint_shifts(robot, legs)
    for index, name in enumerate(robot.joint_names):
        joint_id = index + 2
        placement, parent = model.jointPlacements[joint_id], bodies[model.parents[joint_id] - 1]
        joint, body = skeleton.createRevoluteJointAndBodyNodePair(parent)  # others are refused when a file is read
        joint.setAxis(np.array(dartpy.math.expMapRot(legs.axis_turn[index])) @ joint_axis(model, joint_id))
        joint.setName(name)
        pose = dartpy.math.Isometry3(placement.rotation, placement.translation + shifts[name])
        joint.setTransformFromParentBodyNode(pose)
        joint.setPositionLowerLimit(0, float(robot.lower_limit[index]))
        joint.setPositionUpperLimit(0, float(robot.upper_limit[index]))
        joint.setLimitEnforcement(True)
        bodies.append(body)
    return bodies


def _joint_shifts(robot: RobotModel, legs: LegErrors) -> dict[str, FloatArray]:
    """Return the shift of each leg joint in the axes of its parent link, by name [m]."""
    shifts: dict[str, FloatArray] = {}
    for leg, hip in zip(robot.legs.values(), legs.hip_shift, strict=True):
        above = [hip, *(legs.end_shift[joint] for joint in leg.joints[:-1])]
        shifts |= dict(zip(leg.joint_names, above, strict=True))
    return shifts


def _set_inertias(
    robot: RobotModel, bodies: list[dynamics.BodyNode], errors: DrawnErrors, legs: LegErrors, payload: Payload | None
) -> None:
    """Set the inertial parameters of all bodies, with payload and leg errors."""
    base, *links = robot.pinocchio.inertias[1:]
    if payload is not None:
        base = base + payload.parameters.to_pinocchio()
    bodies[0].setInertia(dynamics.Inertia(base.mass, base.lever, base.inertia))
    mass_scale = errors.leg_mass_scale
    inertia_scale = mass_scale * errors.leg_inertia_scale
    for index, (body, link) in enumerate(zip(bodies[1:], links, strict=True)):
        if not link.mass > 0:
            joint = robot.full_pinocchio.getJointId(robot.joint_names[index])
            raise ModelError(
                f"DART cannot make a model of {str(robot.source.path)!r}: link "
                f"{link_names(robot.full_pinocchio)[joint]!r} has no mass"
            )
        com = link.lever + legs.com_shift[index]
        body.setInertia(dynamics.Inertia(mass_scale[index] * link.mass, com, inertia_scale[index] * link.inertia))


def _add_contacts(
    robot: RobotModel, stance: Stance, bodies: list[dynamics.BodyNode], legs: LegErrors, friction: float
) -> tuple[dynamics.ShapeNode, ...]:
    feet: list[dynamics.ShapeNode] = []
    for leg, worn in zip(robot.legs.values(), legs.foot_radius, strict=True):
        knee = leg.joints[-1]
        at = robot.pinocchio.frames[leg.foot_frame_id].placement.translation + legs.end_shift[knee]
        feet.append(_add_shape(bodies[knee + 1], dynamics.SphereShape(leg.foot_radius + worn), at, friction))
    hips_above_base = stance.hip_height - stance.base_height
    reach = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    thickness = 0.02 * robot.leg_length
    belly = dynamics.BoxShape(2 * np.array([0.6 * reach[0], 0.4 * reach[1], thickness]))
    height = hips_above_base - BELLY_RATIO * robot.leg_length + thickness
    _add_shape(bodies[0], belly, np.array([0, 0, height]), friction)
    return tuple(feet)


def _add_shape(body: dynamics.BodyNode, shape: dynamics.Shape, at: FloatArray, friction: float) -> dynamics.ShapeNode:
    node = body.createShapeNode(shape)
    node.createCollisionAspect()
    node.createDynamicsAspect()
    node.getDynamicsAspect().setFrictionCoeff(friction)
    node.setRelativeTransform(dartpy.math.Isometry3(np.eye(3), at))
    return node


def _world(skeleton: dynamics.Skeleton, errors: DrawnErrors, timestep: float) -> simulation.World:
    """Build the world with the robot on the floor.

    DART's Gauss-Seidel solver with a tight tolerance gives contacts with a friction cone. Error reduction and constraint
    mixing are DART's defaults. The feet of a standing A1 creep by 0.2 um/s (30 um/s in MuJoCo) and penetrate by 30 nm.
    Dantzig's solver, the default, bounds friction by the normal forces without friction: a foot of a Go2 slid at 0.7 of its
    load with a friction coefficient of 0.8.
    Sleeping is disabled, because sleeping bodies ignore small commands.
    """
    world = simulation.World()
    world.setTimeStep(timestep)
    world.setGravity(GRAVITY * errors.gravity_direction)
    sleeping = world.getDeactivationOptions()
    sleeping.mEnabled = False
    world.setDeactivationOptions(sleeping)
    world.setCollisionDetector(collision.DARTCollisionDetector())
    friction = constraint.NsgsFrictionSolver.Options()
    friction.tolerance, friction.maxSweeps = _TOLERANCE, _MOST_SWEEPS
    world.getConstraintSolver().setBoxedLcpSolver(constraint.NsgsFrictionSolver(friction))
    floor = dynamics.Skeleton("equipoise_floor")
    ground = floor.createWeldJointAndBodyNodePair()[1]
    depth = np.array([0.0, 0.0, _FLOOR_SIZE[2] / 2])
    _add_shape(ground, dynamics.BoxShape(np.array(_FLOOR_SIZE)), -depth, errors.floor_friction)
    world.addSkeleton(skeleton)
    world.addSkeleton(floor)
    return world


def _stable_timestep(
    skeleton: dynamics.Skeleton, dofs: NDArray[np.intp], stance: Stance, damping: float, armature: float
) -> float:
    """Return the longest time step in which explicit damping does not reverse a joint's speed, or the shortest one [s]."""
    positions = np.zeros(skeleton.getNumDofs())
    positions[dofs] = stance.joint_position
    skeleton.setPositions(positions)
    lightest = float(np.diag(skeleton.getMassMatrix())[dofs].min()) + armature
    stable = [timestep for timestep in _TIMESTEPS if damping * timestep <= lightest]
    return stable[0] if stable else _TIMESTEPS[-1]
