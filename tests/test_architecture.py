"""Rules of the architecture: directions of imports, modules with engines, and frozen exports."""

import ast
import functools
import json
import subprocess
import sys
from pathlib import Path

import pytest

import equipoise

SOURCE = Path(equipoise.__file__).parent
# Layers from the lowest one; a module may import from lower layers and from its own.
FLOORS = [
    ["errors", "conventions", "_version"],
    ["threads", "thread_memory", "small_arrays", "user_file", "json_form", "plugins"],
    ["user_cache"],
    ["robot"],
    ["recording", "clearance"],
    ["platform"],
    ["simulation", "drivers"],
    ["guard"],
    ["experiments"],
    ["result"],
    ["method"],
    ["paper"],
    ["estimator"],
    ["bayesian"],
    ["motors"],
    ["calibration"],
    ["logs"],
    ["exports"],
    ["figures"],
    ["terminal"],
    ["report", "view"],
    ["cli", "__init__"],
    ["__main__"],
    ["lab"],
]
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
# Modules that may import an engine, and those that may read the truth.
ENGINES = {
    "mujoco": {
        "simulation/mujoco.py", "simulation/mujoco_model.py", "simulation/mujoco_truth.py", "simulation/simulation.py",
        "simulation/mujoco_contacts.py", "simulation/mujoco_drive.py",
        "simulation/mujoco_legs.py", "simulation/mujoco_loads.py", "lab/replay/in_mujoco.py",
    },
    "dartpy": {
        "lab/dart/engine.py", "lab/dart/dart_platform.py", "lab/dart/dart_model.py", "lab/dart/dart_truth.py",
    },
}  # fmt: skip
ASSEMBLERS = {"simulation/simulation.py", "lab/dart/engine.py"}  # they import an engine when one is asked for
TRUTHS = {"equipoise.simulation.mujoco_truth", "equipoise.lab.dart.dart_truth"}
MODULES = sorted(SOURCE.rglob("*.py"))


@functools.cache
def imported(path):
    return [*imports_of(ast.parse(path.read_text(encoding="utf-8")))]


def imports_of(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def package_of(path):
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("own", sorted({*map(package_of, MODULES)} - {"__init__"}))
def test_imports_go_from_the_ground_up(own):
    for path in [path for path in MODULES if package_of(path) == own]:
        for name in imported(path):
            parts = name.split(".")
            if parts[0] != "equipoise" or len(parts) == 1 or parts[1] == own:
                continue
            assert LEVEL[parts[1]] < LEVEL[own], f"{path} imports {parts[1]}, which is not below {own}"


MOVES = ("equipoise.platform", "equipoise.guard", "equipoise.drivers")


def test_estimators_do_not_import_modules_that_move_robots():
    for path in [*(SOURCE / "estimator").rglob("*.py"), SOURCE / "paper" / "equations.py"]:
        assert not any(name.startswith(MOVES) for name in imported(path)), path


def test_no_folder_has_too_many_files():
    for folder in {path.parent for path in MODULES}:
        assert len(list(folder.glob("*.py"))) <= 22, folder  # __init__ among them


@pytest.mark.parametrize("engine", ENGINES)
def test_only_an_engines_own_modules_import_it(engine):
    for path in MODULES:
        if any(name.split(".")[0] == engine for name in imported(path)):
            assert path.relative_to(SOURCE).as_posix() in ENGINES[engine]


def test_one_module_imports_cyclonedds_whose_versions_differ():
    users = {path.name for path in MODULES if any(name.split(".")[0] == "cyclonedds" for name in imported(path))}
    assert users == {"cyclone.py"}


def test_engines_share_no_module_that_imports_one():
    for engine, modules in ENGINES.items():
        others = {"equipoise." + path.removesuffix(".py").replace("/", ".")
                  for name, paths in ENGINES.items() if name != engine for path in paths}  # fmt: skip
        for path in modules - ASSEMBLERS:
            assert not others & set(imported(SOURCE / path)), path


def test_the_truth_is_read_by_the_simulation_alone():
    for path in MODULES:
        if TRUTHS & set(imported(path)):
            assert path.relative_to(SOURCE).as_posix() in ASSEMBLERS


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_importing_everything_needs_no_simulator():
    code = (
        "import sys; sys.modules['mujoco'] = sys.modules['dartpy'] = None\n"
        f"from equipoise import {', '.join(equipoise.__all__)}"
    )
    assert run_python(code).returncode == 0


def test_importing_the_package_imports_no_simulator_and_no_plots():
    done = run_python(
        "import equipoise, sys; print([m for m in ('mujoco', 'dartpy', 'plotly', 'scipy') if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]"


def test_no_package_has_the_name_of_a_public_function():
    """A name of the package would be replaced by the subpackage once that is imported."""
    assert not {path.stem for path in SOURCE.iterdir()} & set(equipoise.__all__)


HEAVY = ("numpy", "scipy", "pinocchio", "mujoco", "plotly", "tyro")


@pytest.mark.parametrize("words", [["robots"], ["robots", "--json"], ["platforms"], ["--help"], ["--version"]])
def test_lists_import_no_heavy_packages(words):
    code = (
        "import sys; from equipoise.cli import main; code = main(sys.argv[1:])\n"
        f"print(code, [name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == "0 []"
    assert done.stdout


COMPUTES = ("scipy", "pinocchio", "mujoco", "plotly")
REFUSED = {
    **{f"{verb} rex": 3 for verb in (
        "calibrate", "plan", "payload", "doctor", "record", "audit", "lab balance", "lab monte-carlo",
        "estimate log.csv --robot")},
    **{f"{verb} no/such.urdf": 3 for verb in ("calibrate", "audit", "plan")},
    **{f"{verb} nosuch": 5 for verb in (
        "estimate", "diagnose", "view", "report", "export", "compare", "lab validate", "calibrate --resume")},
    **{f"{verb} --bogus": 2 for verb in ("audit", "export", "report", "doctor", "record", "calibrate --resume nosuch")},
    **dict.fromkeys(("record --duration soon", "doctor --duration soon", "doctor --platform nosuch", "calibrat"), 2),
    **dict.fromkeys(("export --samples x", "calibrate --bogus", "calibrate --mass heavy", "calibrate --payload heavy"), 2),
    **dict.fromkeys(("calibrate --duration soon", "calibrate --enable-effect springz", "calibrate --platform nosuch"), 2),
    **dict.fromkeys(("plan --bogus", "estimate log.csv --robot unitree_a1 --bogus", "weigh unitree_a1 --bogus"), 2),
}  # fmt: skip


def test_refusals_import_no_numeric_packages(tmp_path):
    """One process runs all commands."""
    code = (
        "import json, sys; from equipoise.cli import main\n"
        "for words in json.loads(sys.argv[1]):\n"
        "    code = main(words.split())\n"
        f"    print('END', json.dumps([words, code, [name for name in {COMPUTES} if name in sys.modules]]), file=sys.stderr)"
    )
    command = [sys.executable, "-c", code, json.dumps([*REFUSED])]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    ends = [json.loads(line.removeprefix("END ")) for line in done.stderr.splitlines() if line.startswith("END ")]
    assert ends == [[words, code, []] for words, code in REFUSED.items()]


MISSING = {
    "mujoco": "simulation needs MuJoCo: pip install 'equipoise[simulation]'",
    "dartpy": "simulation in DART needs dartpy: pip install 'equipoise[dart]'",
}


@pytest.mark.parametrize("engine", ENGINES)
def test_without_an_engine_the_simulation_names_the_package(engine):
    code = (
        f"import sys; sys.modules[{engine!r}] = None\n"
        "from equipoise import load_robot, simulate\n"
        f"try: simulate(load_robot('unitree_a1'), engine={engine.removesuffix('py')!r})\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    assert run_python(code).stdout.strip() == f"MissingDependencyError {MISSING[engine]}"


def test_exports_are_frozen():
    assert sorted(equipoise.__all__) == sorted(
        [
            "Audit", "Body", "Calibration", "ComSearchSettings", "CommunicationError",
            "PayloadChange", "Driver", "EquipoiseError", "Format", "Guard", "Health", "InertialParameters",
            "JointCommand", "LogReader", "Method", "PaperMethod", "Payload", "Platform", "BayesianMethod", "Quantity",
            "RawImu",
            "RawJoints", "RawLog", "Recording", "RecordingError", "RobotConnection", "RobotDescription", "RobotModel",
            "RobotState", "RunFolder", "ScaleReadings", "EffectSizes", "SettingsError", "Simulation",
            "Stance", "SteppedPlatform", "Subject", "ExcitationSettings", "TiltLimit", "Topics", "Trajectory",
            "Written", "__version__", "audit", "calibrate", "estimate", "export", "find_payload_change",
            "load_robot", "nominal_stance", "play_by_stepping", "simulate",
        ]
    )  # fmt: skip
    for name in equipoise.__all__:
        assert getattr(equipoise, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        equipoise.nothing  # noqa: B018
