"""Model of a simulated robot in DART: skeleton from the model file, feet, floor and errors."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import dartpy
import numpy as np
from dartpy import collision, constraint, dynamics, simulation
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import ModelError
from equipoise.lab.dart.dart_links import Axis, KinematicLink, moved_by, pose_of, read_links
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import BELLY_RATIO, Stance
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
        torque_limit: (nj,) torque limits of the motors, before the torque gain error [Nm].
        feet: shapes of the feet FL FR RL RR.
    """

    world: simulation.World
    skeleton: dynamics.Skeleton
    errors: DrawnErrors
    dofs: NDArray[np.intp]
    kp: FloatArray
    kd: FloatArray
    torque_limit: FloatArray
    feet: tuple[dynamics.ShapeNode, ...]

    @property
    def base(self) -> dynamics.BodyNode:
        return self.skeleton.getRootBodyNode()


def build_dart_robot(
    robot: RobotModel, stance: Stance, errors: DrawnErrors, payload: Payload | None, timestep: float | None = None
) -> SimulatedDartRobot:
    """Build the DART world of a robot from its model file.

    Rigidly connected links become one body. Only the feet (spheres) and the belly (a box, for lying) touch the floor.

    Args:
        stance: stance whose hip height scales the gains.
        errors: actuator errors, floor and leg masses of the model; the platform adds sensor errors.
        timestep: time step of the engine [s]; default: 0.5 ms, or less if damping requires it for stability.

    Raises:
        ModelError: DART cannot make a model of the file.
    """
    try:
        links = read_links(robot.source)
    except ValueError as error:
        raise ModelError(f"DART cannot make a model of {str(robot.source.path)!r}: {error}") from error
    legs = LegErrors.of(robot, stance, errors)
    skeleton, places = _skeleton(robot, links, legs)
    _set_inertias(robot, skeleton, links, places, errors, legs, payload)
    dofs = np.array([skeleton.getJoint(name).getIndexInSkeleton(0) for name in robot.joint_names], dtype=np.intp)
    kp, kd = robot.gains(stance.hip_height)
    if timestep is None:
        timestep = _stable_timestep(
            skeleton, dofs, stance, kd + float(errors.viscous_friction.max()), errors.sizes.armature
        )
    for name in robot.joint_names:
        joint = skeleton.getJoint(name)
        joint.setDampingCoefficient(0, errors.sizes.armature / 2 / timestep)  # see DartPlatform
    feet = _add_contacts(robot, stance, skeleton, places, legs, errors.floor_friction)
    world = _world(skeleton, errors, timestep)
    count = len(robot.joint_names)
    return SimulatedDartRobot(
        world, skeleton, errors, dofs, np.full(count, kp), np.full(count, kd), np.array(robot.effort_limit), feet
    )


Places = dict[str, tuple[dynamics.BodyNode, FloatArray]]
"""Body of each link, and the link's pose (4, 4) in that body."""


def _skeleton(robot: RobotModel, links: list[KinematicLink], legs: LegErrors) -> tuple[dynamics.Skeleton, Places]:
    """Build massless bodies connected by the leg joints, with all other joints locked."""
    skeleton = dynamics.Skeleton(robot.name)
    shifts, turns = _joint_shifts(robot, legs), dict(zip(robot.joint_names, legs.axis_turn, strict=True))
    places: Places = {}
    for link in links:
        if link.parent is None:
            body = skeleton.createFreeJointAndBodyNodePair()[1]
            body.setName(link.name)
            places[link.name] = body, np.eye(4)
            continue
        parent, pose = places[link.parent]
        pose = pose @ link.placement
        leg_axes = [axis for axis in link.axes if axis.name in robot.joint_names]
        if leg_axes:
            axis = leg_axes[0]
            pose = pose_of(np.eye(3), shifts[axis.name]) @ pose
            turned = np.array(dartpy.math.expMapRot(turns[axis.name])) @ axis.direction
            axis = dataclasses.replace(axis, direction=turned)
            places[link.name] = _add_body(skeleton, parent, pose, axis, link.name, robot), np.eye(4)
            continue
        for axis in link.axes:
            pose = pose @ axis.moved(robot.locked_joints.get(axis.name, 0.0))
        places[link.name] = parent, pose
    return skeleton, places


def _joint_shifts(robot: RobotModel, legs: LegErrors) -> dict[str, FloatArray]:
    """Return the shift of each leg joint in the axes of its parent link, by name [m]."""
    shifts: dict[str, FloatArray] = {}
    for leg, hip in zip(robot.legs.values(), legs.hip_shift, strict=True):
        above = [hip, *(legs.end_shift[joint] for joint in leg.joints[:-1])]
        shifts |= dict(zip(leg.joint_names, above, strict=True))
    return shifts


def _add_body(
    skeleton: dynamics.Skeleton, parent: dynamics.BodyNode, pose: FloatArray, axis: Axis, name: str, robot: RobotModel
) -> dynamics.BodyNode:
    hinge = axis.kind == "hinge"
    create = skeleton.createRevoluteJointAndBodyNodePair if hinge else skeleton.createPrismaticJointAndBodyNodePair
    joint, body = create(parent)
    body.setName(name)
    joint.setName(axis.name)
    joint.setAxis(axis.direction)
    at_anchor = pose_of(np.eye(3), axis.anchor)
    joint.setTransformFromParentBodyNode(dartpy.math.Isometry3(pose @ at_anchor))
    joint.setTransformFromChildBodyNode(dartpy.math.Isometry3(at_anchor))
    index = robot.joint_names.index(axis.name)
    joint.setPositionLowerLimit(0, float(robot.lower_limit[index]))
    joint.setPositionUpperLimit(0, float(robot.upper_limit[index]))
    joint.setLimitEnforcement(True)
    return body


def _set_inertias(
    robot: RobotModel,
    skeleton: dynamics.Skeleton,
    links: list[KinematicLink],
    places: Places,
    errors: DrawnErrors,
    legs: LegErrors,
    payload: Payload | None,
) -> None:
    """Set the inertial parameters of all bodies from their links, with payload and leg errors."""
    parts: dict[str, list[InertialParameters]] = {body.getName(): [] for body in skeleton.getBodyNodes()}
    for link in links:
        body, pose = places[link.name]
        parts[body.getName()] += [moved_by(pose, part) for part in link.parts]
    if payload is not None:
        parts[skeleton.getRootBodyNode().getName()].append(payload.parameters)
    changes = {
        skeleton.getJoint(joint).getChildBodyNode().getName(): (float(mass), float(mass * inertia), shift)
        for joint, mass, inertia, shift in zip(
            robot.joint_names, errors.leg_mass_scale, errors.leg_inertia_scale, legs.com_shift, strict=True
        )
    }
    for name, of_body in parts.items():
        if not sum(part.mass for part in of_body) > 0:
            raise ModelError(f"DART cannot make a model of {str(robot.source.path)!r}: link {name!r} has no mass")
        skeleton.getBodyNode(name).setInertia(_joined(of_body, *changes.get(name, (1.0, 1.0, np.zeros(3)))))


def _joined(
    bodies: list[InertialParameters], mass_scale: float, inertia_scale: float, shift: FloatArray
) -> dynamics.Inertia:
    """Return the bodies as one (parallel axis theorem), with scaled mass and inertia and shifted CoM."""
    masses = np.array([body.mass for body in bodies])
    coms = np.array([body.com for body in bodies])
    com = masses @ coms / masses.sum()
    arms = coms - com
    inertia = np.sum([body.inertia for body in bodies], axis=0)
    inertia += np.einsum("b,bk,bk->", masses, arms, arms) * np.eye(3) - np.einsum("b,bi,bj->ij", masses, arms, arms)
    return dynamics.Inertia(mass_scale * float(masses.sum()), com + shift, inertia_scale * inertia)


def _add_contacts(
    robot: RobotModel,
    stance: Stance,
    skeleton: dynamics.Skeleton,
    places: Places,
    legs: LegErrors,
    friction: float,
) -> tuple[dynamics.ShapeNode, ...]:
    feet: list[dynamics.ShapeNode] = []
    for leg, foot, worn in zip(robot.legs.values(), robot.feet.values(), legs.foot_radius, strict=True):
        body, pose = places[foot.body]
        centre = pose @ pose_of(np.eye(3), np.array(foot.position_in_body))
        at = centre[:3, 3] + legs.end_shift[leg.joints[-1]]
        feet.append(_add_shape(body, dynamics.SphereShape(foot.radius + worn), at, friction))
    hips_above_base = stance.hip_height - stance.base_height
    reach = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    thickness = 0.02 * robot.leg_length
    belly = dynamics.BoxShape(2 * np.array([0.6 * reach[0], 0.4 * reach[1], thickness]))
    height = hips_above_base - BELLY_RATIO * robot.leg_length + thickness
    _add_shape(skeleton.getRootBodyNode(), belly, np.array([0, 0, height]), friction)
    return tuple(feet)


def _add_shape(body: dynamics.BodyNode, shape: dynamics.Shape, at: FloatArray, friction: float) -> dynamics.ShapeNode:
    node = body.createShapeNode(shape)
    node.createCollisionAspect()
    node.createDynamicsAspect()
    node.getDynamicsAspect().setFrictionCoeff(friction)
    node.setRelativeTransform(dartpy.math.Isometry3(pose_of(np.eye(3), at)))
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
