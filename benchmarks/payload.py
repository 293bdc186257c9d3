"""Accuracy of a payload's mass and place: `make bench-payload`. Writes benchmarks/results/payload.md.

A simulated robot with typical sensors carries 1 kg ten centimetres above, next to, ahead of or behind the base's origin (in
proportion on other robots). The payload follows from the difference of two calibrations, or from half a minute with a prior
run, also after a restart: joint offsets and the accelerometer's bias change as much as the priors allow, and one joint offset
by 5 mrad. One scale with an error of 0.5 % (rms) and a resolution of 10 g weighs the robot twice; the same recordings are also
estimated without it. First runs with a payload have the sensor errors of those without, and other noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
import payload_in_walks
from simulated import FIRST_SEED, SCALE_ERROR, cases_of, robot_called, weighed
from tables import column, coverage, figures, markdown, rms

from equipoise import (
    BayesianMethod,
    Calibration,
    Payload,
    PayloadChange,
    Recording,
    RobotModel,
    ScaleReadings,
    calibrate,
    estimate,
    find_payload_change,
    nominal_stance,
    simulate,
)
from equipoise.calibration.payload_measurement import measure_payload
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.simulation.simulation import Simulation

PAIRS = {("unitree_a1",): 12, ("go2",): 4, ("anymal_c",): 4}
MEASUREMENTS = {("unitree_a1",): 15, ("go2",): 15}
DURATIONS = {"30 s": 30.0, "45 s": 45.0, "30 s, restarted": 30.0}
SCALE_STEP = 0.01  # [kg]
MOVED = 5e-3  # [rad], the offset of one joint after a restart
# Changes between two runs in the table of priors.
OFFSETS_CHANGE, BIAS_CHANGE = 0.5e-3, 6e-3  # [rad], [m/s2]
# CoM x, y, z [mm]; payload's mass without and with the scale [%]; its place x, y, z [mm].
TARGETS = {
    "30 s": (0.25, 0.25, np.inf, 8, 1, 3, 3, np.inf),
    "45 s": (0.22, 0.18, 0.65, 8, 1, 3, 3, 10),
    "30 s, restarted": (np.inf,) * 8,
}


def payload_on(robot: RobotModel, seed: int) -> Payload:
    """Return a payload of 1 kg on an A1, ten centimetres from the base's origin."""
    a1 = robot_called("unitree_a1")
    size = nominal_stance(robot).hip_height / nominal_stance(a1).hip_height
    direction = ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1])[seed % 5]
    place = 0.1 * size * np.array(direction, dtype=float)
    return Payload(InertialParameters(robot.mass / a1.mass, place, np.zeros((3, 3))))


def reading(seed: int, truth: RobotInertia) -> float:
    """Return the reading of the seed's scale [kg]."""
    return round(weighed(truth.composite.mass, np.random.default_rng([seed, 77])) / SCALE_STEP) * SCALE_STEP


def row_of(change: PayloadChange, way: str = "") -> Row:
    """Return errors of the payload's mass [%] and place [mm], and coverage."""
    values = [*change.payload][:4]
    unit = [100 / values[0].truth, 1e3, 1e3, 1e3]
    return {
        f"payload{way}": [None if v.error is None else v.error * one for v, one in zip(values, unit, strict=True)],
        f"holds{way}": [abs(v.error) <= NORMAL_95 * v.std for v in values if v.error is not None],
    }


def pair(name: str, seed: int) -> Row:
    """Return the row of two calibrations, with a scale and without."""
    robot = robot_called(name)

    def calibrated(payload: Payload | None) -> tuple[list[Recording], RobotInertia]:
        recordings: list[Recording] = []
        with simulate(robot, "realistic", payload, seed, noise_seed=2 * seed + (payload is None)) as simulation:
            calibrate(simulation.platform, robot, keep=recordings.append)
            return recordings, simulation.truth

    (before, bare), (after, loaded) = calibrated(None), calibrated(payload_on(robot, seed))
    scale = ScaleReadings((reading(seed, bare), reading(seed, loaded)))
    row: Row = {}
    for way, readings in ((", no scale", None), ("", scale)):
        row |= row_of(find_payload_change(robot, before, after, readings).with_truth(bare, loaded), way)
    return row


def show_pairs(rows: list[Row]) -> Iterator[str]:
    yield "## Two calibrations"
    yield ""
    head = ("robot", "pairs", "scale", "mass [%]", "x, y, z [mm]", "largest x, y, z [mm]", "coverage")
    yield from markdown(head, _pair_lines(rows))


def _pair_lines(rows: list[Row]) -> Iterator[list[str]]:
    for (name,) in PAIRS:
        of = [row for row in rows if row["case"][0] == name]
        for way, scale in ((", no scale", "no"), ("", "yes")):
            if of:
                errors = column(of, f"payload{way}")
                held = np.mean(np.concatenate([row[f"holds{way}"] for row in of]))
                most = np.abs(errors[:, 1:]).max(axis=0)
                mass, place = figures(rms(errors[:, :1]), ".1f"), figures(rms(errors[:, 1:]), ".1f")
                yield [name, str(len(of)), scale, mass, place, figures(most, ".1f"), f"{held:.0%}"]


@cache
def first_run(name: str, seed: int) -> tuple[PriorRun, RobotInertia]:
    """Return the prior run of the bare robot and its truth; the cases of one seed share it in one worker process."""
    robot = robot_called(name)
    with simulate(robot, "realistic", None, seed, noise_seed=2 * seed + 1) as simulation:
        method = BayesianMethod(leg_prior="narrow", cable="none", mass=reading(seed, simulation.truth))
        result = calibrate(simulation.platform, robot, method)
        return PriorRun(**result.evidence.keepsake(result.settings)), simulation.truth


def restart(simulation: Simulation, seed: int, joint: int) -> None:
    """Change the sensor errors as after a restart, and one joint offset by more than that."""
    drawn, generator = simulation.errors.drawn, np.random.default_rng([seed, 78])
    drawn["accelerometer_bias"][:] += BIAS_CHANGE * generator.standard_normal(3)
    drawn["joint_offset"][:] += OFFSETS_CHANGE * generator.standard_normal(len(drawn["joint_offset"]))
    drawn["joint_offset"][joint] += MOVED if seed % 2 else -MOVED


def measurements(name: str, seed: int) -> Row:
    """Return the row of a seed: one first run, and a measurement of each duration, by its name."""
    row: Row = {what: measurement(name, seed, what) for what in DURATIONS}
    first_run.cache_clear()
    return row | {name: row["45 s"][name] for name in ("error", "sd")}


def measurement(name: str, seed: int, what: str) -> Row:
    """Return the result of one measurement, with a scale and without."""
    robot, (prior_run, bare) = robot_called(name), first_run(name, seed)
    joint = seed % len(robot.joint_names)
    moved = robot.joint_names[joint] if "restarted" in what else None
    recordings: list[Recording] = []
    with simulate(robot, "realistic", payload_on(robot, seed), seed, noise_seed=2 * seed) as simulation:
        truth = simulation.truth
        if moved is not None:
            restart(simulation, seed, joint)
        mass = reading(seed, truth)
        method = BayesianMethod(prior_run=prior_run, cable="none", duration=DURATIONS[what], mass=mass)
        result = calibrate(simulation.platform, robot, method, keep=recordings.append)
    alone = estimate(robot, recordings, replace(method, mass=None))
    whole = result.with_truth(truth).composite
    row: Row = {
        "error": whole.errors.tolist(), "sd": whole.stds.tolist(), "moved": moved,
        "alarms": [check.name for check in result.checks if not check.passed],
        "changed": [change.each for change in result.evidence.changes],
        "robot_time": sum(recording.duration for recording in recordings),
    }  # fmt: skip
    held: list[bool] = []
    for way, one in ((", no scale", alone), ("", result)):
        row |= row_of(measure_payload(robot, prior_run, one).change.with_truth(bare, truth), way)
        held += [*row.pop(f"holds{way}"), *_held(one, truth)]
    return row | {"holds": held}


def _held(result: Calibration, truth: RobotInertia) -> list[bool]:
    return [not quantity.missed for quantity in result.with_truth(truth).composite]


def show_measurements(rows: list[Row]) -> Iterator[str]:
    yield "## Half a minute with a prior run"
    yield ""
    yield (
        f"The first run of 120 s has `--leg-prior narrow --cable none` and a scale. After a restart, joint offsets change by "
        f"{1e3 * OFFSETS_CHANGE:g} mrad (rms), the accelerometer's bias by {1e3 * BIAS_CHANGE:g} mm/s2, and one joint offset "
        f"by {1e3 * MOVED:g} mrad. Coverage: of the robot's ten parameters and the payload's four. Changed: runs that report "
        "only the changed offset, of restarted robots, or any change, of others."
    )
    yield ""
    head = (
        "robot", "duration", "runs", "robot time [s]", "CoM x, y, z [mm]", "payload's mass, no scale [%]", "with scale [%]",
        "its place x, y, z [mm]", "coverage", "changed", "failed checks",
    )  # fmt: skip
    yield from markdown(head, _measurement_lines(rows))


def _measurement_lines(rows: list[Row]) -> Iterable[list[str]]:
    for what, most in TARGETS.items():
        shown = [f"*{limit:g}*" if np.isfinite(limit) else "-" for limit in most]
        if set(shown) != {"-"}:
            yield ["*target*", what, "", "", " ".join(shown[:3]), *shown[3:5], " ".join(shown[5:]), "*90 %*", "", ""]
        for (name,) in MEASUREMENTS:
            of = [row[what] for row in rows if row["case"][0] == name]
            if not of:
                continue
            com, place = 1e3 * rms(column(of, "error")[:, 1:4]), rms(column(of, "payload")[:, 1:])
            masses = [rms(column(of, f"payload{way}")[:, 0]) for way in (", no scale", "")]
            changed = sum(row["changed"] == [row["moved"]] if row["moved"] else bool(row["changed"]) for row in of)
            yield [
                name, what, str(len(of)), f"{column(of, 'robot_time').mean():.1f}", figures(com, most=most[:3]),
                *(figures(mass, most=limit) for mass, limit in zip(masses, most[3:5], strict=True)),
                figures(place, ".1f", most[5:]), coverage(of), f"{changed} of {len(of)}",
                str(sum(bool(row["alarms"]) for row in of)),
            ]  # fmt: skip


PAGE = Page(
    "payload",
    f"""# Payload

`make bench-payload`; `--sim-preset realistic`, seeds from {FIRST_SEED:,}, 1 kg on an A1 at 10 cm from the base's origin, in
proportion on others. One scale, with a constant error of {SCALE_ERROR:.1%} (standard deviation) and steps of 10 g, weighs a
robot before and after. Root mean square errors, estimate minus truth. Coverage: share of 95 % intervals that contain the
truth. Bold: target missed.""",
    (
        Table("pairs", pair, cases_of(PAIRS), show_pairs),
        Table("measurements", measurements, cases_of(MEASUREMENTS), show_measurements),
        payload_in_walks.TABLE,
    ),
)

if __name__ == "__main__":
    main(PAGE)
