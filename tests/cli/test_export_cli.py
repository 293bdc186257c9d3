"""`equipoise export` for users and scripts."""

import copy
import dataclasses
import json
import os
import shutil

import numpy as np
import pytest
from commands import fails
from exporting import assert_same, composite_in_equipoise, composite_in_pinocchio, found, make_run

from equipoise import BayesianMethod, RunFolder, export
from equipoise.cli import main
from equipoise.exports.acceptance import ParameterNote
from equipoise.exports.formats import FORMATS
from equipoise.result.body import Body
from equipoise.robot.inertial import InertialParameters
from equipoise.terminal.export_listing import merged
from equipoise.terminal.results import print_calibration


@pytest.fixture(scope="module")
def run(a1, tmp_path_factory):
    """A finished run."""
    path = tmp_path_factory.mktemp("runs") / "a1"
    make_run(path, a1)
    return path


def test_the_file_is_in_the_run_folder_and_described(run, a1, capsys):
    assert main(["export", str(run), "--to", "urdf"]) == 0
    path = run / "export" / "a1.urdf"
    printed = capsys.readouterr().out
    assert "the <inertial> of link 'trunk'" in printed
    assert f"from run {run} (unitree_a1, method bayesian, 2026-01-01T00:00:00+00:00)" in printed
    assert f"sha256 {a1.source.sha256}" in printed
    assert f"saved: {path}" in printed
    result = RunFolder.open(run).result()
    assert_same(composite_in_equipoise(path, result, a1), result.composite.parameters())


def test_a_real_calibration_goes_into_the_users_file(bayesian_run, a1, tmp_path):
    result = bayesian_run.result
    out = export(result, "urdf", force=True)
    written = composite_in_pinocchio(out.save(tmp_path / "a1.urdf"), result, {})
    # Its trunk is nearly as flat as a body can be: what was found of inertia may have to give way within its interval.
    given = result.composite.parameters()
    assert_same(InertialParameters(written.mass, written.com, given.inertia), given)
    assert (np.abs(written.inertia - given.inertia) / result.composite.inertia.stds).max() < 1
    assert export(result, "mjlab", force=True).content


def test_short_texts_are_shown_whole(run, capsys):
    assert main(["export", str(run / "calibration.json"), "--to", "unitree-guide"]) == 0
    written = (run / "export" / "unitreeRobot.cpp").read_text(encoding="utf-8")
    assert written in capsys.readouterr().out


def test_another_result_in_the_runs_folder_is_of_its_model(run, capsys):
    result = RunFolder.open(run).result()
    mass = dataclasses.replace(result.composite.mass, value=20.0)
    heavier = dataclasses.replace(result, composite=dataclasses.replace(result.composite, mass=mass))
    heavier.save(run / "weighed.json")
    assert main(["export", str(run / "weighed.json"), "--to", "json", "--json"]) == 0
    own = run / "export" / "a1.urdf"
    assert main(["export", str(run), "--to", "urdf", "--quiet"]) == 0
    before = own.read_bytes()
    assert main(["export", str(run / "weighed.json"), "--to", "urdf"]) == 0
    printed = capsys.readouterr().out
    assert f"from run {run / 'weighed.json'}" in printed
    assert f"saved: {own.with_name('a1_weighed.urdf')}" in printed
    assert own.read_bytes() == before
    (run / "weighed.json").unlink()


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["urdf", "--parameters", "motors"], "a1_motors.urdf"),
        (["urdf", "--parameters", "motors,base"], "a1_base_motors.urdf"),
        (["urdf", "--parameters", "base"], "a1.urdf"),
        (["json", "--parameters", "all"], "inertia_base_sensors_motors.json"),
        (["toml", "--parameters", "all"], "sensors_and_motors.toml"),
        (["toml", "--parameters", "motors"], "motors.toml"),
        (["c-header", "--parameters", "sensors"], "sensors.h"),
    ],
)
def test_file_names_contain_the_parameters(arguments, name, run, capsys):
    assert main(["export", str(run), "--to", *arguments]) == 0
    assert f"saved: {run / 'export' / name}\n" in capsys.readouterr().out


def test_the_next_command_names_the_format_of_the_model(run, tmp_path, capsys):
    result = RunFolder.open(run).result()
    print_calibration(result, [run / "report.html"], kept=run)
    assert f"export with: equipoise export {run} --to urdf\n" in capsys.readouterr().out
    mjcf = dataclasses.replace(result, model={**result.model, "format": "mjcf"})
    print_calibration(mjcf, [], kept=run)
    assert f"export with: equipoise export {run} --to mjcf\n" in capsys.readouterr().out
    result.save(tmp_path / "found.json")
    print_calibration(result, [], kept=tmp_path / "found.json")
    assert f"found.json --to urdf --file {result.robot_model.source.path}\n" in capsys.readouterr().out
    print_calibration(result, [tmp_path / "my runs" / "calibration.json"], kept=tmp_path / "my runs")
    printed = capsys.readouterr().out
    assert f"equipoise export '{tmp_path / 'my runs'}' --to urdf\n" in printed
    assert f"equipoise estimate '{tmp_path / 'my runs'}'\n" in printed
    print_calibration(result, [run / "report.html"])
    assert "export with" not in capsys.readouterr().out
    mass = dataclasses.replace(result.base.mass, verdict="not identified")
    print_calibration(
        dataclasses.replace(result, base=dataclasses.replace(result.base, mass=mass)), [run / "report.html"], kept=run
    )
    printed = capsys.readouterr().out
    assert "export with" not in printed
    assert "not identified, and refused by export: base mass; calibrate longer" in printed


def test_json_is_one_object(run, capsys):
    assert main(["export", str(run), "--to", "sdf", "--json", "--add-payload-link"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "equipoise.export/1"
    assert table["bodies"] == ["composite"]
    assert table["path"] == str(run / "export" / "base_payload.sdf")
    assert "equipoise_payload" in table["about"][0]
    assert table["notes"] == []


def test_the_path_of_a_file_is_printed_as_the_run_was_named(run, monkeypatch, capsys):
    monkeypatch.chdir(run.parent)
    assert main(["export", run.name, "--to", "yaml"]) == 0
    assert f"\nsaved: {os.path.join(run.name, 'export', 'inertia.yaml')}\n" in capsys.readouterr().out


def test_quiet_prints_nothing(run, capsys):
    assert main(["export", str(run), "--to", "yaml", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("arguments", [[], ["--list"], ["RUN"]])
def test_without_a_format_the_table_is_shown(arguments, run, capsys):
    assert main(["export", *(str(run) if word == "RUN" else word for word in arguments)]) == 0
    printed, warnings = capsys.readouterr()
    assert all(name in printed for name in FORMATS)
    nothing = f"nothing was written; name a format, for example: equipoise export {run} --to urdf\n"
    assert warnings == (nothing if arguments == ["RUN"] else "")
    assert max(map(len, printed.splitlines()[: len(FORMATS) + 3])) <= 80
    assert main(["export", *(str(run) if word == "RUN" else word for word in arguments), "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in table["formats"]] == list(FORMATS)


def test_a_list_for_a_run_has_what_it_estimated_and_why_other_formats_cannot_be_written(run, tmp_path, capsys):
    assert main(["export", str(run), "--list"]) == 0
    printed = capsys.readouterr().out
    rows = [line.split() for line in printed.splitlines()]
    assert ["urdf", "base,", "motors", "your", "URDF", "model", "file"] in rows  # no legs: not estimated by this run
    assert "\nusd: not written: format usd edits your own stage" in printed
    assert main(["export", str(run), "--list", "--json"]) == 0
    found = {row["name"]: row for row in json.loads(capsys.readouterr().out)["formats"]}
    assert found["urdf"]["of_run"] == ["base", "motors"]
    assert "edits your own stage" in found["usd"]["not_written"]
    assert "does not exist" in fails(capsys, 5, "export", str(tmp_path / "no"), "--list")


def test_the_users_file_is_overwritten_only_by_name(run, a1, tmp_path, capsys):
    copy = tmp_path / "a1"
    shutil.copytree(run, copy)
    mine = copy / "export" / "a1.urdf"
    mine.parent.mkdir(exist_ok=True)
    mine.write_bytes(a1.source.path.read_bytes())
    message = fails(capsys, 6, "export", str(copy), "--to", "urdf", "--file", str(mine))
    assert message == f"error: {str(mine)!r} is the file to edit; to overwrite it, pass it to --out too"
    assert mine.read_bytes() == a1.source.path.read_bytes()
    assert main(["export", str(copy), "--to", "urdf", "--file", str(mine), "--out", str(mine)]) == 0
    assert mine.read_bytes() != a1.source.path.read_bytes()


def test_parameters_that_are_not_identified_need_force(a1, tmp_path, capsys):
    doubtful = found(a1, verdicts={("composite", "com_z"): "not identified"})
    doubtful.save(tmp_path / "calibration.json")
    arguments = ["export", str(tmp_path / "calibration.json"), "--to", "quad-sdk"]
    assert "not identified by this run: composite com_z; " in fails(capsys, 8, *arguments)
    assert main([*arguments, "--force"]) == 0
    assert "warning: FORCED: not identified" in capsys.readouterr().out
    assert "FORCED" in (tmp_path / "export" / "quad-sdk.yaml").read_text(encoding="utf-8")


def test_errors_name_the_remedy(run, a1, tmp_path, capsys):
    assert "'gazebo' is not a format" in fails(capsys, 2, "export", str(run), "--to", "gazebo")
    assert "no run is given: equipoise export RUN --to urdf" in fails(capsys, 2, "export", "--to", "urdf")
    assert "is a folder without run.json; name the run folder of a calibration" in fails(
        capsys, 5, "export", str(tmp_path), "--to", "urdf"
    )
    with RunFolder.create(tmp_path / "begun", a1, BayesianMethod(), {}):
        pass
    assert "has no result; resume it: equipoise calibrate --resume" in fails(
        capsys, 5, "export", str(tmp_path / "begun"), "--to", "urdf"
    )
    lone = tmp_path / "calibration.json"
    dataclasses.replace(found(a1), robot_model=None).save(lone)
    assert "name the run folder, or give --file" in fails(capsys, 2, "export", str(lone), "--to", "urdf")
    (tmp_path / "export").write_text("a file", encoding="utf-8")
    assert "cannot write" in fails(capsys, 6, "export", str(lone), "--to", "yaml")


@pytest.mark.parametrize("what", [["--to", "urdf"], ["--all"]])
def test_a_mistyped_path_creates_no_folder(what, run, tmp_path, capsys):
    out = tmp_path / "nosuch" / "a1"
    message = fails(capsys, 6, "export", str(run), *what, "--out", str(out))
    assert f"{str(out)!r}: No such file or directory; check that " in message
    assert not out.parent.exists()


def test_all_formats_go_into_a_folder_and_others_are_listed(run, tmp_path, capsys):
    assert main(["export", str(run), "--all", "--parameters", "all", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert len({row.output for row in FORMATS.values()}) == len(FORMATS)
    assert len([*tmp_path.iterdir()]) == len(FORMATS) - 2
    assert "mjcf: not written: the run's model is URDF" in printed
    assert "usd: not written: format usd edits your own stage" in printed
    assert printed.count("weakly identified: ") == printed.count("joint_offset (FL_thigh_joint)") == 1
    assert (
        main(["export", str(run), "--all", "--parameters", "motors", "--json", "--out", str(tmp_path / "motors")]) == 0
    )
    table = json.loads(capsys.readouterr().out)
    assert table["files"]["toml"]["parts"] == ["motors"]
    assert not {"sdf", "joint-offsets"} & ({*table["files"]} | {*table["left_out"]})


def test_formats_are_grouped_by_the_reason_for_which_they_are_not_written(a1, tmp_path, capsys):
    doubtful = found(a1, verdicts={("composite", "Izz"): "not identified"})
    doubtful.save(tmp_path / "calibration.json")
    assert main(["export", str(tmp_path / "calibration.json"), "--all"]) == 0
    names = "quadruped-pympc, unitree-guide, mit-cheetah, quad-sdk, yaml, json"
    printed = capsys.readouterr().out
    assert f"\n{names}: not written: not identified by this run: composite Izz; " in printed
    assert printed.count("composite Izz") == 1


def test_lists_of_parameters_in_notes_are_merged():
    of_one, of_another = ParameterNote("weak", ["a", "b (x, y)"]), ParameterNote("weak", ["b (x, y)", "e"])
    assert copy.deepcopy(of_one).names == ("a", "b (x, y)")
    notes = [of_one, "assumed: c, d", of_another, "assumed: c, d", ParameterNote("left out", ["f"]), "weak: g"]
    assert merged(notes) == ["weak: a, b (x, y), e", "assumed: c, d", "left out: f", "weak: g"]


def test_all_takes_no_flag_of_one_format_and_fails_where_nothing_can_be_written(run, a1, tmp_path, capsys):
    assert "--all writes every format; leave out" in fails(capsys, 2, "export", str(run), "--all", "--to", "urdf")
    assert "no run is given: equipoise export RUN --all" in fails(capsys, 2, "export", "--all")
    assert "did not estimate legs" in fails(capsys, 8, "export", str(run), "--all", "--parameters", "legs")
    result = found(a1)
    unknown = {name: Body.partial(getattr(result.nominal, name)) for name in ("composite", "base")}
    bare = dataclasses.replace(result, **unknown)
    bare.save(tmp_path / "bare.json")
    assert "this calibration does not estimate" in fails(capsys, 8, "export", str(tmp_path / "bare.json"), "--all")
    assert not (tmp_path / "export").exists()
