"""User files: their kinds, and atomic writing that replaces regular files only."""

import importlib.util
import itertools
import os
import socket
import stat
import sys
from pathlib import Path

import pytest

from equipoise import user_file
from equipoise.cli import main
from equipoise.errors import OutputError
from equipoise.exports.formats import FORMATS, Export
from equipoise.user_file import kind_of, write_file


def fifo(path):
    os.mkfifo(path)
    return "a pipe"


def bound_socket(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))
    return "a socket"


def folder(path):
    path.mkdir()
    return "a folder"


def device(path):
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("devices are made by root")
    return "a device"


KINDS = pytest.mark.parametrize("make", [fifo, bound_socket, folder, device])


@KINDS
@pytest.mark.parametrize("linked", [False, True])
def test_other_than_regular_files_stay(tmp_path, monkeypatch, make, linked):
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    path = Path("there")
    kind = make(path)
    before = path.lstat()
    named = path
    if linked:
        named = Path("link")
        named.symlink_to(path)
    with pytest.raises(OutputError) as caught:
        write_file(named, "text")
    assert str(caught.value) == (
        f"cannot write {str(named)!r}: it is {kind}, which is never replaced; name a regular file, or a new one"
    )
    assert (path.lstat().st_mode, path.lstat().st_ino) == (before.st_mode, before.st_ino)
    assert sorted(os.listdir()) == sorted({"there", str(named)})


def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "file", tmp_path / "link"
    target.write_text("before")
    target.chmod(0o640)
    link.symlink_to(Path("there") / "file")
    write_file(link, "after")
    assert (link.is_symlink(), target.read_text(), stat.S_IMODE(target.stat().st_mode)) == (True, "after", 0o640)


def test_a_link_that_leads_nowhere_is_refused(tmp_path):
    link = tmp_path / "link"
    link.symlink_to("nowhere")
    with pytest.raises(
        OutputError, match=r"link': it is a link to 'nowhere', which does not exist; remove it, or name another"
    ):
        write_file(link, "text")
    assert os.listdir(tmp_path) == ["link"]


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_file(path, b"before")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(
        OutputError, match=r"^cannot write the page '.*file': No space left on device; check that the fold"
    ):
        write_file(path, "after", "the page ")
    assert (path.read_bytes(), os.listdir(tmp_path)) == (b"before", ["file"])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "run"
    assert main(["calibrate", "--method", "static", "--quiet", "--no-report", "--out", str(path)]) == 0
    return path


VERBS = [
    ["estimate", "RUN"],
    ["record", "--duration", "1s"],
    ["calibrate", "--method", "static"],
    ["lab", "monte-carlo", "--trials", "1", "--methods", "static"],
]


@pytest.mark.parametrize(
    ("verb", "make"),
    [
        *itertools.product(VERBS, [fifo, bound_socket, folder, device]),
        *((["report", "RUN"], make) for make in (fifo, folder)),  # a page takes seconds
    ],
    ids=lambda value: value[0] if isinstance(value, list) else value.__name__,
)
def test_no_verb_replaces_an_irregular_file(run, tmp_path, monkeypatch, capsys, verb, make):
    monkeypatch.chdir(tmp_path)
    out = Path("there")
    make(out)
    (out / "file").write_text("mine") if out.is_dir() else None
    before = out.lstat()
    code = main([*(str(run) if word == "RUN" else word for word in verb), "--quiet", "--out", str(out)])
    if verb[0] == "report" and out.is_dir():
        assert code == 0  # the page goes into the folder
    else:
        assert code == 6, capsys.readouterr().err
        assert "there" in capsys.readouterr().err
    assert (out.lstat().st_mode, out.lstat().st_ino) == (before.st_mode, before.st_ino)


@KINDS
def test_an_export_does_not_replace_an_irregular_file(tmp_path, monkeypatch, make):
    monkeypatch.chdir(tmp_path)
    out = Path("there")
    make(out)
    with pytest.raises(OutputError, match="'there': it is a"):
        Export(next(iter(FORMATS.values())), b"content", "name", (), ()).save(out)
    assert not stat.S_ISREG(out.lstat().st_mode)


def test_python_3_10_reads_toml_with_tomli(monkeypatch):
    reader = pytest.importorskip("tomllib")  # what tomli became; on Python 3.10 every test here reads with tomli
    monkeypatch.setattr(sys, "version_info", (3, 10))
    monkeypatch.setitem(sys.modules, "tomli", reader)
    spec = importlib.util.spec_from_file_location("user_file_on_3_10", user_file.__file__)
    older = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(older)
    assert older.tomllib is reader
    assert older.toml_table("kp = 5") == {"kp": 5}


@KINDS
def test_other_than_regular_files_are_named_and_not_read(tmp_path, monkeypatch, make):
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    assert kind_of("there") == "does not exist"
    kind = make(Path("there"))
    assert kind_of("there") == f"is {kind}"


@pytest.mark.parametrize(("content", "kind"), [
    (b"", "an empty file"),
    (b'<?xml version="1.0"?>\n<!-- <mujoco> -->\n<robot name="a"/>', "a URDF robot model"),
    (b'\xef\xbb\xbf<robot name="a" xmlns:xacro="x"/>', "a xacro file"),
    (b"<mujoco model='a'></mujoco>", "an MJCF robot model"),
    (b"<!DOCTYPE sdf><sdf/>", "an SDF model"),
    (b"<html></html>", "an XML file"),
    (b"\x89MCAP0\r\n\x00", "an MCAP recording"),
    (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer: run `git lfs pull` in its repository"),
    (b'{\n  "schema": "equipoise.calibration/1"}', "the result of a calibration"),
    (b'{"schema": "equipoise.run/1"}', "a JSON file"),
    (b"[1, 2]", "a JSON file"),
    (b"PK\x03\x04\x00\x00", "a binary file"),
    ("caf\xe9".encode("latin-1"), "a text file"),
])  # fmt: skip
def test_files_are_recognised_by_their_content(tmp_path, content, kind):
    (tmp_path / "named").write_bytes(content)
    assert kind_of(tmp_path / "named") == f"is {kind}"


def test_other_files_are_called_by_their_suffix(tmp_path):
    (tmp_path / "a.toml").write_text("a = 1", encoding="utf-8")
    assert kind_of(tmp_path / "a.toml") == "is a .toml file"
