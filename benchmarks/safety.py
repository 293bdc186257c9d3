"""Falls, killed runs, loosened limits, control loop, and manufacturers' protocols: `make bench-safety`.

Writes benchmarks/results/safety.md. Tables other than the falls are in `killed_runs.py`, `mutants.py`, `wires.py` and
`foreign.py`; they run in real time, one at a time, and need two idle cores.
"""

from __future__ import annotations

from collections.abc import Iterator

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import foreign
import killed_runs
import mutants
import numpy as np
import wires
from simulated import FIRST_SEED, cases_of, judged, robot_called
from tables import column, coverage, failed_checks, figures, interval_of_share, markdown, rms

from equipoise import BayesianMethod, Recording, RobotModel, calibrate, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.recording.trials import LiftTrial
from equipoise.robot.catalog import CATALOG

SEEDS, DURATION = 20, 60.0  # [s] on an A1; in proportion on others
HEAVIEST, OFF_CENTRE, ABOVE, SOFTEST = 0.3, 0.3, (0.2, 0.5), 0.3
FALLEN = np.radians(40)


def payload_on(robot: RobotModel, generator: np.random.Generator) -> str:
    """Draw a point mass on the trunk, as text of `--payload`."""
    stance = nominal_stance(robot)
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    mass = generator.uniform(0, HEAVIEST) * robot.mass
    place = [*(generator.uniform(-OFF_CENTRE, OFF_CENTRE, 2) * half), generator.uniform(*ABOVE) * stance.hip_height]
    return ",".join(f"{value:.6g}" for value in (max(mass, 1e-3), *place))


def fall(name: str, seed: int) -> Row:
    """Return the row of a calibration with a payload and soft drives, both unknown to the method."""
    robot, generator = robot_called(name), np.random.default_rng([seed, 83])
    payload, softness = payload_on(robot, generator), generator.uniform(0, SOFTEST)
    method = BayesianMethod(duration=DURATION * nominal_stance(robot).scale.time)
    recordings: list[Recording] = []
    with simulate(robot, "realistic", payload, seed) as simulation:
        simulation.errors.torque_gain[:] *= 1 - softness
        leaning: list[float] = []

        def keep(recording: Recording) -> None:
            recordings.append(recording)
            leaning.append(simulation.ground_truth().tilt)

        try:
            row = judged(calibrate(simulation.platform, robot, method, keep).with_truth(simulation.truth))
        except EquipoiseError as error:
            row = {"ended": f"{type(error).__name__}: {error}"}
        leaning.append(simulation.ground_truth().tilt)
    lifts = [recording for recording in recordings if isinstance(recording.trial, LiftTrial)]
    lifted = sum(recording.complete for recording in lifts)
    return row | {"fell": bool(max(leaning) > FALLEN), "lifts": lifted, "skipped": len(lifts) - lifted}


def show_falls(rows: list[Row]) -> Iterator[str]:
    fell = sum(row["fell"] for row in rows)
    share = interval_of_share(fell / len(rows), len(rows))
    yield "## Falls during calibrations"
    yield ""
    yield (
        f"`bayesian` of {DURATION:g} s (A1; longer for larger robots), `realistic`, on every robot of the catalogue, without "
        "a scale. The seed draws a payload of up to 30 % of the robot's mass, up to 0.3 of half the robot's length and width "
        "from the middle, 0.2 to 0.5 hip heights above the base's origin. It also draws drives with up to 30 % less gain and "
        "feed-forward torque than the model, which report the commanded torque. Both are unknown to the method. A robot "
        f"falls if its base leans by more than 40 degrees. Target: no robot falls. {fell} of {len(rows)} fell: "
        f"{share if not fell else f'**{share}**'}."
    )
    yield ""
    head = (
        "robot", "runs", "falls", "errors", "lifts per run", "skipped", "CoM x, y, z [mm]", "coverage", "failed checks"
    )  # fmt: skip
    yield from markdown(head, _fall_lines(rows))
    yield ""
    yield (
        "Errors: runs that ended with an error without a fall. Skipped: lifts per run that were skipped because the robot "
        "could have tipped over. Coverage: 95 % intervals of all ten parameters that contain the truth; the wrong torques "
        "violate the model."
    )
    yield ""
    for name in CATALOG:
        ended = [row["ended"] for row in rows if row["case"][0] == name and "ended" in row]
        yield from [f"- {name}, {len(ended)} runs, the first: {ended[0]}"] if ended else []


def _fall_lines(rows: list[Row]) -> Iterator[list[str]]:
    for name in [*CATALOG, "all"]:
        of = [row for row in rows if name in (row["case"][0], "all")]
        done = [row for row in of if "ended" not in row]
        if of:
            errors = sum("ended" in row and not row["fell"] for row in of)
            lifts = [f"{column(of, one).mean():.1f}" for one in ("lifts", "skipped")]
            accuracy = ["-"] * 3
            if done:
                accuracy = [figures(1e3 * rms(column(done, "error")[:, 1:4])), coverage(done), failed_checks(done)]
            yield [name, str(len(of)), str(sum(row["fell"] for row in of)), str(errors), *lifts, *accuracy]


PAGE = Page(
    "safety",
    f"""# Safety and robots' interfaces

`make bench-safety`; seeds from {FIRST_SEED:,}. No real robot was used. Bold: target missed.""",
    (
        Table("falls", fall, cases_of({(name,): SEEDS for name in CATALOG}), show_falls),
        *killed_runs.TABLES,
        *mutants.TABLES,
        *wires.TABLES,
        *foreign.TABLES,
    ),
)

if __name__ == "__main__":
    main(PAGE)
