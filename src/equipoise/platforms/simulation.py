"""A simulated robot in one call: the model, the platform on it, and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.platforms.payload import Payload
from equipoise.platforms.sensors import PRESETS, DrawnErrors, Noise, SensorErrors
from equipoise.robot.inertial import RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance

try:
    import mujoco

    from equipoise.platforms.disturbance import Disturbance
    from equipoise.platforms.mujoco import MujocoPlatform
    from equipoise.platforms.mujoco_model import build_simulated_robot
    from equipoise.platforms.truth import Witness, simulated_truth
except ModuleNotFoundError as error:
    raise MissingDependencyError("simulation needs MuJoCo: pip install mujoco") from error

_LARGEST_DAMPING = 2.0


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated robot. Use it as a context manager, or close the platform.

    Attributes:
        platform: what experiments may use.
        truth: what they may not: join it to a result afterwards.
        engine: MuJoCo's version.
        errors: what was drawn for its sensors and actuators; for studies, not for experiments.
        witness: sees what the robot really does; for judging, not for control.
        disturbance: pushes the robot, or takes a foot's hold away.
    """

    platform: MujocoPlatform
    truth: RobotInertia
    engine: str
    errors: DrawnErrors
    witness: Witness
    disturbance: Disturbance

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.platform.close()


def simulate(
    robot: RobotModel,
    noise: Noise | SensorErrors = "ideal",
    payload: Payload | str | None = None,
    seed: int = 0,
    start: Literal["standing", "lying"] = "standing",
    timestep: float | None = None,
) -> Simulation:
    """A robot in MuJoCo, with sensor and actuator errors, perhaps a payload.

    Args:
        noise: a preset, scaled to the robot's m g h, or errors of one's own, taken as they are.
        payload: on the base; as text it is MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ.
        seed: of everything drawn.
        start: how the robot begins.
        timestep: of the engine [s]; default 0.5 ms, less for legs so light that their damping would not be stable.
    """
    if isinstance(noise, str) and noise not in PRESETS:
        raise SettingsError(f"noise {noise!r} is not known; it is one of {', '.join(PRESETS)}, or SensorErrors")
    if start not in ("standing", "lying"):
        raise SettingsError(f"a robot starts 'standing' or 'lying', not {start!r}")
    if isinstance(payload, str):
        payload = Payload.parse(payload)
    stance = nominal_stance(robot)
    sizes = PRESETS[noise].scaled_to(robot.torque_scale(stance.hip_height)) if isinstance(noise, str) else noise
    errors = DrawnErrors.draw(sizes, len(robot.joint_names), seed)
    if timestep is None:
        timestep = stable_timestep(robot, stance, sizes.armature)
    simulated = build_simulated_robot(robot, stance, errors, payload, timestep)
    truth = simulated_truth(robot, simulated, stance.joint_position)
    data = mujoco.MjData(simulated.model)
    disturbance = Disturbance(simulated)
    platform = MujocoPlatform(robot, simulated, stance, start, data=data, disturbance=disturbance)
    return Simulation(platform, truth, mujoco.__version__, errors, Witness(robot, simulated, data), disturbance)


def stable_timestep(robot: RobotModel, stance: Stance, armature: float = 0.0) -> float:
    """0.5 ms, or 0.25 ms where the joints' damping would not be stable in contact [s].

    At 1 ms the planted feet of an A1 that shakes its body give way by what half a millisecond's delay would look like.

    A damping kd takes the fraction kd h / I of a joint's speed in a step h. Up to 1.4, the largest of the catalogue (HyQ),
    robots stand still; at 3.9 (Spirit 40, whose shanks weigh 90 g) the feet chatter and the robot wanders off.
    """
    inertia = pin.crba(robot.pinocchio, robot.pinocchio_data, robot.configuration(stance.joint_position))
    _, kd = robot.gains(stance.hip_height)
    lightest = float(np.diag(inertia)[6:].min()) + armature
    return 0.5e-3 if kd * 0.5e-3 <= _LARGEST_DAMPING * lightest else 0.25e-3
