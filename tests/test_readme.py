"""What the README says is what happens."""

import io
import re
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from equipoise import RobotDescription, errors
from equipoise.cli import INTERRUPTED

README = Path(__file__).parents[1] / "README.md"


@pytest.fixture(scope="module")
def text():
    return README.read_text(encoding="utf-8")


def test_the_python_example_prints_what_the_readme_shows(text):
    code, shown = re.search(r"```python\n(.*?)```\s*```\n(.*?)```", text, re.DOTALL).groups()
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(code, "README.md", "exec"), {})
    number = re.compile(r"-?\d+\.\d+")
    assert number.sub("#", printed.getvalue()) == number.sub("#", shown)
    # Engines of other versions step a little differently: half a millimetre, a tenth of a moment.
    for ours, theirs in zip(number.findall(printed.getvalue()), number.findall(shown), strict=True):
        assert float(ours) == pytest.approx(float(theirs), abs=0.5, rel=0.1)


def test_the_robot_description_in_the_readme_is_one(text, tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(re.search(r"```toml\n(.*?)```", text, re.DOTALL).group(1), encoding="utf-8")
    description = RobotDescription.from_toml(file)
    assert description.foot_frames["RR"] == "RR_foot"
    assert description.imu_rpy == (0.0, 0.0, 3.14159)


def test_the_exit_codes_in_the_readme_are_those_of_the_errors(text):
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)}
    raised = {
        error.exit_code
        for error in vars(errors).values()
        if isinstance(error, type) and issubclass(error, errors.EquipoiseError)
    }
    assert listed == raised | {0, 1, INTERRUPTED}


@pytest.mark.parametrize(
    "target",
    [
        "demo",
        "test",
        "lint",
        "types",
        "bench",
        "bench-accuracy",
        "bench-balance",
        "bench-monte-carlo",
        "bench-peers",
        "bench-speed",
    ],
)
def test_make_has_the_targets_that_documents_name(target):
    makefile = README.with_name("Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_files_that_the_readme_links_to_exist(text):
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        assert (README.parent / link).exists(), link
