"""Influence of single effects on a result, and their detection by checks: `make bench-robustness`.

The preset `realistic` with one additional effect, and the presets alone. Calibrations use the Bayesian method for 120 s (A1
robot time), a payload drawn from the seed, and a scale. The same with the contact parameters of public model files.
Writes benchmarks/results/robustness.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from rows import Case, Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import FIRST_SEED, GYM, SCALE_ERROR, cases_of, judged, loaded, robot_called
from tables import (
    SILENT,
    coverage_with_interval,
    deviation,
    failed_checks,
    figures,
    interval_of_share,
    is_silent,
    markdown,
    relative,
    rms,
)

from equipoise import BayesianMethod, RobotModel, calibrate, nominal_stance
from equipoise.simulation.effects import IDEAL, REALISTIC, STRESS, EffectSizes
from equipoise.simulation.mujoco_contacts import foot_name

PRESETS = {"ideal": IDEAL, "realistic": REALISTIC, "stress": STRESS}
# No effect without springs; an error that checks name (tests/estimator/test_outside_forces.py).
LEFT_OUT = ("spring_spread", "sling")
EFFECTS = tuple(
    row.name
    for row in EffectSizes.rows()
    if row.size_alone not in (row.realistic, row.none) and row.name not in LEFT_OUT
)
"""Effects that are smaller in `realistic` or not part of it."""
SEEDS = {("unitree_a1", 1): 4, ("unitree_a1", 2): 2, ("go2", 1): 1, ("anymal_c", 1): 1}
"""Number of seeds for each effect, by robot and factor on the effect's size."""
COUNTS: dict[Case, int] = {  # robot, preset or effect, factor
    ("unitree_a1", "ideal", 1): 8,
    ("unitree_a1", "realistic", 1): 16,
    **{("unitree_a1", "stress", factor): n for factor, n in ((0.5, 8), (1, 8), (2, 4))},
    **{(robot, preset, 1): 4 for robot in ("go2", "anymal_c") for preset in PRESETS},
    **{
        (robot, effect.name, factor): n
        for (robot, factor), n in SEEDS.items()
        for effect in map(EffectSizes.row, EFFECTS)
        if effect.times(effect.size_alone, factor) <= effect.most[0]
    },
}
CABLES = {"vertical_pull": "heavy"}
"""`--cable` of runs with an effect that an operator sees and no motion distinguishes from a shifted CoM."""
FEET = ("go1", "go2", "a2", "b2", "aliengo", "mini_cheetah", "spot", "hyqreal1", "hyqreal2", "pegasus")
FEET_SEEDS = 4
FEET_TARGET = (0.5, 0.5, 2.0, 6, 6, 6)  # CoM [mm] and moments [%] on feet of condim 6
NO_TARGET = (np.inf,) * 6
ACCURACY = ("CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "largest error / std", "coverage", "runs with a failed check")
"""Columns of `accuracy_cells`."""


def sizes_of(robot: RobotModel, name: str, factor: float) -> EffectSizes:
    """Return the effects of a preset or of `realistic` with one effect, multiplied by a factor."""
    scale = nominal_stance(robot).scale
    if name in EFFECTS:
        return REALISTIC.scaled_to(scale).with_effects({name: None}, scale).times({name: factor})
    varied = [row.name for row in map(EffectSizes.row, EFFECTS) if row.varied and row.alone is None]
    enlarged = (*varied, "spring_spread") if name == "stress" else ()
    return PRESETS[name].scaled_to(scale).times(dict.fromkeys(enlarged, factor))


def run(name: str, effect: str, factor: float, seed: int) -> Row:
    """Return the row of one calibration."""
    robot = robot_called(name)
    return calibrated(robot, sizes_of(robot, effect, factor), seed, CABLES.get(effect, "light"))


def calibrated(robot: RobotModel, preset: Any, seed: int, cable: Any = "light", **settings: Any) -> Row:
    """Return the row of a weighed robot; settings are arguments of `simulate`."""
    simulation, mass = loaded(robot, preset, seed, **settings)
    method = BayesianMethod(cable=cable).weighed(mass, SCALE_ERROR * mass)
    with simulation:
        return judged(calibrate(simulation.platform, robot, method).with_truth(simulation.truth))


def run_on_feet(name: str, seed: int) -> Row:
    """Return the row of a calibration with the contact parameters of the model file."""
    robot = robot_called(f"{GYM}:{name}")
    simulation, _ = loaded(robot, "ideal", seed, contact_model="file")
    with simulation:
        foot = simulation.platform._model.geom(foot_name("FL"))
        contact = {"friction": foot.friction.tolist(), "condim": int(foot.condim[0]), "version": version(GYM)}
    return calibrated(robot, "realistic", seed, contact_model="file") | contact


def accuracy_cells(rows: list[Row], target: tuple[float, ...]) -> list[str]:
    """Return the cells of `ACCURACY`, bold above a target."""
    error = rms(relative(rows))[1:7]
    held = np.mean([row["holds"] for row in rows])
    return [
        figures(error[:3], most=target[:3]), figures(error[3:], ".1f", target[3:]),
        f"{max(map(deviation, rows)):.1f}", f"{held:.0%}", failed_checks(rows),
    ]  # fmt: skip


def show(rows: list[Row]) -> Iterator[str]:
    yield "## Coverage and detection"
    yield ""
    yield (
        f"*Silent*: runs with an error above {SILENT:g} standard deviations and no failed check; the target is none. Shares "
        "with their 95 % intervals."
    )
    yield ""
    head = ("runs", "n", "coverage", "runs with a failed check", "their effects", "largest error / std", "silent")
    yield from markdown(head, _summary_lines(rows))
    for factor, title in ((1, "Effects on an A1"), (2, "Effects of twice the size on an A1")):
        of = [row for row in rows if row["case"][0] == "unitree_a1" and row["case"][2] == factor]
        yield from ("", f"## {title}", "") if of else ()
        yield from markdown(("effect", "size", "n", *ACCURACY), _effect_lines(of, factor)) if of else ()


def _summary_lines(rows: list[Row]) -> Iterator[list[Any]]:
    for label in (*dict.fromkeys(group_of(*case) for case in COUNTS), "all"):
        of = [row for row in rows if label in ("all", group_of(*row["case"][:3]))]
        if of:
            fired = Counter(row["case"][1] for row in of if row["alarms"])
            silent = [row["case"][1] for row in of if is_silent(row)]
            worst = max(of, key=deviation)
            named = ", ".join(f"{name} {n}" for name, n in fired.most_common()) if "effects" in label else ""
            yield [
                label, len(of), coverage_with_interval(of), interval_of_share(fired.total() / len(of), len(of)), named,
                f"{deviation(worst):.1f} {worst['case'][1]}", " ".join([str(len(silent)), *silent]),
            ]  # fmt: skip


def group_of(robot: str, name: str, factor: float) -> str:
    """Return the label of a line of the summary."""
    return f"effects, {robot}, {factor:g} x" if name in EFFECTS else f"`{name}`, {factor:g} x"


def _effect_lines(rows: list[Row], factor: float) -> Iterator[list[Any]]:
    for name in (*PRESETS, *EFFECTS):
        of = [row for row in rows if row["case"][1] == name]
        if of:
            file = rms(relative(of, "file_error"))[1:7]
            if name in ("realistic", "stress"):
                shown = figures(file[:3]), figures(file[3:], ".1f"), "", "", ""
                yield [f"{name}, model file", "", len(of), *shown]
            yield [name, size_of(name, factor), len(of), *accuracy_cells(of, tuple(file))]


def size_of(name: str, factor: float) -> str:
    """Return the size on an A1 as text."""
    if name in PRESETS:
        return f"{factor:g} x"
    effect = EffectSizes.row(name)
    return f"{effect.times(effect.size_alone, factor):.5g} {effect.unit}".strip()


def show_feet(rows: list[Row]) -> Iterator[str]:
    yield "## Contact parameters of public model files"
    yield ""
    yield (
        f"MJCF files of {GYM} {', '.join(sorted({row['version'] for row in rows}))} with the contact parameters of "
        "their own feet (`--contact-model file`) on MuJoCo's default floor, with our solver settings, in `realistic`. "
        "*Friction*: MuJoCo's sliding, torsional [m] and rolling [m] friction; the last two act at condim 4 and 6. "
        f"Targets for condim 6: CoM {figures(FEET_TARGET[:3], '.1f')} mm, moments {FEET_TARGET[3]} %. Coverage of all files: "
        f"{coverage_with_interval(rows)}. Silent: {sum(map(is_silent, rows))} of {len(rows)} runs."
    )
    yield ""
    yield from markdown(("file", "friction", "condim", "n", *ACCURACY), _feet_lines(rows))


def _feet_lines(rows: list[Row]) -> Iterator[list[Any]]:
    for name in FEET:
        of = [row for row in rows if row["case"][0] == name]
        if of:
            target = FEET_TARGET if of[0]["condim"] == 6 else NO_TARGET
            friction = figures(of[0]["friction"], "g")
            yield [name, friction, of[0]["condim"], len(of), *accuracy_cells(of, target)]


PAGE = Page(
    "robustness",
    f"""# Influence of single effects, and their detection

`make bench-robustness`; seeds from {FIRST_SEED:,} on. The preset `realistic` with one additional effect, a payload drawn
from the seed, a scale with an error of {SCALE_ERROR:.1%}, the Bayesian method for 120 s (A1 robot time). Sizes are of an A1;
the [effects](../../docs/simulation-studies.md#simulated-effects) are described with their units. Errors are root mean
square, of the whole robot. *Model file*: errors of the file, which lacks the payload. **Bold**: worse than the file in the
same runs. *Coverage*: share of all 95 % intervals that contain the truth; all runs count. A seed draws the same payload and
scale with every effect, so runs of different effects are not independent, although their intervals count them so. Runs with
`vertical_pull` use `--cable heavy`. *Failed check*: number of runs with a failed check, and its names.""",
    (
        Table("effects", run, cases_of(COUNTS), show),
        Table("feet", run_on_feet, cases_of({(name,): FEET_SEEDS for name in FEET}), show_feet),
    ),
)

if __name__ == "__main__":
    main(PAGE)
