"""Versions of Cyclone DDS on one domain: who else is there is seen, and no unproven version meets a robot by accident."""

import subprocess
import sys
import time

import pytest
from emulator_processes import unused_domain

pytest.importorskip("cyclonedds")

from equipoise.drivers.dds.cyclone import VERSION
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.dds.versions import DdsProcess, DiscoveryNotes, check_other_versions, check_version
from equipoise.errors import CommunicationError, SettingsError

DOMAIN = unused_domain()
HERE = "domain 0 on eth0"
STAYS = f"""
import sys
from equipoise.drivers.dds.domain import DdsDomain
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
    check_other_versions(installed, accepted, [DdsProcess("a process on robot", other) for other in others], HERE)


@pytest.mark.parametrize(("installed", "other"), [("11.0.1", "0.10.2"), ("0.10.5", "11.0.1"), ("0.10.5", "0.9.1")])
@pytest.mark.parametrize("accepted", ["", "yes", "0.10.2"])
def test_versions_that_may_not_meet_by_accident(installed, other, accepted):
    others = [DdsProcess("a process on robot", installed), DdsProcess("python (process 7 on robot)", other)]
    with pytest.raises(SettingsError) as caught:
        check_other_versions(installed, accepted, others, HERE)
    words = str(caught.value)
    assert words.startswith(f"in domain 0 on eth0 python (process 7 on robot) has Cyclone DDS {other}, and this is")
    assert words.endswith(f"set accept_cyclonedds={installed}")
    assert ("End that process" in words) == installed.startswith("0.10")


def test_who_else_is_on_a_domain_is_seen_with_the_version():
    with subprocess.Popen(
        [sys.executable, "-c", STAYS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "joined\n"
        domain = DdsDomain(DOMAIN, "lo")
        try:
            until, seen = time.monotonic() + 10, []
            while not seen and time.monotonic() < until:
                seen = domain._notes.processes()
        finally:
            domain.close()
            process.communicate()
    [other] = seen
    assert f"(process {process.pid} on " in other.name
    assert other.version.split(".")[0] == VERSION.split(".")[0]


def test_a_company_that_cannot_be_seen_is_not_taken_for_none():
    notes = DiscoveryNotes()
    with pytest.raises(CommunicationError, match=r"are not known: cyclonedds writes nothing to /proc/self/fd/\d+"):
        notes.processes()
    notes.close()
    notes.close()
