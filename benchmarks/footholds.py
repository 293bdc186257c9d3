"""Benefit of lifts from displaced footholds, predicted by the planner without simulation: `make bench-footholds`.

A plan spends half of its time at the nominal stance and half at another one. It is compared with a plan that stays. The
steps between the stances take no time here, so the gain of a row is an upper bound.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from provenance import write_page

from equipoise import BayesianMethod, RobotModel, load_robot, nominal_stance
from equipoise.bayesian.plan import Plan, make_plan
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.conventions import FloatArray
from equipoise.estimator.problem import prior_rows
from equipoise.result.findings import Link
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.stance import Stance, stance_at

RESULTS = Path(__file__).parent / "results"
ROBOTS = ("unitree_a1", "go2", "anymal_c")
BUDGET, SCALE = 115.0, 0.005  # [s] on an A1; a scale's error, as a fraction
STEP = 0.05  # [m] on an A1
AHEAD, LEFT = np.array([1, 1, -1, -1]), np.array([1, -1, 1, -1])  # of FL FR RL RR
FOOTHOLDS = {
    "longer": (AHEAD, 0 * LEFT),
    "shorter": (-AHEAD, 0 * LEFT),
    "wider": (0 * AHEAD, LEFT),
    "narrower": (0 * AHEAD, -LEFT),
    "left ahead, right back": (LEFT, 0 * LEFT),
}


def main() -> None:
    warnings.simplefilter("ignore")
    text = "\n".join([*lines(), ""])
    write_page("footholds.md", text)
    print(text)


def lines() -> list[str]:
    """The page."""
    found = [
        "# Predicted benefit of displaced footholds",
        "",
        "`make bench-footholds`: standard deviations predicted by the planner for `--parameters base,legs`, a scale of "
        f"{SCALE:.1%} and no cable, in {BUDGET:.0f} s (of an A1; scaled for other robots). In the second half each foot "
        f"stands {1e3 * STEP:.0f} mm (of an A1) from the nominal stance; the steps take no time. First moments across "
        "the joints' axes, root mean square of all thighs and calves.",
        "",
        "| robot | second half | lifts | CoM x y z [mm] | Ixx Iyy Izz [%] | thigh, calf [g m] | lengths [mm] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in ROBOTS:
        robot = load_robot(name)
        home = nominal_stance(robot)
        for where, stance in {"the same": home, **displaced(robot, home)}.items():
            found.append(f"| {name} | {where} | {row(robot, home, stance)} |")
    return found


def displaced(robot: RobotModel, home: Stance) -> dict[str, Stance]:
    """Return stances with displaced feet under an unmoved base."""
    found: dict[str, Stance] = {}
    for where, (ahead, left) in FOOTHOLDS.items():
        feet = home.feet_in_base.copy()
        feet[:, 0] += STEP * home.scale.length * ahead
        feet[:, 1] += STEP * home.scale.length * left
        found[where] = stance_at(robot, inverse_kinematics(robot, feet, home.joint_position))
    return found


def row(robot: RobotModel, home: Stance, stance: Stance) -> str:
    method = BayesianMethod(mass=robot.mass, mass_std=SCALE * robot.mass, cable="none", swings=True)
    first, second = (
        Candidates.of(
            robot, at, composite_parameters(robot, at.joint_position).com, method.combined_priors, swings=True
        )
        for at in (home, stance)
    )
    half = BUDGET * home.scale.time / 2
    before = make_plan(first, half)
    plan = make_plan(second, half, known=information(first, before), searched=True)
    sd, body = plan.std, plan.body
    links = list(plan.links.values())
    moments = [1e3 * moment_sd(links[place::3]) for place in (1, 2)]  # three links per leg
    lengths = [link.length.std for link in links if link.length.value is not None]
    cells = [
        str(before.lifts + plan.lifts),
        " ".join(f"{1e3 * value:.2f}" for value in sd[1:4]),
        " ".join(f"{100 * value:.2f}" for value in sd[4:7] / body[4:7]),
        " ".join(f"{value:.2f}" for value in moments),
        f"{1e3 * float(np.sqrt(np.mean(np.square(lengths)))):.2f}",
    ]
    return " | ".join(cells)


def moment_sd(links: list[Link]) -> float:
    """Return the rms standard deviation of first moments along x and z, across the joint's axis [kg m]."""
    return float(np.sqrt(np.mean([link.moment_x.std**2 + link.moment_z.std**2 for link in links]) / 2))


def information(candidates: Candidates, plan: Plan) -> FloatArray:
    """Return the (size, size) information after a plan and its search."""
    unknowns, mass = candidates.unknowns, candidates.predictor.robot.mass
    _, rows = prior_rows(unknowns, unknowns.start(), (mass, SCALE * mass))
    lifts = [lift for visit in plan.visits for lift in visit.lifts]
    home = candidates.lifts[0].posture
    lifts += 2 * [lift for lift in candidates.lifts if lift.posture == home and lift.passive]
    count = len(candidates.lifts)
    indices = [candidates.lifts.index(lift) for lift in lifts]
    indices += [count + candidates.postures.index(visit.posture) for visit in plan.visits]
    return sum((candidates.information(index) for index in indices), rows.T @ rows)


if __name__ == "__main__":
    main()
