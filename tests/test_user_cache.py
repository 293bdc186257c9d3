"""User cache: cached files are found, and its failures are not errors."""

import os
import sys
from pathlib import Path

import pytest

from equipoise.user_cache import VARIABLE, keep_cached, read_cached


def test_cached_files_are_found(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "deep" / "folder"))
    assert read_cached("a") is None
    keep_cached("a", b"one")
    keep_cached("a", b"two")
    assert read_cached("a") == b"two"
    assert [path.name for path in (tmp_path / "deep" / "folder").iterdir()] == ["a"]


def test_the_oldest_files_are_removed(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    for number in range(40):
        keep_cached(str(number), b"")
        os.utime(tmp_path / str(number), (number, number))
    keep_cached("last", b"")
    assert len(list(tmp_path.iterdir())) == 32
    assert read_cached("last") == b""
    assert read_cached("0") is None


def test_nothing_is_cached_without_a_folder(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    for folder in ("", str(tmp_path / "file"), "/proc/nowhere"):
        monkeypatch.setenv(VARIABLE, folder)
        keep_cached("a", b"one")
        assert read_cached("a") is None


@pytest.mark.skipif(sys.platform != "linux", reason="the folder of another system")
def test_without_the_variable_it_is_the_systems_folder(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    keep_cached("a", b"one")
    assert (tmp_path / ".cache" / "equipoise" / "a").read_bytes() == b"one"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    keep_cached("a", b"one")
    assert (tmp_path / "caches" / "equipoise" / "a").is_file()
