"""Statement of each export on mass, CoM and inertia, and its truth."""

import json
import re

import numpy as np
import pytest
from exporting import found, make_run, usd, with_joints
from robots import load_text, quadruped_mjcf

from equipoise import export
from equipoise.cli import main
from equipoise.exports.format import Format
from equipoise.exports.formats import FORMATS
from equipoise.exports.subject import Subject, Written, number

WHOLE = "CoM [m] in the frame of base link 'trunk', inertia [kg m2] about the CoM in axes of base link 'trunk'"
LINK = "CoM [m] in the frame of that link, inertia [kg m2] about the CoM in axes of that link"
NO_COM = (
    "written of the composite: mass [kg], inertia [kg m2] about the CoM in axes of base link 'trunk'; {} "
    "cannot hold the composite's CoM, which is at (-0.00198, -0.00036, -0.01847) m in the frame of base link 'trunk'"
)
BOTH = f"written of the composite: mass [kg], {WHOLE}; written of the base: mass [kg], {WHOLE}"
NO_BODY = "written: {}; no mass, CoM or inertia of a body"
CONTENTS = {
    **dict.fromkeys(("urdf", "mjcf", "sdf", "usd", "xacro"), f"written of the base: mass [kg], {LINK}"),
    "quadruped-pympc": NO_COM.format("Quadruped-PyMPC's config.py"),
    "quad-sdk": NO_COM.format("Quad-SDK's ROBOT.yaml, main.m"),
    "unitree-guide": f"written of the composite: mass [kg], {WHOLE}",
    "mit-cheetah": NO_COM.format("MIT's Cheetah-Software") + f"; written of the base: mass [kg], {WHOLE}",
    "mjlab": f"written of the base, as ranges: mass [kg], {LINK}",
    "isaaclab": "written of the base, as ranges: mass [kg], CoM [m] in the frame of that link; "
    "Isaac Lab's event terms cannot hold the base's inertia",
    **dict.fromkeys(("yaml", "json"), BOTH),
    **dict.fromkeys(("toml", "c-header", "ros2", "unitree-yaml"), NO_BODY.format("sensors and motors")),
    **dict.fromkeys(("joint-offsets", "holosoma"), NO_BODY.format("sensors")),
}


@pytest.fixture(scope="module")
def result(a1):
    return with_joints(found(a1))


@pytest.fixture
def exported(result, a1, tmp_path):
    """Export to a format, with a user's file if the format needs one."""

    def exported(name, **options):
        if name == "mjcf":
            return export(found(load_text(tmp_path, quadruped_mjcf(), name="robot.xml")), name)
        if name == "usd":
            pytest.importorskip("pxr", reason="usd-core is not installed: USD is NOT TRIED")
            options["file"] = tmp_path / "a1.usda"
            options["file"].write_text(usd(a1), encoding="utf-8")
        return export(result, name, **options)

    return exported


def test_every_format_is_stated_here():
    assert set(CONTENTS) == set(FORMATS)


@pytest.mark.parametrize("name", FORMATS)
def test_every_file_states_its_contents_and_omissions(name, exported):
    out = exported(name)
    assert out.contents == CONTENTS[name]
    assert out.contents in " ".join(re.sub(r"^(#|//)? *", "", line) for line in out.text.splitlines())
    assert out.to_dict()["contents"] == out.contents


@pytest.mark.parametrize("name", [name for name, row in FORMATS.items() if row.bodies == ("composite",)])
def test_numbers_are_written_unless_stated_as_omitted(name, exported, result):
    row, text = FORMATS[name], without_header(exported(name))
    body = result.composite.parameters()
    numbers = {"mass": body.mass, "CoM": body.com[0], "inertia": body.inertia[0, 2]}
    written = {quantity for quantity, value in numbers.items() if number(value) in text}
    assert written == {quantity for quantity in numbers if f"composite {quantity}" not in row.lacks}


def without_header(out):
    return "\n".join(line for line in out.text.splitlines() if not any(text in line for text in out.header))


def test_mit_cheetah_has_the_com_of_the_base_alone(exported, result):
    text = without_header(exported("mit-cheetah"))
    assert number(result.base.parameters().com[0])[:8] in text
    assert number(result.composite.parameters().com[0])[:8] not in text


def test_a_payload_link_is_named(exported):
    assert exported("urdf", payload_link=True).contents == f"written of link 'equipoise_payload': mass [kg], {LINK}"


def test_other_parts_alone_hold_no_body(exported):
    assert exported("urdf", parameters="motors").contents == NO_BODY.format("motors")


@pytest.mark.parametrize("name", [name for name, row in FORMATS.items() if row.file != "model" and name != "usd"])
def test_the_terminal_states_it_too(name, a1, tmp_path, capsys):
    make_run(tmp_path / "run", a1)
    assert main(["export", str(tmp_path / "run"), "--to", name]) == 0
    assert CONTENTS[name] in " ".join(re.sub(r"^(#|//)? *", "", line) for line in capsys.readouterr().out.splitlines())


def test_the_terminal_states_it_of_all_formats_at_once(a1, tmp_path, capsys):
    make_run(tmp_path / "run", a1)
    assert main(["export", str(tmp_path / "run"), "--all", "--parameters", "all"]) == 0
    printed = capsys.readouterr().out
    rows = [" ".join(row.split()) for row in printed.replace("\n" + 18 * " ", " ").splitlines()]
    parts = {name: ", ".join(part for part in row.parts if part != "legs") for name, row in FORMATS.items()}
    held = {
        "quadruped-pympc": "composite without CoM",
        "unitree-guide": "composite",
        "mit-cheetah": "composite without CoM, base",
        "quad-sdk": "composite without CoM",
        "isaaclab": "base without inertia, sensors, motors",
        **dict.fromkeys(("yaml", "json"), "composite, base, sensors, motors"),
    }
    written = [name for name in FORMATS if f"{name}: not written" not in printed]
    assert len(written) >= len(FORMATS) - 2
    for name in written:
        assert any(row.startswith(f"{name} ") and row.endswith(f": {held.get(name, parts[name])}") for row in rows), (
            name
        )
    assert f"saved in {tmp_path / 'run' / 'export'}\n" in printed


def test_a_format_of_another_package_states_what_it_declares(result):
    row = Format(
        "scale", ("base",), "", False, "a scale", "scale.txt", lambda subject: Written.text([subject.contents], ""),
        lacks=("base CoM", "base inertia"),
    )  # fmt: skip
    x, y, z = Subject(result).base.com
    assert row.contents(("base",), Subject(result)) == (
        "written of the base: mass [kg]; a scale cannot hold the base's inertia and CoM, which "
        f"is at ({x:.5f}, {y:.5f}, {z:.5f}) m in the frame of that link"
    )
    assert np.isfinite([x, y, z]).all()


def test_json_has_a_key_for_it(exported):
    assert json.loads(exported("json").text)["contents"] == CONTENTS["json"]
