"""Motors from commands and encoders alone, by least squares over rollouts of a simulated robot whose base does not move.

    min over theta  sum |q_simulated(t; theta) - q_encoder(t)|^2

theta: armature, viscous and Coulomb friction and encoder bias of each joint, and one delay: the unknowns of PACE (Bjelonic et
al., arXiv:2509.06342), which evolves thousands of robots in parallel on a GPU; here it is Gauss-Newton with bounds, by finite
differences. Legs of a base at rest do not feel each other: one rollout moves a parameter of all legs at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from baselines_of_others.held_base import TIMESTEP, HeldBase, JointParameters, Swing
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

FloatArray = NDArray[np.float64]

QUANTITIES = ("armature", "viscous_friction", "coulomb_friction", "bias")
_START = {"armature": 5e-3, "viscous_friction": 0.03, "coulomb_friction": 0.2, "bias": 0.0}  # on an A1
_SIZES = {"armature": 5e-3, "viscous_friction": 0.03, "coulomb_friction": 0.2, "bias": 0.01}
_FIRST_DELAY, _DELAY_SIZE = 3e-3, 1e-3  # [s]
_DIFFERENCE = 0.01  # of a size, by which a parameter is moved for its derivative
_LARGEST_BIAS = 0.1  # [rad], as PACE's
_KEPT = 5  # one sample in so many is compared
_MOST_ROUNDS = 20


def fit(
    robot: RobotModel,
    swing: Swing,
    scale: Scale,
    used: NDArray[np.bool_] | None = None,
    timestep: float = TIMESTEP,
) -> JointParameters:
    """Parameters whose rollout is nearest to the encoders.

    Args:
        scale: of the robot; what is expected of an A1 is multiplied by it.
        used: (n,) which samples are compared; None: all.
        timestep: of the engine [s].
    """
    problem = _Problem(robot, swing, scale, np.ones(len(swing.time), bool) if used is None else used, timestep)
    found = least_squares(
        problem.residual, problem.start, problem.jacobian, bounds=(problem.lower, np.inf), x_scale="jac",
        max_nfev=_MOST_ROUNDS, ftol=1e-4,
    )  # fmt: skip
    return problem.parameters(found.x)


class _Problem:
    """Unknowns in units of their sizes: QUANTITIES, one after the other, of all joints, then the delay."""

    def __init__(self, robot: RobotModel, swing: Swing, scale: Scale, used: NDArray[np.bool_], timestep: float) -> None:
        kept = replace(swing, time=swing.time[::_KEPT], position=swing.position[::_KEPT])
        self.world, self.measured, self.legs = HeldBase(robot, kept, timestep), kept.position, robot.leg_joints
        self.used = used[::_KEPT]
        joints = len(robot.joint_names)
        factors = [1.0 if name == "bias" else scale.torque for name in QUANTITIES]
        sizes = [_SIZES[name] * factor for name, factor in zip(QUANTITIES, factors, strict=True)]
        self.size = np.append(np.repeat(sizes, joints), _DELAY_SIZE)
        start = [_START[name] * factor for name, factor in zip(QUANTITIES, factors, strict=True)]
        self.start = np.append(np.repeat(start, joints), _FIRST_DELAY) / self.size
        self.lower = np.append(np.repeat([1e-3, 0, 0, -_LARGEST_BIAS / _SIZES["bias"]], joints), 0.0)

    def parameters(self, x: FloatArray) -> JointParameters:
        values = x * self.size
        per_joint = dict(zip(QUANTITIES, values[:-1].reshape(len(QUANTITIES), -1), strict=True))
        return JointParameters(**per_joint, gain=np.ones(self.measured.shape[1]), delay=float(values[-1]))

    def residual(self, x: FloatArray) -> FloatArray:
        return (self.world.shown([self.parameters(x)])[0] - self.measured)[self.used].ravel()

    def jacobian(self, x: FloatArray) -> FloatArray:
        groups = list(self._groups())
        moved = [x + _DIFFERENCE * np.isin(np.arange(x.size), list(group)) for group in groups]
        here, *shown = self.world.shown([self.parameters(one) for one in (x, *moved)])
        rows = np.zeros((*here.shape, x.size))
        for group, seen in zip(groups, shown, strict=True):
            change = (seen - here) / _DIFFERENCE
            for column, joints in group.items():
                rows[:, joints, column] = change[:, joints]
        return rows[self.used].reshape(-1, x.size)

    def _groups(self) -> Iterator[dict[int, NDArray[np.intp]]]:
        """Unknowns that one rollout moves, each with the joints that feel it."""
        joints = self.measured.shape[1]
        for quantity in range(len(QUANTITIES)):
            for kind in self.legs.T:
                yield {quantity * joints + int(j): leg for j, leg in zip(kind, self.legs, strict=True)}
        yield {len(QUANTITIES) * joints: np.arange(joints)}
