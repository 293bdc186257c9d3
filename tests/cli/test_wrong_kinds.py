"""Error messages for files of the wrong kind."""

import os

import pytest
from commands import fails
from robots import quadruped_mjcf

RUN = "name the run folder of a calibration"
RUN_OR_LOG = f"{RUN}, or pass --robot ROBOT for a log of another program"
RESULT = f"{RUN}, or its calibration.json"
VERBS = [
    (["export", "FILE", "--to", "urdf"], RESULT),
    (["export", "FILE", "--all"], RESULT),
    (["report", "FILE"], RESULT),
    (["lab", "balance", "--com", "FILE"], RESULT),
    (["view", "FILE"], RUN_OR_LOG),
    (["estimate", "FILE"], RUN_OR_LOG),
    (["estimate", "--json", "FILE"], RUN_OR_LOG),
    (["diagnose", "FILE"], RUN_OR_LOG),
    (["lab", "validate", "FILE"], RUN_OR_LOG),
    (["compare", "FILE", "FILE"], RUN),
    (["payload", "unitree_a1", "--prior-run", "FILE"], RUN),
    (["calibrate", "--prior-run", "FILE"], RUN),
    (["calibrate", "--resume", "FILE"], RUN),
]


@pytest.fixture
def folder(a1, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a1.urdf").write_bytes(a1.source.path.read_bytes())
    (tmp_path / "robot.xml").write_text(quadruped_mjcf(), encoding="utf-8")
    (tmp_path / "settings.toml").write_text("kp = 100", encoding="utf-8")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    os.mkfifo(tmp_path / "pipe")


@pytest.mark.parametrize(("verb", "needed"), VERBS, ids=lambda value: value[0] if isinstance(value, list) else "")
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a1.urdf", "is a URDF robot model"),
        ("robot.xml", "is an MJCF robot model"),
        ("settings.toml", "is a .toml file"),
        ("picture.png", "is a binary file"),
        ("pipe", "is a pipe"),
        ("/dev/null", "is a device"),
        ("nowhere", "does not exist"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_errors_name_the_kind_of_file_and_the_needed_kind(verb, needed, name, kind, capsys):
    message = fails(capsys, 5, *(name if word == "FILE" else word for word in verb))
    assert message in (
        f"error: {name!r} {kind}; {needed}",
        f"error: {name!r} {kind}; {RUN}",
        f"error: --prior-run {name}: it {kind}; {RUN}",
    )
    assert needed != RUN_OR_LOG or message.endswith(RUN_OR_LOG)
    if needed == RESULT and name.endswith((".urdf", ".xml")):
        assert message.endswith(RESULT)


@pytest.mark.usefixtures("folder")
def test_a_result_is_not_a_run(tmp_path, capsys):
    (tmp_path / "result.json").write_text('{"schema": "equipoise.calibration/1"}', encoding="utf-8")
    message = fails(capsys, 5, "estimate", "result.json")
    assert message == f"error: 'result.json' is the result of a calibration; {RUN_OR_LOG}"


@pytest.mark.usefixtures("folder")
def test_a_log_of_another_program_is_recognized(tmp_path, capsys):
    (tmp_path / "log.csv").write_text("time", encoding="utf-8")
    for verb in (["estimate"], ["view"], ["lab", "validate"]):
        message = fails(capsys, 5, *verb, "log.csv")
        assert message == f"error: 'log.csv' is a .csv file; {RUN_OR_LOG}"


@pytest.mark.usefixtures("folder")
def test_a_run_of_an_earlier_version_is_not_a_foreign_log(tmp_path, capsys):
    run = tmp_path / "old"
    run.mkdir()
    (run / "run.json").write_text('{"schema": "equipoise.run/3"}', encoding="utf-8")
    (run / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n", encoding="utf-8")
    message = fails(capsys, 5, "estimate", "old")
    assert message.endswith("it was made by an earlier version; record or estimate again")
