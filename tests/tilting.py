"""Motions whose physics is known: what tests of the precise method hold its equations against."""

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from equipoise import nominal_stance
from equipoise.precise.measurements.lift_samples import LiftSamples
from equipoise.precise.measurements.torque_balance import TorqueSamples
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, LEG_NAMES

GRAVITY = 9.81
SAMPLES = 4


def about(axis, angles):
    """(n, 3, 3) rotations about an axis."""
    return Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()


def sides(diagonal):
    """Indices of the left and the right foot of a diagonal."""
    left, right = DIAGONALS[diagonal] if DIAGONALS[diagonal][0][1] == "L" else DIAGONALS[diagonal][::-1]
    return LEG_NAMES.index(left), LEG_NAMES.index(right)


def lift_samples(robot, diagonal, position, velocity, turning, **changes):
    """Samples in an IMU mounted as the robot says, at rest attitude if nothing else is said; noise of no interest."""
    count = len(position)
    mounting = np.array(robot.imu_in_base.rotation)
    values = {
        "start": 0.0,
        "step": 0.01,
        "angular_acceleration_in_imu": np.zeros((count, 3)),
        "rotation_to_rest": np.tile(np.eye(3), (count, 1, 1)),
        "rest_acceleration_in_imu": GRAVITY * mounting[2],
        "rest_attitude_noise": 4e-4,
        "velocity_noise": 1e-4 * np.eye(count),
        "angular_velocity_noise": 1e-6 * np.eye(count),
        "gyro_density": 1e-4,
        "since_rest": 0.2,
        **changes,
    }
    return LiftSamples(
        diagonal, joint_position=position, joint_velocity=velocity, angular_velocity_in_imu=turning @ mounting, **values
    )


def pendulum(
    robot, joint_position, diagonal, up, rate=0.2, radius=None, duration=0.3, late=0.0, step=0.005, resistance=0.0
):
    """A lift trial of a robot with locked joints that topples about its line, its two feet rolling as one cylinder.

    Lagrange's equation with the tilt as the only coordinate. Nothing of it is how the estimator does it: forces are
    eliminated by the energy, not by a moment balance.

    Args:
        up: (3,) against gravity at rest, in base axes; the line must be level there.
        rate: about the line at the start, where the robot leans as at rest [rad/s].
        radius: of the feet; default the robot's [m].
        late: by how much IMU samples are younger than the joints' [s].
        resistance: by which length behind its weight the feet carry the rolling robot [m].
    """
    data, model = robot.pinocchio.createData(), robot.pinocchio
    pin.framesForwardKinematics(model, data, robot.configuration(joint_position))
    left_foot, right_foot = (
        np.array(data.oMf[robot.legs[LEG_NAMES[i]].foot_frame_id].translation) for i in sides(diagonal)
    )
    left = (left_foot - right_foot) / np.linalg.norm(left_foot - right_foot)
    assert abs(left @ up) < 1e-3
    radius = robot.legs[LEG_NAMES[sides(diagonal)[0]]].foot_radius if radius is None else radius
    body = composite_parameters(robot, joint_position)
    arm, about_com = body.com - right_foot, left @ body.inertia @ left

    def over(angle):
        upward = about(left, [-angle])[0] @ up
        return arm @ upward, arm @ np.cross(left, upward)

    def acceleration(angle, speed):
        height, ahead = over(angle)
        inertia = about_com + body.mass * ((radius + height) ** 2 + ahead**2)
        return body.mass * (ahead * (GRAVITY + radius * speed**2) - resistance * GRAVITY) / inertia

    time = step * np.arange(round(duration / step) + 1)
    whole = solve_ivp(
        lambda _, state: [state[1], acceleration(*state)], (0, duration + late), [0.0, rate], rtol=1e-10, atol=1e-12,
        dense_output=True,
    ).sol  # fmt: skip
    angle, speed = whole(time + late)
    rates = [acceleration(*state) for state in zip(angle, speed, strict=True)]
    mounting = np.array(robot.imu_in_base.rotation)
    turned = mounting.T @ about(left, angle) @ mounting
    return lift_samples(
        robot, diagonal, np.tile(joint_position, (len(time), 1)), np.zeros((len(time), len(joint_position))),
        np.outer(speed, left), step=step, rotation_to_rest=turned, rest_acceleration_in_imu=GRAVITY * mounting.T @ up,
        angular_acceleration_in_imu=np.outer(rates, left) @ mounting,
    )  # fmt: skip


def wandering(momentum):
    """Root mean square of what should be constant."""
    return float(np.std(momentum))


def contact_jacobian(robot, q, down=None):
    """(12, 6 + nj) of the points where the feet touch, as frames of the legs there; by default on a floor of their own."""
    model = robot.pinocchio.copy()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    centres = np.array([data.oMf[leg.foot_frame_id].translation for leg in robot.legs.values()])
    if down is None:
        normal = np.linalg.eigh(np.cov(centres.T))[1][:, 0]
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
    return np.concatenate([pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in frames])


def moving_robot(robot, seed, still=False):
    """Samples of a robot that moves anyhow on feet that carry it with random forces, and the links' torques."""
    generator, joints = np.random.default_rng(seed), len(robot.joint_names)
    mounting, arm = np.array(robot.imu_in_base.rotation), np.array(robot.imu_in_base.translation)
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)  # accelerations are what an accelerometer feels
    data = model.createData()
    rows = []
    for _ in range(SAMPLES):
        position = nominal_stance(robot).joint_position + 0.2 * generator.standard_normal(joints)
        size = 0.0 if still else 1.0
        velocity, acceleration = size * generator.standard_normal(joints), 10 * size * generator.standard_normal(joints)
        turning, turning_rate = size * generator.standard_normal(3), 8 * size * generator.standard_normal(3)
        felt = np.array([0.3, -0.5, 9.7]) + size * generator.standard_normal(3)
        at_imu = felt + np.cross(turning_rate, arm) + np.cross(turning, np.cross(turning, arm))
        q = robot.configuration(position)
        v, a = (
            np.concatenate(parts) for parts in ((np.zeros(3), turning, velocity), (felt, turning_rate, acceleration))
        )
        needed = pin.rnea(model, data, q, v, a)
        jacobian = contact_jacobian(robot, q)
        force = 30 * generator.standard_normal(12)
        force += np.linalg.pinv(jacobian.T[:6]) @ (needed[:6] - jacobian.T[:6] @ force)  # the feet carry the base
        torque = needed - jacobian.T @ force
        assert np.abs(torque[:6]).max() < 1e-9
        rows.append((position, velocity, acceleration, torque[6:], turning, turning_rate, at_imu))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return TorqueSamples(*columns[:4], *(column @ mounting for column in columns[4:]), np.full(SAMPLES, 2e-3))
