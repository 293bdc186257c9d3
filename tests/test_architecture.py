"""What keeps the house a house: imports go one way, engines stay where they belong, exports are what they are."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import equipoise

SOURCE = Path(equipoise.__file__).parent
# From the ground up; a module may import from lower floors and from its own.
FLOORS = [
    ["errors", "_version"],
    ["robot"],
    ["recordings"],
    ["platforms", "estimation"],
    ["experiments"],
    ["result"],
    ["methods"],
    ["calibration"],
    ["run_folder", "offline"],
    ["monte_carlo", "balance"],
    ["outputs"],
    ["cli", "__init__"],
    ["__main__"],
]
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
SIMULATION = {"platforms/mujoco.py", "platforms/mujoco_model.py", "platforms/truth.py", "platforms/simulation.py"}
MODULES = sorted(SOURCE.rglob("*.py"))


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_go_from_the_ground_up(path):
    own = path.relative_to(SOURCE).parts[0].removesuffix(".py")
    for name in imported(path):
        parts = name.split(".")
        if parts[0] != "equipoise" or len(parts) == 1:
            continue
        other = parts[1]
        if own in {other, "__init__"}:
            continue
        assert LEVEL[other] < LEVEL[own], f"{own} imports {other}, which is not below it"


def test_platforms_and_estimation_do_not_import_each_other():
    for path in MODULES:
        own = path.relative_to(SOURCE).parts[0]
        others = {"platforms": "equipoise.estimation", "estimation": "equipoise.platforms"}
        if own in others:
            assert not any(name.startswith(others[own]) for name in imported(path)), path


def test_only_the_simulation_imports_mujoco():
    for path in MODULES:
        if any(name.split(".")[0] == "mujoco" for name in imported(path)):
            assert path.relative_to(SOURCE).as_posix() in SIMULATION


def test_the_truth_is_read_by_the_simulation_alone():
    for path in MODULES:
        if any(name == "equipoise.platforms.truth" for name in imported(path)):
            assert path.relative_to(SOURCE).as_posix() == "platforms/simulation.py"


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_importing_everything_but_the_simulator_needs_no_mujoco():
    names = [name for name in equipoise.__all__ if name not in ("Simulation", "simulate")]
    code = f"import sys; sys.modules['mujoco'] = None; from equipoise import {', '.join(names)}"
    assert run_python(code).returncode == 0


def test_importing_the_package_imports_no_simulator_and_no_plots():
    done = run_python(
        "import equipoise, sys; print([m for m in ('mujoco', 'matplotlib', 'scipy') if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]"


def test_without_mujoco_the_simulation_says_what_to_install():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "try: from equipoise import simulate\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    assert run_python(code).stdout.strip() == "MissingDependencyError simulation needs MuJoCo: pip install mujoco"


def test_exports_are_frozen():
    assert sorted(equipoise.__all__) == sorted(
        [
            "Audit", "Calibration", "CalibrationSettings", "ComSearchSettings", "EquipoiseError", "InertialParameters",
            "JointCommand", "Payload", "Platform", "Recording", "RobotDescription", "RobotModel", "RobotState", "RunFolder",
            "SensorErrors", "Simulation", "Stance", "SwaySettings", "Trajectory", "__version__", "audit", "calibrate",
            "estimate", "load_robot", "nominal_stance", "simulate",
        ]
    )  # fmt: skip
    for name in equipoise.__all__:
        assert getattr(equipoise, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        equipoise.nothing  # noqa: B018
