"""Lists of platforms with a broken, old or incomplete package: complete, with the package, the reason and the remedy."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

BROKEN = {
    "no shared library": ({"__init__": "raise OSError('libddsc.so.0: cannot open shared object file')"}, "OSError: libddsc"),
    "a name that is gone": ({"__init__": "import sys; sys.nothing"}, "AttributeError: module 'sys' has no attribute"),
    "half there": ({"__init__": ""}, "ModuleNotFoundError: No module named 'cyclonedds.builtin'"),
    "old": ({"__init__": "", "builtin": "class Listener: ..."}, "ImportError: cannot import name 'BuiltinDataReader'"),
    "no module": ({"__init__": "raise SyntaxError('invalid syntax')\nx"}, "SyntaxError: invalid syntax"),
}  # fmt: skip
ON_DDS = {"unitree-go2", "unitree-b2", "ros2"}
LISTED = """
import sys
if len(sys.argv) > 1: sys.modules[sys.argv[1]] = None  # as if it were not installed
from equipoise.cli import main
assert main(["platforms", "--json"]) == 0
assert main(["platforms"]) == 0
sys.exit(main(["doctor", "--platform", "unitree-go2", "--set", "interface=lo"]))
"""


def listed(path, *missing):
    """Return the output of the list and the doctor with packages before the installed ones: rows, text, error."""
    found = os.pathsep.join(part for part in (str(path), os.environ.get("PYTHONPATH")) if part)
    done = subprocess.run(
        [sys.executable, "-c", LISTED, *missing], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": found, "COLUMNS": "1000"},
    )  # fmt: skip
    assert done.returncode == 7, done.stderr
    assert "Traceback" not in done.stderr
    table, end = json.JSONDecoder().raw_decode(done.stdout)
    return {row["name"]: row["settings"] for row in table["platforms"]}, done.stdout[end:], done.stderr


@pytest.mark.parametrize(("modules", "reason"), BROKEN.values(), ids=BROKEN)
def test_a_broken_package_leaves_the_list_whole_with_reason_and_remedy(tmp_path, modules, reason):
    package = tmp_path / "cyclonedds"
    package.mkdir()
    for name, text in modules.items():
        (package / f"{name}.py").write_text(text, encoding="utf-8")
    rows, text, error = listed(tmp_path)
    assert len(rows) == 5
    message = re.compile(
        rf"cyclonedds in {re.escape(str(package))} is broken or too old \({re.escape(reason)}.*\): "
        r"pip install --force-reinstall 'cyclonedds>=\S+'"
    )
    for name, settings in rows.items():
        if name in ON_DDS:
            assert settings.startswith("cannot be used here: ")
            assert message.search(settings)
        else:
            assert "address" in [setting for setting, *_ in settings]
    assert text.count("cannot be used here: ") == 3
    assert message.search(error)


def test_a_missing_package_is_named_with_its_command():
    rows, _, error = listed("", "cyclonedds")
    message = r"DDS needs cyclonedds: pip install 'cyclonedds>=\d[\d.]*,<\d[\d.]*'$"
    assert all(re.search(message, rows[name]) for name in ON_DDS)
    assert re.search(message, error.strip())


def test_a_driver_whose_own_package_is_broken():
    code = (
        "import sys; from equipoise import load_robot; robot = load_robot('unitree_a1'); sys.modules['socket'] = None\n"
        "from equipoise.errors import MissingDependencyError\n"
        "from equipoise.drivers.platforms import open_connection\n"
        "try: open_connection('unitree-go1', robot, {})\n"
        "except MissingDependencyError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    message = r"platform 'unitree-go1' needs a package that is broken \(ModuleNotFoundError: .*\): reinstall it\n"
    assert re.fullmatch(message, done.stdout)


def test_remedies_agree_with_the_projects_requirements():
    cyclone = pytest.importorskip("equipoise.drivers.dds.cyclone", exc_type=ImportError)
    assert cyclone.INSTALL.strip("'") in (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
