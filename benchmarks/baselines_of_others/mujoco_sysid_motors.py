"""Motors by `mujoco.sysid`, MuJoCo's toolbox: nonlinear least squares over rollouts, of encoders and reported torques.

    min over theta  sum |(q_simulated - q_encoder) / s_q|^2 + |(tau_simulated - tau_reported) / s_tau|^2

What the toolbox brings, and that it fits the simulated robot with the engine that made it, is said in `mujoco_sysid.py`.
Unknown are armature, viscous and Coulomb friction, encoder bias and torque gain of each joint, and one delay; the file's legs
are trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines_of_others.held_base import HeldBase, JointParameters, Swing
from baselines_of_others.mujoco_sysid import toolbox
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

FloatArray = NDArray[np.float64]

_BOUNDS = {  # on an A1: start, least, most
    "armature": (5e-3, 1e-4, 0.1),
    "viscous_friction": (0.03, 0.0, 1.0),
    "coulomb_friction": (0.2, 0.0, 3.0),
    "bias": (0.0, -0.1, 0.1),
    "gain": (1.0, 0.7, 1.4),
}
_AS_THEY_ARE = ("bias", "gain")  # on robots of all sizes
_DELAY = (3e-3, 0.0, 20e-3)  # [s]
_KEPT = 3  # one sample in so many is compared


@dataclass(frozen=True)
class SysidMotorSettings:
    """How it is used.

    Attributes:
        iterations: of the optimiser, at most; from the third to the eighth nothing moved by a thousandth on a tuning seed.
        position_sd, torque_sd: what residuals are divided by [rad], [Nm on an A1].
    """

    iterations: int = 3
    position_sd: float = 0.5e-3
    torque_sd: float = 0.3


def fit(robot: RobotModel, swing: Swing, scale: Scale, settings: SysidMotorSettings | None = None) -> JointParameters:
    """Parameters whose rollout is nearest to encoders and torques.

    Args:
        scale: of the robot; what is expected of an A1 is multiplied by it.

    Raises:
        ModuleNotFoundError: `mujoco.sysid` is not installed.
    """
    sysid, settings = toolbox(), settings or SysidMotorSettings()
    if sysid is None:
        raise ModuleNotFoundError("mujoco.sysid is not installed: pip install 'mujoco[sysid]'")
    assert swing.torque is not None
    kept = slice(None, None, _KEPT)
    swing = replace(swing, time=swing.time[kept], position=swing.position[kept], torque=swing.torque[kept])
    world = HeldBase(robot, swing)
    control = world.control(0.0)
    target = np.vstack([control, control[-1:]])  # the toolbox does not play the last row
    measured = np.hstack([swing.position, swing.torque])
    sizes = np.repeat([settings.position_sd, settings.torque_sd * scale.torque], swing.position.shape[1])
    given, step = _parameters(sysid, swing, scale), world.model.opt.timestep
    signals = {"all": (sysid.SignalType.CustomObs, np.arange(measured.shape[1]))}
    sequences = sysid.ModelSequences(
        robot.name, world.spec, ["swing"], [world.initial(_read(given))],
        [sysid.TimeSeries(step * np.arange(len(target)), target)],
        [sysid.TimeSeries.create(swing.time - swing.time[0], measured, signals)],
        allow_missing_sensors=True,
    )  # fmt: skip

    def compare(now: Any, simulated: Any, recorded: Any, *_: object, state: FloatArray) -> tuple[FloatArray, Any, Any]:
        parameters = _read(now)
        path = np.vstack([world.initial(parameters), state])
        shown = world.encoders_and_torques(parameters, path, target)
        # Commands act at once and all of the delay is the sensors': a fit cannot tell one from the other.
        return (world.sampled(shown, parameters.delay) - measured) / sizes, recorded, recorded

    residual = sysid.build_residual_fn(
        models_sequences=[sequences], build_model=lambda now, _: world.model_of(_read(now)), modify_residual=compare,
        n_threads=1,
    )  # fmt: skip
    found, _ = sysid.optimize(
        given, residual, optimizer="mujoco", verbose=False, max_iters=settings.iterations, x_scale="jac"
    )
    return _read(found)


def _parameters(sysid: Any, swing: Swing, scale: Scale) -> Any:
    joints, found = swing.position.shape[1], sysid.ParameterDict()
    for name, values in _BOUNDS.items():
        size = 1.0 if name in _AS_THEY_ARE else scale.torque
        found.add(sysid.Parameter(name, *(np.full(joints, size * value) for value in values)))
    found.add(sysid.Parameter("delay", *(np.array([value]) for value in _DELAY)))
    return found


def _read(given: Any) -> JointParameters:
    values = {name: np.array(given[name].value) for name in _BOUNDS}
    return JointParameters(**values, delay=float(given["delay"].value[0]))
