"""Motions with exact physics, the reference of tests of the Bayesian method's equations."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from equipoise import nominal_stance
from equipoise.estimator.equations.torque_balance import TorqueSamples
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.robot.model import DIAGONALS, LEG_NAMES

GRAVITY = 9.81
SAMPLES = 4


def about(axis, angles):
    """Return (n, 3, 3) rotations about an axis."""
    return Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()


def sides(diagonal):
    """Return the indices of the left and the right foot of a diagonal."""
    left, right = DIAGONALS[diagonal] if DIAGONALS[diagonal][0][1] == "L" else DIAGONALS[diagonal][::-1]
    return LEG_NAMES.index(left), LEG_NAMES.index(right)


def lift_samples(robot, diagonal, position, velocity, turning, **changes):
    """Return lift samples with the model's IMU mounting, by default level and at rest, and with arbitrary noise levels."""
    count = len(position)
    mounting = np.array(robot.imu_in_base.rotation)
    up_in_imu = changes.pop("up_in_imu", np.tile(mounting[2], (count, 1)))
    values = {
        "start": 0.0,
        "step": 0.01,
        "joint_acceleration": np.zeros_like(position),
        "angular_acceleration_in_imu": np.zeros((count, 3)),
        "acceleration_in_imu": GRAVITY * up_in_imu,
        "velocity_noise": 1e-4 * np.eye(count),
        "angular_velocity_noise": 1e-6 * np.eye(count),
        "acceleration_noise": 1e-4 * np.eye(count),
        **changes,
    }
    return LiftSamples(
        diagonal, joint_position=position, joint_velocity=velocity, angular_velocity_in_imu=turning @ mounting,
        up_in_imu=up_in_imu, **values,
    )  # fmt: skip


@dataclass(frozen=True)
class Swing:
    """Oscillation of the lifted legs' joints, each with its own phase; joints of the stance legs are locked."""

    size: float = 0.0  # [rad]
    frequency: float = 3.0  # [Hz]

    def joints(self, robot, joint_position, diagonal, time):
        """Return (n, nj) positions, velocities and accelerations."""
        way, pace = np.zeros(len(joint_position)), 2 * np.pi * self.frequency
        for leg in set(LEG_NAMES) - set(DIAGONALS[diagonal]):
            way[list(robot.legs[leg].joints)] = self.size
        phase = np.add.outer(pace * np.atleast_1d(time), 0.7 * np.arange(len(way)))
        return joint_position + way * np.sin(phase), way * pace * np.cos(phase), -way * pace**2 * np.sin(phase)


@dataclass(frozen=True)
class Compliance:
    """Deflection that encoders do not measure: a sinusoidal motion of the base on its stance feet, in base axes [m]."""

    way: tuple = (0.0, 0.0, 0.0)
    frequency: float = 15.0  # [Hz]

    def feet(self, time):
        """Return the (3,) shift of the feet from the encoders' positions, and its first two derivatives."""
        pace = 2 * np.pi * self.frequency
        way = -np.array(self.way)
        return way * np.sin(pace * time), way * pace * np.cos(pace * time), -way * pace**2 * np.sin(pace * time)


def pendulum(
    robot, joint_position, diagonal, up, rate=0.2, radius=None, duration=0.3, late=0.0, step=0.005, resistance=0.0,
    swing=Swing(), compliance=Compliance(),
):  # fmt: skip
    """Simulate a lift trial of a robot that topples about its support line, its two feet rolling as one cylinder.

    The principle of virtual work gives the acceleration of the tilt, the only coordinate: rolling does no work on the force
    and moment of the base from Pinocchio. The estimator uses a moment balance instead.

    Args:
        up: (3,) upward direction at rest, in base axes; the line must be level there.
        rate: initial angular velocity about the line [rad/s].
        radius: radius of the feet; default the robot's [m].
        late: delay of the IMU's samples relative to the joints' [s].
        resistance: lever arm of the rolling resistance [m].
        swing: motion of the lifted legs' joints.
        compliance: motion of the base on its feet.
    """
    data, model = robot.pinocchio.createData(), robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)  # accelerations are specific forces
    pin.framesForwardKinematics(model, data, robot.configuration(joint_position))
    left_foot, right_foot = (
        np.array(data.oMf[robot.legs[LEG_NAMES[i]].foot_frame_id].translation) for i in sides(diagonal)
    )
    left = (left_foot - right_foot) / np.linalg.norm(left_foot - right_foot)
    assert abs(left @ up) < 1e-3
    radius = robot.legs[LEG_NAMES[sides(diagonal)[0]]].foot_radius if radius is None else radius
    mass = pin.computeTotalMass(model)

    def upward(angle):
        return about(left, [-angle])[0] @ up

    def specific_force(time, angle, speed, change):
        """Return the specific force at the base's origin, from the rolling centres of the feet."""
        shift, velocity, acceleration = compliance.feet(time)
        foot = right_foot + shift
        of_foot = radius * change * np.cross(left, upward(angle))
        turned = np.cross(change * left, foot) + speed**2 * np.cross(left, np.cross(left, foot))
        return of_foot - turned - 2 * speed * np.cross(left, velocity) - acceleration + GRAVITY * upward(angle)

    def acceleration(time, angle, speed):
        position, velocity, joint_acceleration = (
            part[0] for part in swing.joints(robot, joint_position, diagonal, time)
        )
        q, v = robot.configuration(position), np.concatenate([np.zeros(3), speed * left, velocity])
        rolling = np.concatenate(
            [radius * np.cross(left, upward(angle)) - np.cross(left, right_foot + compliance.feet(time)[0]), left]
        )

        def work(change):
            a = np.concatenate([specific_force(time, angle, speed, change), change * left, joint_acceleration])
            return rolling @ pin.rnea(model, data, q, v, a)[:6] + resistance * mass * GRAVITY

        return work(0.0) / (work(0.0) - work(1.0))

    time = step * np.arange(round(duration / step) + 1)
    whole = solve_ivp(
        lambda now, state: [state[1], acceleration(now, *state)], (0, duration + late), [0.0, rate], "DOP853",
        rtol=1e-10, atol=1e-12, dense_output=True,
    ).sol  # fmt: skip
    states = [(now, *whole(now)) for now in time + late]
    rates = [acceleration(*state) for state in states]
    mounting, arm = np.array(robot.imu_in_base.rotation), np.array(robot.imu_in_base.translation)
    at_imu = [
        specific_force(*state, change)
        + np.cross(change * left, arm)
        + state[2] ** 2 * np.cross(left, np.cross(left, arm))
        for state, change in zip(states, rates, strict=True)
    ]
    position, velocity, joint_acceleration = swing.joints(robot, joint_position, diagonal, time)
    return lift_samples(
        robot, diagonal, position, velocity, np.outer([speed for *_, speed in states], left), step=step,
        joint_acceleration=joint_acceleration, angular_acceleration_in_imu=np.outer(rates, left) @ mounting,
        acceleration_in_imu=np.array(at_imu) @ mounting,
        up_in_imu=np.array([upward(angle) for _, angle, _ in states]) @ mounting,
    )  # fmt: skip


def rolling_feet(robot, diagonal, position, velocity, turning, normal):
    """Compute both contact points, their velocities over the floor and the base's velocity, in base axes, with Pinocchio.

    The two stance feet roll on the floor as spheres.
    """
    model, data = robot.pinocchio, robot.pinocchio.createData()
    pin.forwardKinematics(model, data, robot.configuration(position), np.concatenate([np.zeros(3), turning, velocity]))
    pin.updateFramePlacements(model, data)
    contacts, speeds, base = [], [], []
    for foot in sides(diagonal):
        leg = robot.legs[LEG_NAMES[foot]]
        speed = pin.getFrameVelocity(model, data, leg.foot_frame_id, pin.LOCAL_WORLD_ALIGNED)
        to_centre = leg.foot_radius * normal
        contacts.append(data.oMf[leg.foot_frame_id].translation - to_centre)
        speeds.append(np.cross(speed.angular, to_centre))
        base.append(speeds[-1] - speed.linear)
    return contacts, speeds, np.mean(base, axis=0)


def wandering(momentum):
    """Return the root mean square variation of a constant of motion."""
    return float(np.std(momentum))


def contact_jacobian(robot, q, down=None, lifted=None):
    """Return the (12, 6 + nj) Jacobian of the contact points, by default on the plane of the standing feet.

    The rows of a lifted leg, given by name, are zero.
    """
    model = robot.pinocchio.copy()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    centres = np.array([data.oMf[leg.foot_frame_id].translation for leg in robot.legs.values()])
    if down is None:
        on_floor = centres[[name != lifted for name in robot.legs]]
        normal = np.linalg.svd(on_floor - on_floor.mean(axis=0))[2][2]
        down = normal * np.sign(normal @ centres.mean(axis=0))  # the base is above its feet
    frames = []
    for leg in robot.legs.values():
        touching = data.oMf[leg.foot_frame_id].translation + leg.foot_radius * down
        in_link = data.oMi[leg.joint_ids[-1]].actInv(touching)
        frame = pin.Frame(f"touch_{leg.name}", leg.joint_ids[-1], pin.SE3(np.eye(3), in_link), pin.FrameType.OP_FRAME)
        frames.append(model.addFrame(frame))
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    found = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in frames]
    return np.concatenate([(name != lifted) * one for name, one in zip(robot.legs, found, strict=True)])


def moving_robot(robot, seed, still=False, lifted=None, spread=0.2):
    """Return random samples of a moving robot with random contact forces, and the links' torques.

    A lifted leg, given by name, has no contact force. Joint positions differ from the nominal stance by a spread [rad].
    """
    generator, joints = np.random.default_rng(seed), len(robot.joint_names)
    mounting, arm = np.array(robot.imu_in_base.rotation), np.array(robot.imu_in_base.translation)
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)  # accelerations are specific forces
    data = model.createData()
    rows = []
    for _ in range(SAMPLES):
        position = nominal_stance(robot).joint_position + spread * generator.standard_normal(joints)
        size = 0.0 if still else 1.0
        velocity, acceleration = size * generator.standard_normal(joints), 10 * size * generator.standard_normal(joints)
        turning, turning_rate = size * generator.standard_normal(3), 8 * size * generator.standard_normal(3)
        force_at_base = np.array([0.3, -0.5, 9.7]) + size * generator.standard_normal(3)
        at_imu = force_at_base + np.cross(turning_rate, arm) + np.cross(turning, np.cross(turning, arm))
        q = robot.configuration(position)
        v, a = (
            np.concatenate(parts)
            for parts in ((np.zeros(3), turning, velocity), (force_at_base, turning_rate, acceleration))
        )
        needed = pin.rnea(model, data, q, v, a)
        jacobian = contact_jacobian(robot, q, lifted=lifted)
        force = 30 * generator.standard_normal(12)
        force += np.linalg.pinv(jacobian.T[:6]) @ (needed[:6] - jacobian.T[:6] @ force)  # the feet carry the base
        torque = needed - jacobian.T @ force
        assert np.abs(torque[:6]).max() < 1e-9
        rows.append((position, velocity, acceleration, torque[6:], turning, turning_rate, at_imu))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return TorqueSamples(*columns[:4], *(column @ mounting for column in columns[4:]), np.full(SAMPLES, 2e-3),
                         np.tile([leg != lifted for leg in robot.legs], (SAMPLES, 1)))  # fmt: skip
