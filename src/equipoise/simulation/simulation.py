"""Simulated robot in one call: model, platform, and ground truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.platform.engines import ENGINES
from equipoise.robot.inertial import RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import Contacts, EffectSizes, Noise, sizes_of
from equipoise.simulation.ground_truth_view import GroundTruth
from equipoise.simulation.payload import Payload
from equipoise.simulation.simulated import SimulatedPlatform, Start


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulated robot. Use it as a context manager, or close the platform.

    Attributes:
        platform: platform that experiments may use.
        truth: true parameters, for evaluation only: join them to a result afterwards.
        engine_version: version of the engine.
        errors: effects that were drawn for it; for studies, not for experiments.
        ground_truth: function that returns the true state at the present moment; for evaluation only.
        push: function that applies a (3,) external force at the base's CoM from now on, in world axes [N]; None in engines
            that do not support it.
        link_truth: true values of each leg link by name, as in `equipoise.result.findings.Link`; empty in engines
            that do not provide them.
    """

    platform: SimulatedPlatform
    truth: RobotInertia
    engine_version: str
    errors: DrawnErrors
    ground_truth: Callable[[], GroundTruth]
    push: Callable[[FloatArray], None] | None = None
    link_truth: dict[str, dict[str, float]] = field(default_factory=dict[str, "dict[str, float]"])

    @property
    def truth_of_parts(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return true values of each part by name for a result: of "motors", and of "links" if the engine provides them.

        The values of motors are those of `equipoise.result.findings.Motor`.
        """
        joints = self.platform.joint_names
        gain, armature = self.errors.torque_gain, np.full(len(joints), self.errors.sizes.armature)
        mean, period = float(gain.mean()), self.platform.control_period
        late = self.errors.sizes.command_delay + self.errors.sizes.sensor_delay
        columns = {
            "coulomb_friction": self.errors.coulomb_friction / mean,
            "viscous_friction": self.errors.viscous_friction / mean,
            "stribeck_friction": self.errors.sizes.stribeck * self.errors.coulomb_friction / mean,
            "armature": armature / mean,
            "relative_gain": gain / mean - 1,
            # A sample contains the last command that acted before it.
            "delay": np.full(len(joints), period * np.ceil(late / period - 1e-9)),
        }
        motors = {joint: {name: float(of[i]) for name, of in columns.items()} for i, joint in enumerate(joints)}
        return {"motors": motors, "links": self.link_truth}

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.platform.close()


def simulate(
    robot: RobotModel,
    preset: Noise | EffectSizes = "realistic",
    payload: Payload | str | None = None,
    seed: int = 0,
    start: Start = "standing",
    timestep: float | None = None,
    engine: str = "mujoco",
    noise_seed: int | None = None,
    effects: Mapping[str, float | None] | None = None,
    disabled_effects: Sequence[str] = (),
    contact_model: Contacts = "default",
) -> Simulation:
    """Return a robot in a physics engine, with the effects of a preset or given ones, and an optional payload.

    Args:
        preset: a preset, scaled to the robot, or effects, which are not scaled; "ideal" has none.
        payload: payload on the base; as text it is MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ.
        seed: seed of everything drawn. Robots of the same seed have the same errors in all engines.
        start: posture with which the robot begins.
        timestep: time step of the engine [s]; default: the engine's own choice, 0.5 ms or less.
        engine: name of the engine: "mujoco", or one that a package adds, such as "dart".
        noise_seed: seed of the noise alone, for several runs of one robot; default `seed`.
        effects: additional effects, or other sizes: a size by name, or None for the size when it is simulated alone.
        disabled_effects: names of effects that are left out.
        contact_model: contact parameters of the feet: "default" uses the effects, "file" uses the model file (an MJCF) and
            a floor with MuJoCo's defaults. With "file", effects on feet and floor have no influence, except slope,
            heights, and shapes and positions of feet.

    Raises:
        MissingDependencyError: the engine is not installed.
        SettingsError: a setting is invalid, the time step is too long, the robot cannot carry the payload, or the effect
            does not exist or is not supported by the engine.
    """
    if start not in ("standing", "lying"):
        raise SettingsError(f"a robot starts 'standing' or 'lying', not {start!r}")
    build_robot = ENGINES[engine]
    if contact_model not in ("default", "file"):
        raise SettingsError(f"contact model {contact_model!r} does not exist; use 'default' or 'file'")
    if isinstance(payload, str):
        payload = Payload.parse(payload)
    if payload is not None:
        payload.check(robot)
    stance = nominal_stance(robot)
    sizes = sizes_of(preset, stance.scale, effects or {}, disabled_effects)
    sizes.check_supported_by(engine)
    errors = DrawnErrors.draw(sizes, len(robot.joint_names), seed, noise_seed)
    return build_robot(robot, stance, errors, payload, start, timestep, contact_model)


def build(
    robot: RobotModel,
    stance: Stance,
    errors: DrawnErrors,
    payload: Payload | None,
    start: Start,
    timestep: float | None,
    contacts: Contacts,
) -> Simulation:
    """Return a simulated robot in MuJoCo.

    Args:
        stance: nominal stance of the robot.
        errors: effects that were drawn for it.
        payload: payload on the base.
        start: posture with which the robot begins.
        timestep: time step of the engine [s]; None: the engine's own choice.
        contacts: law of contacts between feet and floor, as in `simulate`.

    Raises:
        MissingDependencyError: MuJoCo is not installed.
        SettingsError: the time step is too long.
    """
    try:
        import mujoco  # noqa: PLC0415 - only this engine needs it

        from equipoise.simulation.mujoco import MujocoPlatform  # noqa: PLC0415
        from equipoise.simulation.mujoco_model import TIMESTEP, build_simulated_robot  # noqa: PLC0415
        from equipoise.simulation.mujoco_truth import ground_truth_of, link_truth, simulated_truth  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingDependencyError("simulation needs MuJoCo: pip install 'equipoise[simulation]'") from error
    timestep = TIMESTEP if timestep is None else timestep
    simulated = build_simulated_robot(robot, stance, errors, payload, timestep, contacts)
    truth = simulated_truth(robot, simulated, stance.joint_position)
    data = mujoco.MjData(simulated.model)
    platform = MujocoPlatform(robot, simulated, stance, start, data=data)
    push = platform._push  # pyright: ignore[reportPrivateUsage] - a calibration must not see it
    ground_truth, links = ground_truth_of(robot, simulated, data), link_truth(robot, simulated)
    return Simulation(platform, truth, mujoco.__version__, errors, ground_truth, push, links)
