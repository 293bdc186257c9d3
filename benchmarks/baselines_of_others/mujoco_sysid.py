"""`mujoco.sysid`: MuJoCo's toolbox, which fits a simulation to recordings by nonlinear least squares over rollouts.

    min over theta  sum |W (simulated sensors(theta) - recorded sensors)|^2 + |(theta - theta_0) / s|^2

https://github.com/google-deepmind/mujoco/tree/main/python/mujoco/sysid (`pip install 'mujoco[sysid]'`). The toolbox brings the
parametrisation of a body's inertia (log-Cholesky), the rollouts, their derivatives by finite differences and the optimiser;
what is here is what a user of it writes: the model with its floor, feet, joint control and sensors, the commands and states
that rollouts start from, what is unknown, and how sensors see it.

It is given more than any other peer: the simulated robot is made by the same engine, step, contacts and joint control as
its model, its delays are known, and so are all positions and torques that were commanded. On a real robot none of that is
exact. Unknown are the base's ten parameters, friction, damping and armature of all joints; with `biases` the joint offsets,
the
IMU's tilt and the floor's slope; with `gains` the motors' torque gains; all with priors of the sizes that they have. Rollouts
begin at rest, after a while of holding still, so that no initial velocity has to be known.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baselines_of_others.filtered import kind_of
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import InertialParameters, composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation import mujoco_model
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import IDEAL, REALISTIC
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.mujoco_contacts import add_contacts

FloatArray = NDArray[np.float64]

_DELAY = 2e-3  # [s] of commands and of sensors, which is given
_PERIOD = 2e-3  # [s] between commands
_HOLD = 0.5  # [s] of standing still before a recording begins
_BLOCK = 5  # samples that are averaged
_BOUND = 0.15  # of joint offsets, tilt, slope [rad] and gains
_LARGEST = 20.0  # residuals beyond are of a robot that fell over; they would hide all others
_A1_MASS = 12.5  # [kg]


@dataclass(frozen=True)
class SysidSettings:
    """How it is used; the defaults are the best of the few that were tried by hand on tuning seeds.

    Attributes:
        shake: how much of the shake is given [s].
        lifts: how many of the Bayesian run's lifts.
        biases: whether joint offsets, IMU tilt and floor slope are unknown too.
        gains: with `biases`, whether every motor's torque gain is unknown too.
        iterations: of the optimiser, at most.
        position_sd, gyro_sd, accelerometer_sd, torque_sd: what the residuals are divided by: the model's errors more than
            the sensors' noise [rad], [rad/s], [m/s2], [Nm on an A1].
    """

    shake: float = 4.0
    lifts: int = 4
    biases: bool = True
    gains: bool = True
    iterations: int = 4
    position_sd: float = 1e-3
    gyro_sd: float = 0.02
    accelerometer_sd: float = 0.3
    torque_sd: float = 0.5


def toolbox() -> ModuleType | None:
    """`mujoco.sysid`, or None where it or what it needs is not installed."""
    try:
        from mujoco import sysid  # noqa: PLC0415 - optional
    except ImportError:
        return None
    return sysid if hasattr(sysid, "optimize") else None


@dataclass(frozen=True, eq=False)
class Piece:
    """One rollout.

    Attributes:
        initial: the engine's state at its beginning.
        control: (n, nu) at every engine step.
        measured: (m, 2 nj + 6) encoders, gyroscope, accelerometer, torques, from `_HOLD` on, one row per control period.
    """

    initial: FloatArray
    control: FloatArray
    measured: FloatArray


class RobotProblem:
    """The nominal robot as MuJoCo's model, its unknowns, and what it is compared with."""

    def __init__(self, robot: RobotModel, stance: Stance, settings: SysidSettings) -> None:
        self.robot, self.stance, self.settings = robot, stance, settings
        self.spec = nominal_spec(robot, stance)
        self.model: mujoco.MjModel = self.spec.compile()
        joints = [self.model.joint(name).id for name in robot.joint_names]
        self.qpos, self.dof = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self.kp, self.kd = robot.gains(stance.hip_height)
        self.scale = robot.mass / _A1_MASS
        site = np.zeros(9)
        mujoco.mju_quat2Mat(site, self.model.site(mujoco_model.IMU_SITE).quat)
        self.mounting = site.reshape(3, 3)
        address = int(self.model.sensor(mujoco_model.ACCELEROMETER).adr[0])
        self.accelerometer = slice(address, address + 3)

    def parameters(self, sysid: Any) -> Any:
        """What is unknown, where it starts, and its bounds."""
        base, joints, found = self.robot.pinocchio.inertias[1], len(self.robot.joint_names), sysid.ParameterDict()
        pseudo = np.array(pin.PseudoInertia.FromInertia(base).toMatrix())
        theta = sysid.model_modifier.theta_from_pseudoinertia(pseudo)
        wide = np.array([0.5, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.2, 0.2, 0.2])
        found.add(sysid.Parameter("base", theta, theta - wide, theta + wide))
        start = np.array([0.2, 0.05, 0.01]) * self.scale
        found.add(sysid.Parameter("losses", start, 0.01 * start, 10 * start))
        if self.settings.biases:
            gains = [("gains", joints)] if self.settings.gains else []
            for name, count in (("zeros", joints), ("tilt", 3), ("slope", 2), *gains):
                found.add(sysid.Parameter(name, np.zeros(count), np.full(count, -_BOUND), np.full(count, _BOUND)))
        return found

    def build(self, sysid: Any, parameters: Any) -> mujoco.MjModel:
        """The compiled model with the parameters in it."""
        model = copy.copy(self.model)
        body = int(model.jnt_bodyid[0])
        inertia = self.base(sysid, parameters)
        moments, axes = np.linalg.eigh(inertia.inertia)
        axes[:, 2] *= np.linalg.det(axes)
        model.body_mass[body], model.body_ipos[body], model.body_inertia[body] = inertia.mass, inertia.lever, moments
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.reshape(9))
        gain = self.gains(parameters)  # a motor's own loop is wrong by the same factor as the torque it reports
        mujoco_model.set_joints(model, self.dof, gain * self.kp, gain * self.kd, tuple(parameters["losses"].value))
        if self.settings.biases:
            model.actuator_biasprm[:, 0] = -self.kp * gain * parameters["zeros"].value  # it closes on the encoders
            slope = parameters["slope"].value
            down = np.array([slope[0], slope[1], -1.0])
            model.opt.gravity[:] = 9.81 * down / np.linalg.norm(down)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def gains(self, parameters: Any) -> FloatArray:
        """(nj,) true over reported torque."""
        joints = len(self.robot.joint_names)
        return 1 + parameters["gains"].value if self.settings.biases and self.settings.gains else np.ones(joints)

    def base(self, sysid: Any, parameters: Any) -> pin.Inertia:
        """The base's inertia."""
        pi = sysid.model_modifier.pi_from_theta(parameters["base"].value)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = pi[4:].reshape(3, 3)
        return pin.Inertia.FromDynamicParameters(np.array([*pi[:4], xx, xy, yy, xz, yz, zz]))

    def seen(self, parameters: Any, state: FloatArray, sensors: FloatArray, count: int) -> FloatArray:
        """(count, 2 nj + 6) what the robot's sensors would show, one row per control period from `_HOLD` on."""
        model, step = self.model, self.model.opt.timestep
        # Row i of the states is at (i + 1) step, of the sensors at i step: rollouts keep what a step began with.
        ticks = np.round((_HOLD - _DELAY + _PERIOD * np.arange(count)) / step).astype(int)
        position = state[ticks - 1][:, 1 + self.qpos]
        speeds = state[:, 1 + model.nq : 1 + model.nq + model.nv]
        turning = (speeds[ticks - 1] + speeds[ticks])[:, 3:6] / 2 @ self.mounting
        felt, torque = sensors[ticks][:, self.accelerometer], sensors[ticks][:, : model.nu]
        torque = torque / self.gains(parameters) - self.kd * (speeds[ticks] - speeds[ticks - 1])[:, self.dof]
        if self.settings.biases:
            tilt = np.array(pin.exp3(parameters["tilt"].value))
            position, turning, felt = position + parameters["zeros"].value, turning @ tilt, felt @ tilt
        return np.concatenate([position, turning, felt, torque], axis=1)

    @property
    def stds(self) -> FloatArray:
        """(2 nj + 6,) what residuals are divided by."""
        s, joints = self.settings, len(self.robot.joint_names)
        sizes = [s.position_sd, s.gyro_sd, s.accelerometer_sd, s.torque_sd * self.scale]
        return np.repeat(sizes, [joints, 3, 3, joints])

    def prior(self, sysid: Any, parameters: Any, mass: tuple[float, float] | None) -> FloatArray:
        """Return the residuals of the prior."""
        rows = [np.zeros(0)]
        if self.settings.biases:
            sizes = REALISTIC.joint_offset, REALISTIC.imu_tilt, REALISTIC.floor_slope
            rows += [parameters[name].value / s for name, s in zip(("zeros", "tilt", "slope"), sizes, strict=True)]
            if self.settings.gains:
                rows.append(parameters["gains"].value / REALISTIC.torque_gain)
        if mass is not None:
            of_legs = self.robot.mass - self.robot.pinocchio.inertias[1].mass
            rows.append(np.array([(self.base(sysid, parameters).mass + of_legs - mass[0]) / mass[1]]))
        return np.concatenate(rows)


def estimate(
    robot: RobotModel,
    recordings: Sequence[Recording],
    feed_forward: Sequence[tuple[FloatArray, FloatArray]],
    stance: Stance,
    settings: SysidSettings,
    mass: tuple[float, float] | None = None,
) -> InertialParameters:
    """The whole robot at a stance.

    Args:
        recordings: the shake, then the Bayesian run's.
        feed_forward: for each of them, times [s] and (n, nj) torques [Nm] of the commands of its run.
        mass: of the whole robot from a scale and its standard deviation [kg], or None.

    Raises:
        ModuleNotFoundError: `mujoco.sysid` is not installed.
    """
    sysid = toolbox()
    if sysid is None:
        raise ModuleNotFoundError("mujoco.sysid is not installed: pip install 'mujoco[sysid]'")
    problem = RobotProblem(robot, stance, settings)
    pieces = read_pieces(problem, recordings, feed_forward)
    parameters = problem.parameters(sysid)
    joints = {"all": (sysid.SignalType.CustomObs, np.arange(pieces[0].measured.shape[1]))}

    def series(values: FloatArray, step: float) -> Any:
        return sysid.TimeSeries.create(step * np.arange(len(values)), values, joints)

    step = problem.model.opt.timestep
    sequences = sysid.ModelSequences(
        robot.name,
        problem.spec,
        [str(index) for index in range(len(pieces))],
        [piece.initial for piece in pieces],
        [sysid.TimeSeries(step * np.arange(len(piece.control)), piece.control) for piece in pieces],
        [series(piece.measured, _PERIOD) for piece in pieces],
        allow_missing_sensors=True,
    )

    def compare(
        given: Any, simulated: Any, measured: Any, *_: object, state: FloatArray
    ) -> tuple[FloatArray, Any, Any]:
        shown = problem.seen(given, state, simulated.data, len(measured.data))
        left = (measured.data - shown)[: len(shown) // _BLOCK * _BLOCK]
        means = left.reshape(-1, _BLOCK, left.shape[1]).mean(axis=1) / problem.stds
        return np.clip(means, -_LARGEST, _LARGEST), measured, measured

    rollouts = sysid.build_residual_fn(
        models_sequences=[sequences],
        build_model=lambda given, spec: problem.build(sysid, given),
        modify_residual=compare,
        n_threads=1,
    )

    def residuals(x: FloatArray, given: Any, **options: object) -> tuple[list[FloatArray], Any, Any]:
        parts, *others = rollouts(x, given, **options)
        columns = []
        for column in x.reshape(len(x), -1).T:
            given.update_from_vector(column)
            columns.append(problem.prior(sysid, given, mass))
        # Residuals are correlated over time: as many of them count as there are independent ones, one in ten.
        prior = np.sqrt(10.0) * np.array(columns).T
        return [*parts, prior.ravel() if x.ndim == 1 else prior], *others

    found, _ = sysid.optimize(
        parameters, residuals, optimizer="mujoco", verbose=False, max_iters=settings.iterations, x_scale="jac"
    )
    return composite_parameters(robot.with_base(problem.base(sysid, found)), stance.joint_position)


def nominal_spec(robot: RobotModel, stance: Stance) -> mujoco.MjSpec:
    """The robot of the model file on a floor, with the joint control, feet and IMU of the simulated one."""
    sizes = dataclasses.replace(IDEAL, floor_friction=REALISTIC.floor_friction)
    errors = DrawnErrors.draw(sizes, len(robot.joint_names), 0)
    spec = mujoco_model._read(robot.source)
    base = mujoco_model._floating_base(spec)
    mujoco_model._strip(spec)
    mujoco_model._weld_locked_joints(spec, robot)
    add_contacts(spec, robot, stance, base, errors, LegErrors.of(robot, stance, errors), "default")
    mujoco_model._add_actuators_and_sensors(spec, robot, base, errors)
    mujoco_model.set_options(spec, mujoco_model.TIMESTEP)
    spec.option.gravity = [0, 0, -9.81]
    return spec


def read_pieces(
    problem: RobotProblem,
    recordings: Sequence[Recording],
    feed_forward: Sequence[tuple[FloatArray, FloatArray]],
) -> list[Piece]:
    """The shake's beginning, and lifts of both diagonals in postures as different as there are."""
    settings = problem.settings
    lifts = [i for i, r in enumerate(recordings) if kind_of(r) == "lift" and r.complete]
    chosen = [lifts[i] for i in np.unique(np.linspace(0, len(lifts) - 1, settings.lifts).astype(int))] if lifts else []
    pieces: list[Piece] = []
    for index, recording in enumerate(recordings):
        if kind_of(recording) == "shake":
            start = float(recording.phase("rest").joints.time[0])
            part = recording.between(start, start + settings.shake)
        elif index in chosen:
            part = recording.phase("rest", until="lower")
        else:
            continue
        bias = recording.phase("rest").imu.angular_velocity_in_imu.mean(axis=0)
        pieces.append(_piece(problem, part, recording.phase("rest"), bias, *feed_forward[index]))
    return pieces


def _piece(
    problem: RobotProblem, part: Recording, rest: Recording, bias: FloatArray, time: FloatArray, torque: FloatArray
) -> Piece:
    robot, joints, imu, commands = problem.robot, part.joints, part.imu, part.commands
    assert commands is not None
    assert joints.torque is not None
    sent = commands.position + torque[np.searchsorted(time, commands.time - 1e-6)] / problem.kp
    step = problem.model.opt.timestep
    count = round((_HOLD + _PERIOD * len(sent)) / step)
    which = np.floor((step * np.arange(count) - _HOLD - _DELAY) / _PERIOD + 1e-6).astype(int)
    control = sent[np.clip(which, 0, len(sent) - 1)]
    up = np.array(robot.imu_in_base.rotation) @ rest.imu.acceleration_in_imu.mean(axis=0)
    position = rest.joints.position.mean(axis=0)
    turn = pin.Quaternion.FromTwoVectors(up / np.linalg.norm(up), np.array([0.0, 0, 1]))
    radius = np.mean([leg.foot_radius for leg in robot.legs.values()])
    lowest = float(np.mean((foot_positions(robot, position) @ turn.matrix().T)[:, 2])) - float(radius)
    data = mujoco.MjData(problem.model)
    data.qpos[:7] = [0, 0, -lowest, turn.w, turn.x, turn.y, turn.z]
    data.qpos[problem.qpos] = position
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(problem.model, kind))
    mujoco.mj_getState(problem.model, data, initial, kind)
    gyro = imu.angular_velocity_in_imu - bias
    return Piece(
        initial, control, np.concatenate([joints.position, gyro, imu.acceleration_in_imu, joints.torque], axis=1)
    )
