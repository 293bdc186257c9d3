"""Versions of Cyclone DDS on one domain: who else is there is seen, and no unproven version meets a robot by accident."""

import subprocess
import sys
import tempfile
import time

import pytest

pytest.importorskip("cyclonedds")

from equipoise.errors import CommunicationError, SettingsError
from equipoise.platforms.cyclone import VERSION
from equipoise.platforms.dds import DdsDomain
from equipoise.platforms.dds_versions import DdsProcess, check_company, check_version

DOMAIN = 91  # of these tests
HERE = "domain 0 on eth0"
STAYS = f"""
import sys
from equipoise.platforms.dds import DdsDomain
domain = DdsDomain({DOMAIN}, "lo")
print("joined", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize(("installed", "accepted"), [("0.10.2", ""), ("0.10.5", ""), ("11.0.1", "11.0.1")])
def test_versions_that_may_join_a_robots_network(installed, accepted):
    check_version(installed, accepted)


@pytest.mark.parametrize(
    ("installed", "accepted"),
    [("11.0.1", ""), ("11.0.1", "11.0.2"), ("0.9.1", ""), ("11.0.1", "yes"), ("0.11.0", ""), ("0.1", "")],
)
def test_unproven_versions_may_not_unless_the_user_names_them(installed, accepted):
    with pytest.raises(SettingsError, match=f"cyclonedds {installed} is not proven .* accept_cyclonedds={installed}"):
        check_version(installed, accepted)


@pytest.mark.parametrize(
    ("installed", "accepted", "others"),
    [
        ("0.10.5", "", ["0.10.2", "0.10.4"]),
        ("11.0.1", "", ["11.1.0"]),
        ("11.0.1", "11.0.1", ["0.10.2"]),
        ("0.10.5", "", []),
    ],
)
def test_versions_that_may_meet(installed, accepted, others):
    check_company(installed, accepted, [DdsProcess("a process on robot", other) for other in others], HERE)


@pytest.mark.parametrize(("installed", "other"), [("11.0.1", "0.10.2"), ("0.10.5", "11.0.1"), ("0.10.5", "0.9.1")])
@pytest.mark.parametrize("accepted", ["", "yes", "0.10.2"])
def test_versions_that_may_not_meet_by_accident(installed, other, accepted):
    others = [DdsProcess("a process on robot", installed), DdsProcess("python (process 7 on robot)", other)]
    with pytest.raises(SettingsError) as told:
        check_company(installed, accepted, others, HERE)
    words = str(told.value)
    assert words.startswith(f"in domain 0 on eth0 python (process 7 on robot) has Cyclone DDS {other}, and this is")
    assert words.endswith(f"say so by name: accept_cyclonedds={installed}")
    assert ("End that process" in words) == installed.startswith("0.10")


def test_who_else_is_on_a_domain_is_seen_with_the_version_and_nothing_is_left_behind(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with subprocess.Popen(
        [sys.executable, "-c", STAYS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "joined\n"
        domain = DdsDomain(DOMAIN, "lo")
        try:
            until, seen = time.monotonic() + 10, []
            while not seen and time.monotonic() < until:
                seen = domain._notes.processes()
            assert not list(tmp_path.iterdir())
        finally:
            domain.close()
            process.communicate()
    [other] = seen
    assert f"(process {process.pid} on " in other.name
    assert other.version.split(".")[:1] == VERSION.split(".")[:1]


def test_a_company_that_cannot_be_seen_is_not_taken_for_none(monkeypatch, tmp_path):
    full = tmp_path / "notes"
    full.symlink_to("/dev/full")
    handle, _ = tempfile.mkstemp(dir=tmp_path)  # stays as empty as on a full disk
    monkeypatch.setattr(tempfile, "mkstemp", lambda **_: (handle, str(full)))
    with pytest.raises(CommunicationError, match=r"is not seen: nothing was written to .*notes\. Is the disk full\?"):
        DdsDomain(DOMAIN + 1, "lo")


def test_without_a_place_for_temporary_files_the_error_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(CommunicationError, match=r"DDS cannot be used without a temporary file: .*gone"):
        DdsDomain(DOMAIN + 1, "lo")
