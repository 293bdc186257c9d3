"""Formats: their content, their errors, and the numbers that a consumer reads."""

import ast
import dataclasses
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from exporting import CONST, INERTIAL, SDF, assert_same, found
from robots import load_text, quadruped_urdf
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import equipoise
from equipoise import export
from equipoise.errors import ModelError, NotEstimatedError, SettingsError
from equipoise.exports.formats import FORMATS
from equipoise.exports.randomisation import (
    ENTRIES,
    components_of,
    drawn_bases,
    entries_between,
    entry_ranges,
    pseudo_inertias,
)
from equipoise.result.body import Body
from equipoise.result.findings import Check
from equipoise.robot.inertial import COMPONENTS, InertialParameters, base_parameters, components

NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
OWN_FILES = sorted(name for name, row in FORMATS.items() if row.file != "model" and row.bodies and name != "usd")


@pytest.fixture(scope="module")
def result(a1):
    return found(a1)


@pytest.fixture(scope="module")
def composite(result):
    return result.composite.parameters()


@pytest.fixture(scope="module")
def base(result):
    return result.base.parameters()


def assert_tensor(rows, body):
    np.testing.assert_array_equal(np.array(rows), body.inertia)


def read_values(text):
    return [float(word) for word in NUMBER.findall(text)]


# --- what every output says


@pytest.mark.parametrize("name", ["urdf", *OWN_FILES])
def test_every_output_has_a_header(name, result):
    out = export(result, name, run="runs/a1")
    text = " ".join(out.text.split())
    assert f"equipoise {equipoise.__version__}" in out.header[0]
    assert out.header[1] == out.contents
    assert out.header[2] == "from run runs/a1 (unitree_a1, method bayesian)"
    assert out.header[3].startswith("stance [rad]: FL_hip_joint 0, FL_thigh_joint 0.722734, FL_calf_joint -1.44547")
    assert out.header[4] == f"model: urdf, sha256 {result.model['sha256']}"
    assert result.model["sha256"] in text
    assert "runs/a1" in text
    assert "base link 'trunk'" in text or "link 'trunk'" in text
    assert "0.722734" in text


@pytest.mark.parametrize("name", ["urdf", *OWN_FILES])
def test_objections_are_in_the_file(name, a1):
    weak = {("composite", "Ixz"): "weak", ("base", "Ixz"): "weak"}
    out = export(found(a1, verdicts=weak, assumptions=("no cable pulls at the robot",)), name)
    assert out.notes[0] == "assumed: no cable pulls at the robot"
    assert out.notes[1].startswith("weakly identified: ")
    assert all(note in out.text for note in out.notes)


@pytest.mark.parametrize("name", ["urdf", *OWN_FILES])
def test_a_result_with_a_failed_check_is_refused_unless_forced(name, a1):
    result = found(
        a1, checks=(Check("stance motion residuals", False, "they slid"), Check("lift residuals", True, "they fit"))
    )
    doubtful = dataclasses.replace(result, composite=result.composite.doubted(), base=result.base.doubted())
    with pytest.raises(NotEstimatedError) as error:
        export(doubtful, name)
    assert str(error.value) == (
        "the result is doubtful: check failed: stance motion residuals: they slid; fix this and calibrate again, or "
        "write it anyway with --force"
    )
    forced = export(doubtful, name, force=True)
    assert forced.notes == ("check failed: stance motion residuals: they slid",)
    assert forced.notes[0] in forced.text


def test_only_bodies_that_a_format_needs_must_be_identified(a1):
    doubtful = found(a1, verdicts={("base", "Iyz"): "not identified", ("base", "mass"): "not identified"})
    assert export(doubtful, "quadruped-pympc").notes == ()
    assert export(doubtful, "urdf", payload_link=True).notes == ()
    with pytest.raises(NotEstimatedError) as error:
        export(doubtful, "urdf")
    assert str(error.value) == (
        "not identified by this run: base mass, base Iyz; calibrate longer (--duration) or with a scale (--mass), or write "
        "them anyway with --force"
    )
    forced = export(doubtful, "urdf", force=True)
    assert forced.notes == ("FORCED: not identified, close to the model file's values: base mass, base Iyz",)
    assert forced.notes[0] in forced.text


@pytest.mark.parametrize("name", [name for name, row in FORMATS.items() if row.bodies])
@pytest.mark.parametrize("force", [False, True])
def test_bodies_that_a_method_does_not_estimate_are_refused(name, force, result):
    paper = dataclasses.replace(
        result, method="paper", composite=Body.partial(com_in_base=(0.01, 0.0, None)), base=Body.partial()
    )
    with pytest.raises(NotEstimatedError) as error:
        export(paper, name, force=force)
    assert "this calibration does not estimate mass, inertia, com_in_base." in str(error.value)
    assert str(error.value).endswith("use --method bayesian, with base in --parameters")


def test_a_base_with_negative_mass_is_refused(a1):
    result = found(a1)
    missing = InertialParameters(5.0, np.array([0.0, 0.0, 0.1]), 0.05 * np.eye(3))
    light = InertialParameters.from_vector(result.nominal.composite.vector - missing.vector)
    with pytest.raises(NotEstimatedError) as error:
        export(dataclasses.replace(result, composite=Body.complete(light, model=result.nominal.composite)), "xacro")
    assert str(error.value).startswith("base link 'trunk', minus the model's legs, would have a mass of -0.286")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("tomll", {}, "'tomll' is not a format; did you mean 'toml'? it must be one of urdf"),
        ("gazebo", {}, "'gazebo' is not a format; it must be one of urdf, mjcf, sdf, usd, xacro, quadruped-pympc,"),
        (
            "yaml",
            {"file": "a.yaml"},
            "--file: format yaml edits no file; omit --file, and use its output for tools of your own",
        ),
        ("xacro", {"payload_link": True}, "--add-payload-link: format xacro has no links; use urdf, mjcf, sdf"),
        (
            "urdf",
            {"samples": 3},
            "--samples is 3; it must be zero or more, and only mjlab and isaaclab list drawn bodies",
        ),
        ("mjlab", {"samples": -1}, "--samples is -1"),
        ("mjlab", {"samples": 10_001}, "--samples is 10001; it must be at most 10000"),
        ("mjlab", {"seed": -1}, "--seed is -1; it must be zero or more"),
        ("xacro", {"file": "nowhere.xacro"}, "--file 'nowhere.xacro' cannot be read: No such file or directory"),
    ],
)
def test_arguments_that_a_format_does_not_take_are_refused(name, options, message, result):
    with pytest.raises(SettingsError) as error:
        export(result, name, **options)
    assert message in str(error.value)


def test_base_and_the_models_legs_make_the_composite(result, base):
    adjusted = dataclasses.replace(base, mass=base.mass + 0.05)  # with legs that are 50 g lighter than the model's
    other = dataclasses.replace(result, base=Body.complete(adjusted, model=result.nominal.base))
    written = json.loads(export(other, "json").text)["base"]
    assert written["mass"] == pytest.approx(base.mass, rel=1e-12)


# --- controllers


def test_quadruped_pympc_runs_as_python(result, composite):
    names = {"np": np}
    exec(export(result, "quadruped-pympc").text, names)
    assert names["mass"] == composite.mass
    assert_tensor(names["inertia"], composite)


# What the snippets meet in the controllers' files, without Eigen: comma initialisers of vectors and matrices.
EIGEN = """#include <array>
#include <cstdio>
template <int N> struct Numbers {
  double data[N]; int filled = 0;
  Numbers& operator<<(double v) { filled = 0; data[filled++] = v; return *this; }
  Numbers& operator,(double v) { data[filled++] = v; return *this; }
  Numbers operator*(double f) const { Numbers n = *this; for (double& v : n.data) v *= f; return n; }
  void print() const { for (double v : data) std::printf("%.17g ", v); std::puts(""); }
};
typedef float fpt;
"""


def compiled(body, tmp_path):
    """Return the output of a compiled program as lists of numbers; skip without a compiler."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    (tmp_path / "check.cpp").write_text(EIGEN + body, encoding="utf-8")
    subprocess.run([compiler, "-std=c++14", "-o", tmp_path / "check", tmp_path / "check.cpp"], check=True)
    done = subprocess.run([tmp_path / "check"], capture_output=True, text=True, check=True)
    return [[float(word) for word in line.split()] for line in done.stdout.splitlines()]


def test_unitree_guide_compiles(result, composite, tmp_path):
    body = (
        "int main() { double _mass; Numbers<3> _pcb; Numbers<9> _Ib;\n"
        + export(result, "unitree-guide").text
        + 'std::printf("%.17g\\n", _mass); _pcb.print(); _Ib.print(); }'
    )
    (mass,), com, inertia = compiled(body, tmp_path)
    assert_same(InertialParameters(mass, np.array(com), np.array(inertia).reshape(3, 3)), composite, 1e-15)


def test_mit_cheetah_compiles(result, composite, base, tmp_path):
    text = export(result, "mit-cheetah").text
    state, robot = text.split("// common/include/Dynamics/MiniCheetah.h: base\n")
    body = (
        "struct Cheetah { double _bodyMass; } cheetah;\n"
        "template <class T> struct Vec3 { double v[3]; Vec3(double a, double b, double c) : v{a, b, c} {} };\n"
        "int main() { typedef double T; Numbers<9> I_body, bodyRotationalInertia;\n"
        f'{state} std::printf("%.9g\\n", m); I_body.print();\n'
        f'{robot} std::printf("%.17g\\n", cheetah._bodyMass); bodyRotationalInertia.print();\n'
        'std::printf("%.17g %.17g %.17g\\n", bodyCOM.v[0], bodyCOM.v[1], bodyCOM.v[2]); }'
    )
    (mass,), inertia, (base_mass,), base_inertia, base_com = compiled(body, tmp_path)
    assert mass == pytest.approx(composite.mass, rel=1e-7)
    np.testing.assert_allclose(np.reshape(inertia, (3, 3)), composite.inertia, rtol=1e-7)
    written = InertialParameters(base_mass, np.array(base_com), np.reshape(base_inertia, (3, 3)))
    assert_same(written, base, 1e-12)


def test_quad_sdk_is_yaml_with_matlab_values(result, composite):
    yaml = pytest.importorskip("yaml")
    text = export(result, "quad-sdk").text
    table = yaml.safe_load(text)["/**/global_body_planner"]["ros__parameters"]["global_body_planner"]
    assert table == {"mass": composite.mass}
    matlab = re.search(r"inertia_body = \[(.*)\];", text)[1]
    assert_tensor([[float(word) for word in row.split()] for row in matlab.split(";")], composite)
    assert f"parameter.physics.mass_body = {composite.mass!r};" in text


def test_json_and_yaml_hold_both_bodies_with_verdicts(result, composite, base):
    table = json.loads(export(result, "json").text)
    assert table["composite"]["mass"] == composite.mass
    assert table["composite"]["verdict"]["Ixy"] == "identified"
    assert table["base"]["std"]["mass"] == pytest.approx(0.02 * base.mass)
    yaml = pytest.importorskip("yaml")
    assert yaml.safe_load(export(result, "yaml").text) == table


def test_numbers_of_yaml_are_numbers_in_yaml_1_1(a1):
    yaml = pytest.importorskip("yaml")
    tiny = found(a1, InertialParameters(1e-5, np.zeros(3), 1e-12 * np.eye(3)))
    tiny = dataclasses.replace(
        tiny, joint_position={**tiny.joint_position, "FL_hip_joint": 1e-05, "FR_hip_joint": -2e-17}
    )
    position = yaml.safe_load(export(tiny, "yaml").text)["stance"]["joint_position"]
    assert (position["FL_hip_joint"], position["FR_hip_joint"]) == (1e-05, -2e-17)


# --- xacro and sdf


def xacro_properties(text):
    root = ET.fromstring(text)
    return {e.get("name"): e.get("value") for e in root if e.tag.endswith("}property")}


def assert_trunk(properties, body):
    com = [float(properties[f"trunk_com_{axis}"]) for axis in "xyz"]
    inertia = [[float(properties[f"trunk_i{''.join(sorted(a + b))}"]) for b in "xyz"] for a in "xyz"]
    assert_same(InertialParameters(float(properties["trunk_mass"]), np.array(com), np.array(inertia)), body, 1e-12)


def test_xacro_has_the_properties_that_legged_control_reads(result, base):
    assert_trunk(xacro_properties(export(result, "xacro").text), base)


def test_a_users_const_xacro_keeps_everything_else(result, base, tmp_path):
    file = tmp_path / "const.xacro"
    file.write_text(CONST, encoding="utf-8")
    text = export(result, "xacro", file=file).text
    assert_trunk(xacro_properties(text), base)
    plain = re.sub(r"<!-- equipoise .*?-->\s*", "", text, flags=re.DOTALL)
    blank = re.compile(r"(trunk_\w+[\"']\s*value=)([\"']).*?\2")
    assert blank.sub(r"\1\2", plain) == blank.sub(r"\1\2", CONST)


@pytest.mark.parametrize(
    ("change", "missing"),
    [(("trunk_iyz", "body_iyz"), "trunk_iyz"), (("hip_mass", "trunk_mass"), "trunk_mass")],
    ids=["missing", "twice"],
)
def test_a_const_xacro_of_another_kind_is_refused(change, missing, result, tmp_path):
    (tmp_path / "const.xacro").write_text(CONST.replace(*change), encoding="utf-8")
    with pytest.raises(SettingsError, match=f"once; it does not define {missing}"):
        export(result, "xacro", file=tmp_path / "const.xacro")


def sdf_body(inertial):
    """Return the body of an <inertial> element, in its link's axes."""
    x, y, z, *rpy = read_values(inertial.findtext("pose"))
    turn = Rotation.from_euler("xyz", rpy).as_matrix()
    moments = [[float(inertial.findtext(f"inertia/i{''.join(sorted(a + b))}")) for b in "xyz"] for a in "xyz"]
    return InertialParameters(float(inertial.findtext("mass")), np.array([x, y, z]), turn @ np.array(moments) @ turn.T)


def test_sdf_alone_is_an_inertial(result, base):
    assert_same(sdf_body(ET.fromstring(export(result, "sdf").text)), base, 1e-12)


@pytest.mark.parametrize("inertial", [INERTIAL, "", "<inertial/>", "<inertial><mass/></inertial>"])
def test_a_users_sdf_keeps_everything_else(inertial, result, base, tmp_path):
    (tmp_path / "model.sdf").write_text(SDF.format(inertial), encoding="utf-8")
    text = export(result, "sdf", file=tmp_path / "model.sdf").text
    links = ET.fromstring(text).findall("world/model/link")
    assert_same(sdf_body(links[0].find("inertial")), base, 1e-12)
    assert text.endswith(SDF.split("<visual", 1)[1].format())
    assert ("<!-- CAD -->" in text) == ("CAD" in inertial)


def test_a_payload_is_a_link_of_an_sdf(result, base, a1, tmp_path):
    (tmp_path / "model.sdf").write_text(SDF.format(INERTIAL), encoding="utf-8")
    for text in (export(result, "sdf", payload_link=True, file=tmp_path / "model.sdf").text,
                 f"<model>{export(result, 'sdf', payload_link=True).text}</model>"):  # fmt: skip
        root = ET.fromstring(text)
        link = next(e for e in root.iter("link") if e.get("name") == "equipoise_payload")
        assert link.find("pose").attrib == {"relative_to": "trunk"}
        added = sdf_body(link.find("inertial"))
        assert_same(InertialParameters.from_vector(base_parameters(a1).vector + added.vector), base)
        joint = next(e for e in root.iter("joint") if e.get("name") == "equipoise_payload_joint")
        assert (joint.get("type"), joint.findtext("parent"), joint.findtext("child")) == (
            "fixed",
            "trunk",
            "equipoise_payload",
        )
    assert SDF.format(INERTIAL).split("</model>")[0].rstrip() in export(
        result, "sdf", payload_link=True, file=tmp_path / "model.sdf"
    ).text  # fmt: skip


def test_an_sdf_that_would_count_masses_twice_is_refused(result, tmp_path):
    (tmp_path / "model.sdf").write_text(SDF.format(INERTIAL).replace("revolute", "fixed"), encoding="utf-8")
    with pytest.raises(ModelError, match="whose masses would be counted twice"):
        export(result, "sdf", file=tmp_path / "model.sdf")
    assert export(result, "sdf", file=tmp_path / "model.sdf", payload_link=True).notes == ()


# --- domain randomisation


def pseudo_of(body):
    return pseudo_inertias(body.vector[None])[0]


def stretched(pseudo, entries):
    """Return the body, in the order of COMPONENTS, whose pseudo-inertia is U J0 U', for the entries of U."""
    alpha, d1, d2, d3, s12, s13, s23, t1, t2, t3 = entries
    upper = np.exp(alpha) * np.array(
        [[np.exp(d1), s12, s13, t1], [0, np.exp(d2), s23, t2], [0, 0, np.exp(d3), t3], [0, 0, 0, 1]]
    )
    return components_of((upper @ pseudo @ upper.T)[None])[0]


def draw(result, scale=1.0, **options):
    covariance = scale * result.composite.covariance
    return drawn_bases(result.base.parameters(), result.composite.parameters(), covariance, seed=2, **options)


def test_zero_entries_give_the_body_itself(base):
    np.testing.assert_allclose(stretched(pseudo_of(base), np.zeros(10)), components(base), rtol=1e-12, atol=1e-15)


def test_entries_and_bodies_are_the_same(result, base):
    drawn = draw(result, draws=50)
    again = [stretched(pseudo_of(base), entries) for entries in entries_between(drawn, pseudo_of(base))]
    np.testing.assert_allclose(again, components_of(drawn), rtol=1e-9, atol=1e-12)


def test_robots_with_drawn_bases_have_the_covariance_of_the_composite(result, base, composite):
    drawn = draw(result, 0.01, draws=4000)  # small enough that every body can exist
    legs = composite.vector - base.vector
    robots = np.array(
        [components(InertialParameters.from_vector(body_from(row).vector + legs)) for row in components_of(drawn)]
    )
    covariance = 0.01 * result.composite.covariance
    std = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(robots.std(axis=0), std, rtol=0.05)
    np.testing.assert_allclose(np.corrcoef(robots.T), covariance / np.outer(std, std), atol=0.06)


def body_from(row):
    xx, yy, zz, xy, xz, yz = row[4:]
    return InertialParameters(row[0], row[1:4], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def test_drawn_bodies_are_physical_for_any_covariance(result, base):
    drawn = draw(result, 100.0, draws=300)
    for row in components_of(drawn):
        assert np.linalg.eigvalsh(pseudo_of(body_from(row))).min() > 0
        assert body_from(row).physical_defect() is None


def test_nothing_is_drawn_from_a_huge_covariance(base, composite):
    with pytest.raises(NotEstimatedError, match="less than 1% of the bodies"):
        drawn_bases(base, composite, np.diag([0.0] * 7 + [10.0] * 3), seed=0, draws=300)


def test_nothing_is_drawn_around_a_plate(base, composite):
    plate = InertialParameters(1.0, np.zeros(3), np.diag([0.01, 0.01, 0.02]))
    with pytest.raises(NotEstimatedError, match="as flat as a plate"):
        drawn_bases(plate, composite, np.eye(10), seed=0)


def test_entries_drawn_independently_stay_within_the_posterior(result, base):
    entries = entries_between(draw(result), pseudo_of(base))
    half = np.array([high for _, high in entry_ranges(entries).values()])
    precision = np.linalg.inv(np.cov(entries.T))
    boxed = np.random.default_rng(0).uniform(-half, half, (2000, 10))
    inside = np.einsum("ni,ij,nj->n", boxed, precision, boxed) < chi2.ppf(0.95, 10)
    assert inside.mean() > 0.7


def python_names(text):
    names = {}
    exec(text, names)
    return names


def test_mjlab_has_the_ranges_of_its_pseudo_inertia_term(result, base):
    names = python_names(export(result, "mjlab", samples=20, seed=5).text)
    assert set(names["PSEUDO_INERTIA"]) == {f"{name}_range" for name in ENTRIES}
    corners = np.array(list(names["PSEUDO_INERTIA"].values()))
    assert (corners[:, 0] < 0).all()
    assert (corners[:, 1] > 0).all()
    rng = np.random.default_rng(0)
    for _ in range(50):
        body = body_from(stretched(pseudo_of(base), rng.uniform(*corners.T)))
        assert body.physical_defect() is None
    assert set(names["QUANTILES"]) == set(COMPONENTS)
    assert len(names["SAMPLES"]) == 20
    assert (names["BASE_LINK"], names["SEED"]) == ("trunk", 5)
    low, high = names["QUANTILES"]["mass"]
    std = result.composite.mass.std
    assert high - low == pytest.approx(2 * 1.96 * std, rel=0.1)


def test_isaaclab_scales_the_mass_and_shifts_the_com(result, base):
    names = python_names(export(result, "isaaclab").text)
    low, high = names["MASS"]["mass_distribution_params"]
    assert names["MASS"]["operation"] == "scale"
    assert (low * base.mass, high * base.mass) == pytest.approx(names["QUANTILES"]["mass"])
    for axis, found_at in zip("xyz", base.com, strict=True):
        shift = np.array(names["COM"]["com_range"][axis])
        np.testing.assert_allclose(found_at + shift, names["QUANTILES"][f"com_{axis}"])
    assert "SAMPLES" not in names


def test_draws_depend_on_the_seed(result):
    first, again, other = (export(result, "mjlab", samples=3, seed=seed).content for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.parametrize("name", ["mjlab", "isaaclab"])
def test_without_a_covariance_nothing_is_drawn(name, result):
    with pytest.raises(NotEstimatedError, match="has no covariance"):
        export(dataclasses.replace(result, composite=dataclasses.replace(result.composite, covariance=None)), name)


def test_a_comment_in_the_file_names_the_term(result):
    text = export(result, "mjlab").text
    call = re.sub(r"\n#\s*", " ", text[text.index("EventTermCfg") : text.index("\nPSEUDO")])
    assert isinstance(ast.parse(call).body[0].value, ast.Call)


def test_a_name_with_quotes_stays_one_name(tmp_path):
    result = found(load_text(tmp_path, quadruped_urdf(trunk="tr'unk")))
    assert python_names(export(result, "isaaclab").text)["BASE_LINK"] == "tr'unk"


HOSTILE = [
    "a\nimport os",
    "x\\",
    "*/ int main() {} /*",
    "--><evil/><!--",
    "'''\"\"\"]]>",
    "../../etc/x",
    "a\u2028b\x85c",
    "\x00\x1b[31m",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_names_cannot_inject_code(result, name):
    hostile = dataclasses.replace(result, robot=name)
    for row in map(FORMATS.get, OWN_FILES):
        text = export(hostile, row.name, run=name).text
        assert all(letter.isprintable() or letter == "\n" for letter in text)
        if row.name in ("mjlab", "isaaclab", "quadruped-pympc"):
            tree = ast.parse(text)
            assert not any(isinstance(node, (ast.Import, ast.ImportFrom)) for node in ast.walk(tree))
        elif row.name in ("unitree-guide", "mit-cheetah"):
            comments = [line for line in text.splitlines() if "//" in line]
            assert not any(line.endswith(("\\", "??/")) for line in comments)
            assert "main" not in "".join(line for line in text.splitlines() if line not in comments)
        elif row.name == "sdf":
            assert [element.tag for element in ET.fromstring(f"<all>{text}</all>")] == ["inertial"]
        elif row.name == "json":
            assert json.loads(text)["robot"] == name
