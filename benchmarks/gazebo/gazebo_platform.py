"""Simulated robot in Gazebo 11 with ODE: Gazebo's own reader, joints, contacts and IMU."""

from __future__ import annotations

import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from worlds.urdf import urdf

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import MotionError
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import EffectSizes
from equipoise.simulation.leg_errors import in_frame_of_hips
from equipoise.simulation.payload import Payload
from equipoise.simulation.simulated import SimulatedPlatform
from gazebo.root import SERVER, inside, prepare_root

LACKS: tuple[str, ...] = ("armature", "cable", *(row.name for row in EffectSizes.rows() if row.engines == ("mujoco",)))
"""Effects that are not simulated."""
_OF_IMU = ("gyro_noise", "gyro_bias", "accelerometer_noise", "accelerometer_bias")  # simulated by Gazebo's sensor
_PERIOD = 2e-3  # [s], of commands
_PATIENCE = 120.0  # [s] for an answer; the longest motion at once takes a few seconds


@dataclass(frozen=True)
class Ode:
    """Settings of ODE; the defaults are Gazebo's.

    Attributes:
        solver: "quick" (iterative) or "world" (exact).
        iters: number of iterations of "quick".
        friction_model: "pyramid_model", "box_model" or "cone_model".
        kp, kd: stiffness [N/m] and damping [N s/m] of contacts.
        max_vel: largest velocity that corrects a penetration [m/s].
        step: time step [s].
        difference: weight of the newest difference of positions in joint velocities, 0.65 in Unitree's joint controller;
            0: velocities are Gazebo's.
    """

    solver: str = "quick"
    iters: int = 50
    friction_model: str = "pyramid_model"
    kp: float = 1e12
    kd: float = 1.0
    max_vel: float = 0.01
    step: float = 1e-3
    difference: float = 0.0


class GazeboPlatform(SimulatedPlatform):
    """A quadruped in Gazebo: joint PD at every step, spherical feet on a plane, other links without collisions.

    Velocities and the IMU's values are those after the last step, as Gazebo's own plugins report them.

    Args:
        robot: model that the estimator has.
        sizes: effects, without those in `LACKS`.
        payload: payload on the base.
        seed: seed of all errors.
        ode: settings of the engine.

    Attributes:
        truth: true parameters at the nominal stance, from the links that Gazebo has loaded.
    """

    truth: RobotInertia

    def __init__(
        self, robot: RobotModel, sizes: EffectSizes, payload: Payload | None, seed: int, ode: Ode | None = None
    ) -> None:
        stance, joints, ode = nominal_stance(robot), len(robot.joint_names), ode or Ode()
        errors = DrawnErrors.draw(sizes.without_effects(_OF_IMU), joints, seed)
        kp, kd = (np.full(joints, gain) for gain in robot.gains(stance.hip_height))
        super().__init__(robot, errors, kp, kd, ode.step, _PERIOD)
        self._files = TemporaryDirectory(dir=prepare_root() / "tmp")
        file = Path(self._files.name, "robot.urdf")
        root = urdf(robot, stance, errors, payload)
        _add_extensions(root, robot, errors, sizes, ode)
        ElementTree.ElementTree(root).write(file)
        read = ["gz", "sdf", "-p", f"/tmp/{file.parent.name}/{file.name}"]
        model = ElementTree.fromstring(subprocess.run(inside(*read), capture_output=True, check=True).stdout)
        world = file.with_name("robot.world")
        world.write_text(_world(model, errors, ode), encoding="utf-8")
        self._stream, theirs = socket.socketpair()
        self._stream.settimeout(_PATIENCE)
        self._log = file.with_name("log")
        command = [
            SERVER,
            f"/tmp/{world.parent.name}/{world.name}",
            str(theirs.fileno()),
            str(seed),
            str(ode.difference),
            *robot.joint_names,
        ]
        with theirs, self._log.open("wb") as log:
            self._server = subprocess.Popen(
                inside(*command), pass_fds=[theirs.fileno()], stdout=log, stderr=log, start_new_session=True
            )
        self._now, self._held, self._up = np.zeros(self._raw_width), np.array(stance.joint_position), 1.0
        try:
            self._settle(stance, "standing")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        super().close()
        self._stream.close()
        self._server.kill()
        self._server.wait()
        self._files.cleanup()

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        self._send(0.0, base_height, joint_position, self._robot.effort_limit, self._errors.torque_gain)
        links = self._receive((len(self.joint_names) + 1) * 10).reshape(-1, 10)
        knees = 1 + np.array([leg.joints[-1] for leg in self._robot.legs.values()])
        bodies = (links, links[:1], np.delete(links, knees, axis=0))
        self.truth = RobotInertia(*(in_frame_of_hips(_sum(body), self._errors) for body in bodies))

    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        self._send(len(control), self._kp, self._kd, control)
        *rows, self._up = self._receive((len(control) + 1) * self._raw_width + 1)
        table = np.reshape(rows, (-1, self._raw_width))
        if not np.isfinite(table).all():
            raise self._became_unstable(self._periods * self.control_period)
        raw[:], self._now, self._held = table[:-1], table[-1], control[-1]

    def _raw_now(self) -> FloatArray:
        raw, joints = self._now.copy(), len(self.joint_names)
        target = self._late_control[0] if len(self._late_control) else self._held
        torque = self._kp * (target - raw[:joints]) - self._kd * raw[joints : 2 * joints]
        raw[2 * joints : -6] = np.clip(torque, -self._robot.effort_limit, self._robot.effort_limit)
        return raw

    def _base_up(self) -> float:
        return self._up

    def _set_clock_to_zero(self) -> None:
        pass

    def _turn_by(self, angle: float) -> None:
        raise NotImplementedError

    def _send(self, *values: FloatArray | float) -> None:
        self._stream.sendall(np.concatenate([np.ravel(value) for value in values]).astype(float).tobytes())

    def _receive(self, count: int) -> FloatArray:
        message = bytearray()
        while len(message) < 8 * count:
            try:
                message += (part := self._stream.recv(8 * count - len(message)))
            except TimeoutError:
                part = b""
            if not part:
                log = self._log.read_text(errors="replace")[-500:]
                raise MotionError(
                    f"the Gazebo server does not answer (exit code {self._server.poll()}); its output: {log}"
                )
        return np.frombuffer(bytes(message))


def _sum(links: FloatArray) -> InertialParameters:
    """Return (n, 10) links as one body, by the parallel axis theorem."""
    mass = links[:, 0].sum()
    com = links[:, 0] @ links[:, 1:4] / mass
    arms = links[:, 1:4] - com
    xx, yy, zz, xy, xz, yz = links[:, 4:].sum(axis=0)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia += np.einsum("n,nk,nk->", links[:, 0], arms, arms) * np.eye(3) - np.einsum(
        "n,ni,nj->ij", links[:, 0], arms, arms
    )
    return InertialParameters(float(mass), com, inertia)


def _add_extensions(
    root: ElementTree.Element, robot: RobotModel, errors: DrawnErrors, sizes: EffectSizes, ode: Ode
) -> None:
    """Add joint friction to a URDF, and the elements of Gazebo: contacts of the feet, and an IMU."""
    for number, name in enumerate(robot.joint_names):
        friction, damping = errors.coulomb_friction[number], errors.viscous_friction[number]
        joint = next(joint for joint in root.iter("joint") if joint.get("name") == name)
        ElementTree.SubElement(joint, "dynamics", friction=f"{friction}", damping=f"{damping}")
    for leg in robot.legs:
        root.append(
            ElementTree.fromstring(f'<gazebo reference="{leg}_foot">{_CONTACT_OF_URDF.format(ode=ode)}</gazebo>')
        )
    rotation = Rotation.from_matrix(np.array(robot.imu_in_base.rotation) @ np.array(pin.exp3(errors.drawn["imu_tilt"])))
    pose = " ".join(map(repr, map(float, (*robot.imu_in_base.translation, *rotation.as_euler("xyz")))))
    noise = np.sqrt(_PERIOD / ode.step)  # of a step, with the density of the preset's samples
    turn, force = (
        "".join(f"<{axis}>{_NOISE.format(noise=noise * size, bias=bias)}</{axis}>" for axis in "xyz")
        for size, bias in ((sizes.gyro_noise, sizes.gyro_bias), (sizes.accelerometer_noise, sizes.accelerometer_bias))
    )
    root.append(ElementTree.fromstring(_IMU.format(pose=pose, turn=turn, force=force)))


_CONTACT_OF_URDF = (
    "<mu1>1</mu1><mu2>1</mu2><kp>{ode.kp}</kp><kd>{ode.kd}</kd><maxVel>{ode.max_vel}</maxVel><minDepth>0</minDepth>"
)
_NOISE = (
    '<noise type="gaussian"><mean>0</mean><stddev>{noise}</stddev><bias_mean>0</bias_mean><bias_stddev>{bias}</bias_stddev>'
    "</noise>"
)
_IMU = """<gazebo reference="base"><sensor name="imu" type="imu"><always_on>1</always_on><pose>{pose}</pose><imu>
<angular_velocity>{turn}</angular_velocity><linear_acceleration>{force}</linear_acceleration></imu></sensor></gazebo>"""
_WORLD = """<sdf version="1.7"><world name="world"><gravity>{gravity}</gravity>
<physics type="ode"><max_step_size>{ode.step}</max_step_size><real_time_update_rate>0</real_time_update_rate>
<ode><solver><type>{ode.solver}</type><iters>{ode.iters}</iters><friction_model>{ode.friction_model}</friction_model></solver></ode>
</physics><model name="floor"><static>true</static><link name="link"><collision name="collision"><geometry><plane>
<normal>0 0 1</normal><size>100 100</size></plane></geometry><surface><friction><ode><mu>{mu}</mu><mu2>{mu}</mu2></ode>
</friction><contact><ode><kp>{ode.kp}</kp><kd>{ode.kd}</kd><max_vel>{ode.max_vel}</max_vel></ode></contact></surface>
</collision></link></model>{model}</world></sdf>"""


def _world(sdf: ElementTree.Element, errors: DrawnErrors, ode: Ode) -> str:
    """Return a world with a floor, and a robot as Gazebo has read it."""
    model = sdf[0]
    model.set("name", "robot")
    gravity = " ".join(repr(float(value)) for value in GRAVITY * errors.gravity_direction)
    robot = ElementTree.tostring(model, encoding="unicode")
    return _WORLD.format(gravity=gravity, ode=ode, mu=errors.floor_friction, model=robot)
