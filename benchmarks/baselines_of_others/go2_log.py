"""A real Go2's log: joint positions that were predicted from commands, with motors fitted on the other half of the log.

The log is datasets/go2/traj_0.pt of https://github.com/iit-DLSLab/sim2real-robot-identification: a Go2 in the air, its base
held, 13 triangles of all joints, each faster than the one before; commands and encoders at 200 Hz. Motors are fitted on every
other triangle. The rest is predicted by a rollout of all commands from the first sample on, which uses no later one.
"""

from __future__ import annotations

import io
import pickle
import zipfile
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines_of_others import trajectory_fit
from baselines_of_others.held_base import GRAVITY, HeldBase, JointParameters, Swing, read_swing
from equipoise import RobotModel, load_robot, nominal_stance
from equipoise.estimator.motors.equations import motor_samples
from equipoise.estimator.motors.fit import fit_motors
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.scale import Scale

FloatArray = NDArray[np.float64]

KP, KD = 20.0, 1.5  # their config.py
_LOWEST = 1e-3  # [rad] from the lowest command of a calf, where one triangle ends and the next begins


def read_tensors(path: Path) -> dict[str, FloatArray]:
    """Tensors of a file of torch by name, without torch; its pickle may rebuild tensors of floats and nothing else.

    Raises:
        pickle.UnpicklingError: it holds anything else.
    """
    with zipfile.ZipFile(path) as archive:
        root = next(name for name in archive.namelist() if name.endswith("/data.pkl")).removesuffix("data.pkl")
        return _Tensors(archive, root).load()


class _Tensors(pickle.Unpickler):
    """Read the numbers of storages from files next to the pickle."""

    def __init__(self, archive: zipfile.ZipFile, root: str) -> None:
        super().__init__(io.BytesIO(archive.read(f"{root}data.pkl")))
        self._archive, self._root = archive, root

    def find_class(self, module: str, name: str) -> Any:
        match (module, name):
            case ("torch._utils", "_rebuild_tensor_v2"):
                return _tensor
            case ("torch", "FloatStorage"):
                return np.dtype("<f4")
            case ("collections", "OrderedDict"):
                return OrderedDict
        raise pickle.UnpicklingError(f"{module}.{name} is neither a tensor nor a storage of floats")

    def persistent_load(self, pid: Any) -> FloatArray:
        _, kind, key, *_ = pid
        return np.frombuffer(self._archive.read(f"{self._root}data/{key}"), kind).astype(float)


def _tensor(
    storage: FloatArray, offset: int, shape: tuple[int, ...], stride: tuple[int, ...], *_: object
) -> FloatArray:
    steps = tuple(8 * step for step in stride)
    return np.lib.stride_tricks.as_strided(storage[offset:], shape, steps, writeable=False).copy()


def recording_of(robot: RobotModel, tensors: dict[str, FloatArray]) -> Recording:
    """As one of ours: its base is upright and at rest, which the log does not say."""
    time = 1.0 + 5e-3 * np.arange(len(tensors["time"]))  # a tenth of a microsecond from the log's
    up = GRAVITY * np.array(robot.imu_in_base.rotation)[2]
    imu = ImuStream(time, np.zeros((len(time), 3)), np.tile(up, (len(time), 1)))
    phases = ((time[0], Phase.REST), (time[1], Phase.RAMP), (time[1], Phase.SWING), (time[-1] + 1, Phase.END))
    events = [Event(at, PHASE, {"name": name}) for at, name in phases]
    begin = Event(time[0], TRIAL, MotorTrial(kp=KP, kd=KD).to_data())
    joints = JointStream(time, tensors["dof_pos"])
    return Recording(robot.joint_names, joints, imu, CommandStream(time, tensors["des_dof_pos"]), (begin, *events))


def triangles(target: FloatArray) -> NDArray[np.intp]:
    """(n,) number of the triangle of each sample, by the (n,) commands of a calf."""
    low = target < target.min() + _LOWEST
    return np.concatenate([[0], np.cumsum(low[1:] & ~low[:-1])])


def ours(robot: RobotModel, recording: Recording, scale: Scale, used: NDArray[np.bool_]) -> JointParameters:
    """`--parameters motors` of a log without torques, by only some of its samples."""
    samples, time = motor_samples(robot, [recording], scale.time), recording.phase(Phase.SWING).joints.time
    kept = np.interp(samples.time, time, used.astype(float)) > 0.5
    fit = fit_motors(robot, replace(samples, slides=samples.slides * kept[:, None]), scale)
    gain, coulomb_friction, viscous_friction, armature = fit.values[:4]
    assert fit.delay is not None
    return JointParameters(armature, viscous_friction, coulomb_friction, np.zeros_like(gain), 1 + gain, fit.delay[0])


def errors_of(world: HeldBase, parameters: JointParameters, used: NDArray[np.bool_]) -> dict[str, Any]:
    """Root mean squares of shown less seen over all joints [mrad], and what the motors are said to be."""
    left = 1e3 * (world.shown([parameters])[0] - world.swing.position)
    rms = {name: float(np.sqrt(np.mean(left[kept] ** 2))) for name, kept in (("fitted", used), ("predicted", ~used))}
    median = {
        name: float(np.median(getattr(parameters, name)))
        for name in ("coulomb_friction", "viscous_friction", "armature")
    }
    return {**rms, **median, "delay": parameters.delay}


def predict(path: Path) -> dict[str, dict[str, Any]]:
    """Return errors and median motor parameters of each fit to the log's file."""
    robot = load_robot("go2")
    scale, recording = nominal_stance(robot).scale, recording_of(robot, read_tensors(path))
    swing: Swing = read_swing(robot, recording)
    world = HeldBase(robot, swing)
    used = triangles(swing.target[-len(swing.time) :, robot.legs["FL"].joints[-1]]) % 2 == 0
    every_other = {
        "file's legs alone": JointParameters.alike(len(robot.joint_names), 0.0, 0.0, 0.0, 0.0),
        "equipoise, without torques": ours(robot, recording, scale, used),
        "trajectory fit": trajectory_fit.fit(robot, swing, scale, used),
    }
    return {name: errors_of(world, parameters, used) for name, parameters in every_other.items()}
