"""Accuracy of leg links and motors: `make bench-legs-and-motors`. Writes benchmarks/results/legs_and_motors.md.

Legs: the simulated legs differ from their files by more than those of the preset `realistic`, and two raised feet swing in a
third of the lift trials. One run is estimated with and without its further 10 s of legs that swing in the air. Motors: robots
swing all joints on their bellies or, if they cannot lie with free legs, each leg in turn on the other three feet.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import FIRST_SEED, cases_of, judged, robot_called, weighed
from tables import column, coverage, figures, markdown, relative, rms

from equipoise import BayesianMethod, Calibration, Recording, RobotModel, calibrate, nominal_stance, simulate
from equipoise.method.combined import CombinedMethod
from equipoise.method.method import Method
from equipoise.motors.method import Motors
from equipoise.recording.trials import MotorTrial
from equipoise.robot.scale import Scale
from equipoise.robot.tree import joint_axis
from equipoise.simulation.effects import REALISTIC, STRESS, EffectSizes

COVERAGE = 0.90  # target of all coverages
KINDS = ("hip", "thigh", "calf")
LEGS, MOTORS = "base,legs", "base,legs,motors"  # values of `--parameters`
LEG_RUNS = {
    ("realistic", "unitree_a1"): 20, ("realistic", "go2"): 20, ("realistic", "anymal_c"): 8, ("realistic", "solo12"): 8,
    ("stress", "unitree_a1"): 10,
}  # fmt: skip
# CoM x, y, z [mm]; moments [%]; first moments of thigh and calf [%]; lengths [mm].
LEG_TARGETS = {
    "realistic": ((0.30, 0.20, 0.80), (1.8, 1.2, 1.5), 3.5, 6, 0.3),
    "stress": ((0.5, 0.45, 1.2), (4, 2.5, 3), np.inf, np.inf, np.inf),
}
MOST_STD = 2.0  # target of the standard deviation over the rms error

# Duration of swinging, preset, additional effects, and number of runs of each robot.
STRIBECK = 0.3  # additional friction at rest, as a fraction of Coulomb friction
ALL_ROBOTS = {"unitree_a1": 20, "go2": 20, "anymal_c": 8, "solo12": 8, "hyq": 8, "b1": 8}
MOTOR_RUNS = {
    "10 s": (10.0, "realistic", {}, ALL_ROBOTS),
    "30 s": (30.0, "realistic", {}, ALL_ROBOTS),
    "10 s, Stribeck": (10.0, "realistic", {"stribeck": STRIBECK}, {"unitree_a1": 12, "go2": 6, "anymal_c": 6}),
    "10 s, `stress`": (10.0, "stress", {}, {"unitree_a1": 8, "go2": 8, "anymal_c": 8, "solo12": 8}),
}
# Label and unit of each quantity; None: a hundredth of the truth.
QUANTITIES = {
    "coulomb_friction": ("Coulomb [%]", None), "relative_gain": ("relative gain [%]", 0.01),
    "armature": ("armature [%]", None), "viscous_friction": ("viscous [%]", None), "delay": ("delay [ms]", 1e-3),
}  # fmt: skip
MOTOR_TARGETS = {"10 s": (3.5, 2.0, 6.0, 13.0, 0.1), "30 s": (2.0, 1.2, 3.5, 8.0, 0.1)}


def leg_effects(preset: str, scale: Scale) -> EffectSizes:
    """Return the errors of the simulated robot relative to its file."""
    if preset == "stress":
        return STRESS.scaled_to(scale)
    long = scale.length
    return replace(
        REALISTIC.scaled_to(scale), leg_mass_common=0.10, leg_mass=0.05, leg_com_common=4e-3 * long, leg_com=2e-3 * long,
        leg_length=1.5e-3 * long, cable=0.0,
    )  # fmt: skip


def legs(preset: str, name: str, seed: int) -> Row:
    """Return the row of a run, estimated with and without the motors' swing."""
    robot, kept = robot_called(name), list[Recording]()
    stance = nominal_stance(robot)
    with simulate(robot, leg_effects(preset, stance.scale), seed=seed) as simulation:
        mass = weighed(simulation.truth.composite.mass, np.random.default_rng([seed, 77]))
        base = BayesianMethod(mass=mass, cable="none" if preset == "realistic" else "light", swings=True)
        combined = CombinedMethod(base, Motors())
        calibrate(simulation.platform, robot, combined, kept.append)
    lifts = [one for one in kept if not isinstance(one.trial, MotorTrial)]
    row: Row = {}
    given: dict[str, tuple[Method, list[Recording]]] = {LEGS: (base, lifts), MOTORS: (combined, kept)}
    for what, (method, recordings) in given.items():
        result = method.estimate(robot, recordings, stance).with_truth(simulation.truth)
        row[what] = {**judged(result), "links": links(result.with_truth_of_parts(simulation.truth_of_parts), robot)}
    return row | {name: row[MOTORS][name] for name in ("error", "sd")}


def links(result: Calibration, robot: RobotModel) -> Row:
    """Return relative errors of first moments across the joint's axis by kind of link, lengths [m], and coverage."""
    found: dict[str, list[float]] = defaultdict(list)
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    kinds = KINDS[-len(joints) // 4 :] * 4
    for kind, joint, link in zip(kinds, joints, result.links.values(), strict=True):
        truth, error, model = (
            np.cross(joint_axis(robot.pinocchio, joint), [getattr(one, what) for one in link.moment])
            for what in ("truth", "error", "model")
        )
        found[kind].append(np.linalg.norm(error) / np.linalg.norm(truth))
        found[f"{kind} file"].append(np.linalg.norm(model - truth) / np.linalg.norm(truth))
        if link.length.error is not None:
            found["length"].append(link.length.error)
        found["holds"] += [not one.missed for one in link.quantities.values() if one.value is not None]
    return {name: list(map(float, values)) for name, values in found.items()}


def show_legs(rows: list[Row]) -> Iterator[str]:
    yield "## Legs in the run of the base"
    yield ""
    yield (
        "120 s (of an A1; scaled for other robots), with `motors` another 10 s with the legs in the air; a scale of 0.5 %. "
        "`realistic` has no cable here, leg masses are off by 10 % in common and 5 % each, CoMs by 4 mm in common to a kind "
        "of link and 2 mm each, lengths of thighs and calves 1.5 mm; `stress` all its effects. Thigh, calf: relative error of "
        "the first moment across the joint's axis, in brackets the model file's. Coverage: of the whole robot's ten "
        "parameters, and of all links. std/rms: mean standard deviation over the rms error, CoM and moments of inertia."
    )
    yield ""
    head = (
        "preset", "`--parameters`", "robot", "runs", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "thigh (file) [%]",
        "calf (file) [%]", "lengths [mm]", "coverage", "coverage, links", "std/rms", "checks failed",
    )  # fmt: skip
    yield from markdown(head, _leg_lines(rows))


def _leg_lines(rows: list[Row]) -> Iterator[list[str]]:
    for what in (LEGS, MOTORS):
        for preset, most in LEG_TARGETS.items():
            shown = [" ".join(f"{limit:g}" for limit in np.atleast_1d(limits) if np.isfinite(limit)) for limits in most]
            yield [f"*{preset}*", what, "*target*", "", *shown, "90 %", "90 %", f"{MOST_STD:g}", ""]
            for name in (robot for of, robot in LEG_RUNS if of == preset):
                if of := [row[what] for row in rows if row["case"][:2] == [preset, name]]:
                    yield [preset, what, name, str(len(of)), *_leg_cells(of, most)]


def _leg_cells(rows: list[Row], most: tuple) -> list[str]:
    errors, found = relative(rows), [row["links"] for row in rows]
    values = {name: rms(np.concatenate([one[name] for one in found])) for name in found[0] if name != "holds"}
    moments = [
        f"{figures(100 * values[kind], '.1f', limit)} ({100 * values[f'{kind} file']:.1f})"
        for kind, limit in zip(KINDS[1:], most[2:4], strict=True)
    ]
    ratio = column(rows, "sd").mean(axis=0)[1:7] / rms(column(rows, "error"))[1:7]
    return [
        figures(rms(errors[:, 1:4]), most=most[0]), figures(rms(errors[:, 4:7]), ".1f", most[1]), *moments,
        figures(1e3 * values["length"], most=most[4]), coverage(rows, COVERAGE), coverage(found, COVERAGE),
        figures(ratio, ".1f", MOST_STD), str(sum(bool(row["alarms"]) for row in rows)),
    ]  # fmt: skip


def motors(what: str, name: str, seed: int) -> Row:
    """Return the row of a run: errors and standard deviations of each quantity of all joints, in the units of the table."""
    robot = robot_called(name)
    duration, preset, effects, _ = MOTOR_RUNS[what]
    with simulate(robot, preset, seed=seed, effects=effects) as simulation:
        result = calibrate(simulation.platform, robot, Motors(motor_time=duration))
    found = result.with_truth_of_parts(simulation.truth_of_parts).motors.values()
    values = [
        (one, 0.01 * one.truth if unit is None else unit)
        for quantity, (_, unit) in QUANTITIES.items()
        for one in (getattr(motor, quantity) for motor in found)
    ]
    static = [(one.stribeck_friction.value, STRIBECK * one.coulomb_friction.truth) for one in found]
    return {
        "error": [one.error / unit for one, unit in values],
        "sd": [one.std / abs(unit) for one, unit in values],
        "holds": [not one.missed for one, _ in values],
        "stribeck": [100 * (value / truth - 1) for value, truth in static if value is not None],
    }


def show_motors(rows: list[Row]) -> Iterator[str]:
    yield "## Motors without a test stand"
    yield ""
    yield (
        "`--parameters motors`, errors of all joints. HyQ and B1 stand on three feet and swing each leg for a quarter of the "
        f"time. Stribeck: {STRIBECK:.0%} more friction at rest, which decays as exp(-(speed / 0.1 rad/s)^2); the estimator's "
        "law differs. F_s: friction at rest, rms error of the values that are reported, and the runs that report any. "
        "`stress` has load-dependent friction and backlash, which are not parameters of this fit."
    )
    yield ""
    head = ("swing", "robot", "runs", *(label for label, _ in QUANTITIES.values()), "coverage", "F_s [%]")
    yield from markdown(head, _motor_lines(rows))


def _motor_lines(rows: list[Row]) -> Iterator[list[str]]:
    for what, (*_, counts) in MOTOR_RUNS.items():
        most = MOTOR_TARGETS.get(what)
        if most is not None:
            yield [what, "*target*", "", *(f"*{limit:g}*" for limit in most), f"*{100 * COVERAGE:.0f} %*", ""]
        for name in counts:
            of = [row for row in rows if row["case"][:2] == [what, name]]
            if not of:
                continue
            errors = rms(np.hstack(column(of, "error").reshape(len(of), len(QUANTITIES), -1)).T)
            limits, forms = most or (np.inf,) * len(errors), [".1f"] * 4 + [".2f"]
            cells = [figures(*one) for one in zip(errors, forms, limits, strict=True)]
            static = _static_friction(of) if "Stribeck" in what else ""
            yield [what, name, str(len(of)), *cells, coverage(of, COVERAGE), static]


def _static_friction(rows: list[Row]) -> str:
    values = np.concatenate([row["stribeck"] for row in rows])
    reported = f"reported in {sum(bool(row['stribeck']) for row in rows)} of {len(rows)}"
    return f"{rms(values):.0f}, {reported}" if len(values) else reported


PAGE = Page(
    "legs_and_motors",
    f"""# Leg and motor parameters

`make bench-legs-and-motors`; seeds from {FIRST_SEED:,}. Root mean square errors, estimate minus truth. Coverage: share of
95 % intervals that contain the truth. Bold: target missed.""",
    (
        Table("legs", legs, cases_of(LEG_RUNS), show_legs),
        Table(
            "motors",
            motors,
            cases_of({(what, name): n for what, (*_, counts) in MOTOR_RUNS.items() for name, n in counts.items()}),
            show_motors,
        ),
    ),
)

if __name__ == "__main__":
    main(PAGE)
