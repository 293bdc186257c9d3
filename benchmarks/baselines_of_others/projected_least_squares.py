"""Projected least squares: inverse dynamics of the whole robot in the null space of its contacts, physically consistent.

After S. Khorshidi, M. Dawood, B. Nederkorn, M. Bennewitz and M. Khadiv, "Physically-Consistent Parameter Identification of
Robots in Contact", ICRA 2025, arXiv:2409.09850; this is an implementation of the published equations, not their code. With
all links' inertial parameters phi in a vector, feet of Jacobian J that do not slip, and joint losses b that are linear too,

    Y(q, v, a) phi + S^T B(q, v, a) b = S^T tau + J^T f,        B = [diag(tanh(v / v_0)), diag(v), diag(a)]

    P = I - J^+ J,    P J^T = 0:        P Y phi + P S^T B b = P S^T tau,

which no longer holds the feet's forces. It is solved as a convex problem,

    min  |A theta - y|^2 / sigma^2 + |(theta - theta_0) / s|^2      theta = (phi, b)
    s.t. [ tr(I_i)/2 1 - I_i   h_i ]
         [ h_i^T               m_i ]  >= 0 for every link i,    b >= 0,    sum m_i = M if a scale gave M,

where the linear matrix inequality is that of P. Wensing, S. Kim and J.-J. Slotine, "Linear Matrix Inequalities for
Physically-Consistent Inertial Parameter Identification", RA-L 2018. The second term is the regularisation towards the model
file. A minimum that keeps the constraints without being held to them is the minimum of the whole problem, so that CVXPY is
asked only where they bind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baselines_of_others.filtered import Acceleration, Filtered, Motions, contact_jacobians
from equipoise.robot.inertial import InertialParameters, composite_parameters
from equipoise.robot.model import RobotModel

FloatArray = NDArray[np.float64]

_ROUNDS = 4  # of estimating sigma
_MASS_PRIOR, _MOMENT_PRIOR, _INERTIA_PRIOR = 0.5, 0.5, 3.0  # of the base, wide: in parts of the model's own sizes
_LOSS_PRIORS = (2.0, 0.5, 0.1)  # Coulomb [Nm], viscous [Nm s/rad], armature [kg m2] on an A1; wide


@dataclass(frozen=True)
class ProjectedSettings:
    """How it is used; the defaults are the best of those that were tried.

    Attributes:
        cutoff: of the low-pass filter on an A1 [Hz].
        acceleration: where the base's acceleration comes from.
        motions: which recordings.
        legs: "known": the legs are the model's; "free": ten parameters of every leg link, near the model's.
        losses: "none", one set of friction and armature for all joints, or one for each.
        leg_prior: standard deviation of the leg links' parameters about the model's, as a fraction.
    """

    cutoff: float = 6.0
    acceleration: Acceleration = "accelerometer"
    motions: Motions = "all"
    legs: Literal["known", "free"] = "known"
    losses: Literal["none", "shared", "joint"] = "shared"
    leg_prior: float = 0.03


@dataclass(frozen=True, eq=False)
class Problem:
    """A theta = y in normal form, with the prior. theta: base, legs' links if free, losses.

    Attributes:
        gram, moment, square: A^T A, A^T y, y^T y.
        rows: of A.
        start, deviation: theta_0 and s.
        links: number of links in theta.
        fixed_mass: of the links that are not in theta [kg].
    """

    gram: FloatArray
    moment: FloatArray
    square: float
    rows: int
    start: FloatArray
    std: FloatArray
    links: int
    fixed_mass: float


def estimate(
    robot: RobotModel,
    samples: Filtered,
    joint_position: FloatArray,
    settings: ProjectedSettings,
    mass: float | None = None,
) -> InertialParameters:
    """The whole robot at a stance.

    Args:
        joint_position: (nj,) of the stance [rad].
        mass: of the whole robot from a scale [kg], or None.

    Raises:
        ModuleNotFoundError: the constraints bind and CVXPY is not installed.
    """
    problem = pose(robot, samples, settings)
    theta = solve(problem, mass)
    model = robot.pinocchio.copy()
    for link in range(problem.links):
        model.inertias[1 + link] = pin.Inertia.FromDynamicParameters(theta[10 * link : 10 * link + 10])
    return composite_parameters(replace(robot, pinocchio=model), joint_position)


def pose(robot: RobotModel, samples: Filtered, settings: ProjectedSettings) -> Problem:
    """The projected equations of all samples."""
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)  # it is in the acceleration that the base feels
    data = model.createData()
    joints = samples.position.shape[1]
    bodies = model.njoints - 1
    links = bodies if settings.legs == "free" else 1
    known = np.concatenate([model.inertias[1 + i].toDynamicParameters() for i in range(links, bodies)] or [np.zeros(0)])
    sets = {"none": 0, "shared": 1, "joint": joints}[settings.losses]
    size = 10 * links + 3 * sets
    gram, moment, square, rows = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for index in range(samples.count):
        position = samples.position[index]
        jacobian = contact_jacobians(robot, position, samples.up[index])[np.repeat(samples.standing[index], 3)]
        velocity = np.concatenate([np.zeros(3), samples.turning[index], samples.velocity[index]])
        acceleration = np.concatenate([samples.felt[index], samples.turning_rate[index], samples.acceleration[index]])
        regressor = pin.computeJointTorqueRegressor(model, data, robot.configuration(position), velocity, acceleration)
        # The rows of P are combinations of an orthonormal basis of the null space: the same sum of squares.
        full, _ = np.linalg.qr(jacobian.T, mode="complete")
        free = full[:, len(jacobian) :].T
        at_joints = free[:, 6:]
        projected = free @ regressor
        a, y = projected[:, : 10 * links], at_joints @ samples.torque[index] - projected[:, 10 * links :] @ known
        if sets:
            parts = (samples.friction[index], samples.velocity[index], samples.acceleration[index])
            columns = [at_joints * part for part in parts]
            if sets == 1:
                columns = [column.sum(axis=1, keepdims=True) for column in columns]
            a = np.concatenate([a, *columns], axis=1)
        gram += a.T @ a
        moment += a.T @ y
        square += float(y @ y)
        rows += len(y)
    start, std = _beliefs(robot, settings, links, sets)
    return Problem(gram, moment, square, rows, start, std, links, float(known[::10].sum()))


def solve(problem: Problem, mass: float | None = None) -> FloatArray:
    """theta; sigma is found from what is left over."""
    variance = problem.square / problem.rows
    theta = problem.start
    for _ in range(_ROUNDS):
        theta = minimum(problem, variance, mass)
        left = theta @ problem.gram @ theta - 2 * theta @ problem.moment + problem.square
        variance = max(float(left) / problem.rows, 1e-12 * problem.square / problem.rows)
    if consistent(problem, theta):
        return theta
    return minimum_with_matrix_inequalities(problem, variance, mass)


def minimum_with_matrix_inequalities(problem: Problem, variance: float, mass: float | None) -> FloatArray:
    """The constrained minimum; raises ModuleNotFoundError without CVXPY."""
    import cvxpy as cp  # noqa: PLC0415 - optional

    unit = problem.std
    hessian = problem.gram / variance * np.outer(unit, unit) + np.eye(len(unit))
    gradient = (problem.moment - problem.gram @ problem.start) / variance * unit
    root = np.linalg.cholesky(hessian)
    step = cp.Variable(len(unit))
    theta = problem.start + cp.multiply(unit, step)
    constraints = [theta[10 * problem.links :] >= 0] if len(unit) > 10 * problem.links else []
    for link in range(problem.links):
        constraints.append(_pseudo_inertia(cp, theta[10 * link : 10 * link + 10]) >> 0)
    if mass is not None:
        constraints.append(cp.sum(theta[: 10 * problem.links : 10]) == mass - problem.fixed_mass)
    target = np.linalg.solve(root, gradient)
    cp.Problem(cp.Minimize(cp.sum_squares(root.T @ step - target)), constraints).solve(solver=cp.CLARABEL)
    return np.asarray(theta.value, dtype=float)


def minimum(problem: Problem, variance: float, mass: float | None) -> FloatArray:
    """Without the inequalities."""
    unit = problem.std
    hessian = problem.gram / variance * np.outer(unit, unit) + np.eye(len(unit))
    gradient = (problem.moment - problem.gram @ problem.start) / variance * unit
    if mass is None:
        return problem.start + unit * np.linalg.solve(hessian, gradient)
    weights = np.zeros(len(unit))
    weights[: 10 * problem.links : 10] = 1.0
    wanted = mass - problem.fixed_mass - weights @ problem.start
    row = (weights * unit)[None]
    both = np.block([[hessian, row.T], [row, np.zeros((1, 1))]])
    return problem.start + unit * np.linalg.solve(both, np.append(gradient, wanted))[:-1]


def consistent(problem: Problem, theta: FloatArray) -> bool:
    links = [_pseudo_inertia(np, theta[10 * link : 10 * link + 10]) for link in range(problem.links)]
    return bool(
        all(np.linalg.eigvalsh(matrix)[0] >= 0 for matrix in links) and (theta[10 * problem.links :] >= 0).all()
    )


def _pseudo_inertia(library: object, phi: object) -> object:
    """(4, 4) of a link, of numbers (`numpy`) or of CVXPY's expressions."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = (phi[i] for i in range(10))  # pyright: ignore
    rows = [
        [(yy + zz - xx) / 2, -xy, -xz, hx],
        [-xy, (xx + zz - yy) / 2, -yz, hy],
        [-xz, -yz, (xx + yy - zz) / 2, hz],
        [hx, hy, hz, m],
    ]
    return library.array(rows) if library is np else library.bmat(rows)  # pyright: ignore


def _beliefs(robot: RobotModel, settings: ProjectedSettings, links: int, sets: int) -> tuple[FloatArray, FloatArray]:
    """theta_0 and s."""
    model = robot.pinocchio
    start = [np.array(model.inertias[1 + i].toDynamicParameters()) for i in range(links)]
    base = model.inertias[1]
    length = float(np.sqrt(np.trace(base.inertia) / base.mass))
    stds = [base.mass * np.repeat([_MASS_PRIOR, _MOMENT_PRIOR * length, _INERTIA_PRIOR * length**2], [1, 3, 6])]
    for i in range(1, links):
        link = model.inertias[1 + i]
        length = float(np.sqrt(np.trace(link.inertia) / link.mass + link.lever @ link.lever))
        stds.append(settings.leg_prior * link.mass * np.repeat([1.0, length, length**2], [1, 3, 6]))
    scale = robot.mass / 12.5
    losses = np.repeat(np.array(_LOSS_PRIORS) * scale, sets)
    return np.concatenate([*start, np.zeros(len(losses))]), np.concatenate([*stds, losses])
