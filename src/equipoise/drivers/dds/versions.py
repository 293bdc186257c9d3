"""Version check of Cyclone DDS on a domain: 11 crashes processes of 0.10, and one of them may hold a robot up.

A process announces its version before it announces a topic. No built-in topic contains the version: only Cyclone's discovery
log does.
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from uuid import UUID

from equipoise.errors import CommunicationError, SettingsError

_PROVEN = "0.10"  # what Unitree pins and most ROS 2 nodes run
# 110 is the vendor id of Cyclone; others announce no version.
_ANNOUNCED = re.compile(
    r"SPDP ST0 (?P<key>110[0-9a-f]{4}:\S+) .*NEW \(\S+ (?P<host>[^/ ]*)/(?P<version>[^/ ]+)/[^)]*\)"
    r'(?:.*"__ProcessName":"(?P<name>[^"]*)".*"__Pid":"(?P<pid>\d+)")?'
)


@dataclass(frozen=True)
class DdsProcess:
    """Another process on a domain.

    Attributes:
        name: name of the process, with its id and its computer if announced.
        version: version of its Cyclone DDS.
        key: identifier of its participant, as four hexadecimal words with colons.
    """

    name: str
    version: str
    key: str = ""


class DiscoveryNotes:
    """File in memory with Cyclone's discovery log; it grows with the number of processes, not with time.

    Attributes:
        path: path of the file, for Cyclone's configuration.
    """

    def __init__(self) -> None:
        self._file = os.fdopen(
            os.memfd_create("discovery"), "rb"
        )  # no disk: it may be full when a robot must be let down
        self.path = f"/proc/self/fd/{self._file.fileno()}"

    def processes(self) -> list[DdsProcess]:
        """Return the processes with Cyclone DDS so far, in order of their arrival.

        Raises:
            CommunicationError: the log is empty, even of this process.
        """
        self._file.seek(0)
        notes = self._file.read().decode(errors="replace")
        if not notes:
            raise CommunicationError(
                f"the versions of Cyclone DDS on the domain are not known: cyclonedds writes nothing to {self.path}. Use "
                "version 0.10 or 11"
            )
        found = _ANNOUNCED.finditer(notes)
        return [
            DdsProcess(_named(match["name"], match["pid"], match["host"]), match["version"], match["key"])
            for match in found
        ]

    def name_of(self, participant: UUID) -> str:
        """Return the name of a participant's process, or the participant's identifier without a name."""
        key = ":".join(f"{int(participant.hex[at : at + 8], 16):x}" for at in range(0, 32, 8))
        names = [process.name for process in self.processes() if process.key == key]
        return names[-1] if names else f"a process with the DDS identifier {key}"

    def close(self) -> None:
        """Delete the file. May be called twice."""
        self._file.close()


def check_version(installed: str, accepted: str = "") -> None:
    """Check that the installed cyclonedds is proven on networks with robots.

    Raises:
        SettingsError: it is not, and the user has not accepted it by name.
    """
    if _series(installed) == _PROVEN or installed == accepted:
        return
    mismatch = f" (and is not {accepted}, the value of accept_cyclonedds)" if accepted else ""
    raise SettingsError(
        f"cyclonedds {installed} is not proven with robots, which run {_PROVEN}.x{mismatch}: version 11 crashes 0.10 "
        f"processes on the same domain, and one of them may hold a robot up. {_proven()}; or, if nothing on this "
        f"network runs another version, set accept_cyclonedds={installed}"
    )


def check_other_versions(installed: str, accepted: str, others: list[DdsProcess], where: str) -> None:
    """Check that other processes on the domain have compatible versions of Cyclone DDS.

    Args:
        installed: version of cyclonedds here.
        accepted: version that the user has accepted by name, if any.
        others: other processes on the domain.
        where: domain in words, as in "domain 0 on eth0".

    Raises:
        SettingsError: one of them has a version of another series.
    """
    strangers = [other for other in others if _series(other.version) != _series(installed)]
    if not strangers or installed == accepted:
        return
    other = strangers[0]
    remedy = "End that process, or have it use 0.10 too" if _series(installed) == _PROVEN else _proven()
    raise SettingsError(
        f"in {where} {other.name} has Cyclone DDS {other.version}, and this is cyclonedds {installed}: version 11 crashes "
        f"0.10 processes, and one of them may hold a robot up. {remedy}; or, if you know that the two are compatible, set "
        f"accept_cyclonedds={installed}"
    )


def _series(version: str) -> str:
    """Return the series of compatible versions: 0.10 of 0.10.5, 11 of 11.0.1."""
    first, _, rest = version.partition(".")
    return f"{first}.{rest.partition('.')[0]}" if first == "0" else first


def _proven() -> str:
    """Return installation instructions for a proven version with this Python."""
    if sys.version_info < (3, 11):
        return "Use 0.10: pip install 'cyclonedds==0.10.5'"
    return "Use 0.10: Python 3.10 and pip install 'cyclonedds==0.10.5', or build it (docs/hardware/unitree-go2-b2.md)"


def _named(name: str | None, pid: str | None, host: str) -> str:
    return f"{name} (process {pid} on {host})" if name and pid else f"a process on {host}"
