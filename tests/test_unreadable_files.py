"""Unreadable files in place of user files: each gives a typed error at once."""

import os
import signal
import stat

import pytest

from equipoise import Calibration, RunFolder, load_robot
from equipoise.cli import main
from equipoise.errors import ModelError, RecordingError
from equipoise.logs.reader import read_log
from equipoise.recording.mcap_reader import MessageReader, was_closed
from equipoise.recording.run_log import resume_log
from equipoise.robot.source import parse_model_source, read_model_source

LFS = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'4' * 64}\nsize 1234567\n"
A1 = ("audit", "unitree_a1")
READS = {
    "robot.urdf": ("audit", "FILE"),
    "robot.xml": ("audit", "FILE"),
    "robot.toml": (*A1, "--robot-config", "FILE"),
    "priors.toml": ("plan", "unitree_a1", "--priors", "FILE"),
    "columns.toml": ("estimate", "walk.csv", "--robot", "unitree_a1", "--columns", "FILE"),
    "joints.toml": ("estimate", "walk.csv", "--robot", "unitree_a1", "--joint-map", "FILE"),
    **{f"log.{kind}": ("estimate", "FILE", "--robot", "unitree_a1")
       for kind in ("csv", "npz", "npy", "mat", "bag", "mcap", "db3", "parquet")},
}  # fmt: skip


def pipe(path):
    os.mkfifo(path)
    return "it is a pipe; save its content as a regular file, and name that file"


def device(path):
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 5))  # of endless zeros
    except PermissionError:
        pytest.skip("devices are made by root")
    return "it is a device; save its content as a regular file, and name that file"


def lfs_pointer(path):
    path.write_text(LFS)
    return "it is a Git LFS pointer: run `git lfs pull` in its repository"


@pytest.fixture(autouse=True)
def nothing_waits():
    """Fail tests that wait: a pipe blocks its reader until a writer opens it."""

    def late(*_):
        raise TimeoutError("a read blocks")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def refusal(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) not in (0, 1)
    return " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("put", [pipe, device, lfs_pointer])
@pytest.mark.parametrize("name", READS)
def test_pipes_devices_and_lfs_pointers_are_named(tmp_path, monkeypatch, capsys, name, put):
    monkeypatch.chdir(tmp_path)
    why = put(tmp_path / name)
    assert why in refusal(capsys, *(name if word == "FILE" else word for word in READS[name]))


@pytest.mark.parametrize("put", [pipe, device, lfs_pointer])
def test_pipes_devices_and_lfs_pointers_within_a_run_folder_are_named(tmp_path, put):
    why = put(tmp_path / "recording_0.mcap")
    for read in (lambda path: MessageReader(path).messages(), was_closed, lambda path: resume_log(path.parent, True)):
        with pytest.raises(RecordingError) as raised:
            read(tmp_path / "recording_0.mcap")
        assert str(raised.value).endswith(why)
    put(tmp_path / "run.json")
    with pytest.raises(RecordingError, match=r"run.json' cannot be read \(it is a "):
        RunFolder.open(tmp_path)


def test_a_result_that_is_an_lfs_pointer_is_named(tmp_path):
    lfs_pointer(tmp_path / "calibration.json")
    with pytest.raises(RecordingError, match=r"' is a Git LFS pointer: run `git lfs pull`"):
        Calibration.load(tmp_path / "calibration.json")


@pytest.mark.parametrize("put", [pipe, lfs_pointer])
def test_a_part_of_a_bag_and_an_included_file_are_named(tmp_path, put):
    pytest.importorskip("rosbags")
    (tmp_path / "bag").mkdir()
    why = put(tmp_path / "bag" / "walk_0.mcap")
    with pytest.raises(RecordingError, match=r"the bag .* cannot be read: it is a") as raised:
        read_log(tmp_path / "bag", load_robot("unitree_a1"))
    assert str(raised.value).endswith(why)
    put(tmp_path / "legs.xml")
    (tmp_path / "robot.xml").write_text('<mujoco><include file="legs.xml"/></mujoco>')
    with pytest.raises(ModelError, match=r"includes 'legs.xml', which cannot be read: it is a"):
        read_model_source(tmp_path / "robot.xml")


@pytest.mark.parametrize("name", [name for name in READS if name.endswith(".toml")])
def test_toml_that_is_nested_too_deep_is_rejected(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("a = " + 100_000 * "[" + 100_000 * "]")
    assert "it is nested too deeply" in refusal(capsys, *(name if word == "FILE" else word for word in READS[name]))


def test_json_that_is_nested_too_deep_is_rejected(tmp_path):
    for name in ("calibration.json", "run.json"):
        (tmp_path / name).write_text(100_000 * "[" + 100_000 * "]")
    with pytest.raises(RecordingError, match=r"is not valid JSON \(it is nested too deeply\)"):
        Calibration.load(tmp_path / "calibration.json")
    with pytest.raises(RecordingError, match=r"is not JSON \(it is nested too deeply\)"):
        RunFolder.open(tmp_path)


def with_links(count, chain=False):
    """Return the A1 with additional links, of a gram each."""
    inertial = (
        '<inertial><mass value="1e-3"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    more = "".join(
        f'<link name="more{index}">{inertial}</link><joint name="to_more{index}" type="fixed"><child link="more{index}"/>'
        f'<parent link="{f"more{index - 1}" if chain and index else "trunk"}"/></joint>'
        for index in range(count)
    )
    text = load_robot("unitree_a1").source.path.read_text(encoding="utf-8")
    return text.replace("</robot>", f"{more}</robot>")


@pytest.mark.parametrize("chain", [False, True])
def test_a_model_of_thousands_of_links_is_read(tmp_path, chain):
    (tmp_path / "robot.urdf").write_text(with_links(2000, chain))
    assert load_robot(tmp_path / "robot.urdf").mass == pytest.approx(load_robot("unitree_a1").mass + 2)


def test_a_model_of_a_hundred_thousand_links_is_refused_at_once(tmp_path):
    with pytest.raises(ModelError, match=r"has 10\d{4} links; up to 5000 are read: give the file of one robot"):
        parse_model_source(with_links(100_000).encode(), tmp_path / "robot.urdf")
    (tmp_path / "many.xml").write_text(f"<mujoco><worldbody>{6000 * '<body/>'}</worldbody></mujoco>")
    whole = b'<mujoco><worldbody><body><freejoint/></body></worldbody><include file="many.xml"/></mujoco>'
    with pytest.raises(ModelError, match=r"has 600\d links; up to 5000 are read"):
        parse_model_source(whole, tmp_path / "robot.xml")


@pytest.mark.parametrize("text", ["<robot name='a'>{}</robot>", "<mujoco><worldbody>{}</worldbody></mujoco>"])
def test_a_model_that_is_nested_too_deep_is_rejected(tmp_path, text):
    nested = 100_000 * "<a>" + 100_000 * "</a>"
    with pytest.raises(ModelError, match="is nested more than 200 deep; it is damaged, or not of a quadruped"):
        parse_model_source(text.format(nested).encode(), tmp_path / "robot.xml")


def test_a_file_that_is_too_large_for_a_model_is_refused(tmp_path):
    with pytest.raises(ModelError, match="has 101 MB; up to 100 MB are read"):
        parse_model_source(101_000_000 * b" ", tmp_path / "robot.urdf")
