"""Selection of a bag's topics for joints, IMU and commands: by their types, then by their usual names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from equipoise.errors import RecordingError
from equipoise.logs.finding import LogFinding
from equipoise.logs.message_types import COMMANDS, IMU, JOINT_STATE, LOW_STATE, STATES

Found = Mapping[str, tuple[str, int]]
"""Message type and number of messages by topic."""

_COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference")
_OFTEN = 5  # times as many messages: the same data at a lower rate, as Unitree's lf/ topics


@dataclass(frozen=True)
class Topics:
    """Topics to read; None: found by their types."""

    joints: str | None = None
    imu: str | None = None
    commands: str | None = None


def choose_topics(
    found: Found, wanted: Topics, findings: list[LogFinding]
) -> tuple[str | None, str | None, str | None]:
    """Return the topics of joints, IMU and commands; None where there is none.

    Raises:
        RecordingError: several topics fit, or the topic that the user names does not.
    """
    whole_states = _of_types(found, *STATES)
    joints = _given(found, wanted.joints, "--joint-topic", (JOINT_STATE, *STATES))
    if joints is None:
        states = _of_types(found, JOINT_STATE)
        not_commands = [topic for topic in states if not _names_commands(topic)]
        joints = _one(found, whole_states or not_commands or states, "joint states", "--joint-topic", findings)
    imu = _given(found, wanted.imu, "--imu-topic", (IMU, *STATES))
    if imu is None and joints is not None and found[joints][0] in STATES:
        imu = joints  # one message, one clock
    if imu is None:
        imu = _one(found, _of_types(found, IMU) or whole_states, "IMU samples", "--imu-topic", findings)
    commands = _given(found, wanted.commands, "--command-topic", (JOINT_STATE, *COMMANDS))
    if commands is None:
        types = tuple(COMMANDS) if joints is not None and found[joints][0] in STATES else (JOINT_STATE,)
        likely = [t for t in _of_types(found, *types) if _names_commands(t) and t != joints]
        commands = likely[0] if len(likely) == 1 else None
    return joints, imu, commands


def _of_types(found: Found, *types: str) -> list[str]:
    return [topic for topic, (kind, count) in found.items() if kind in types and count > 0]


def _names_commands(topic: str) -> bool:
    return any(word in topic.lower() for word in _COMMAND_WORDS)


def _given(found: Found, topic: str | None, flag: str, types: Sequence[str]) -> str | None:
    if topic is None:
        return None
    topic = topic if topic in found or topic.startswith("/") else f"/{topic}"
    if topic not in found or found[topic][0] not in types:
        problem = f"is a {found[topic][0]}" if topic in found else "is not in the bag"
        raise RecordingError(
            f"{flag} {topic} {problem}; it must be a {' or '.join(types)}. The bag has {_listed(found)}"
        )
    return topic


def _one(found: Found, candidates: Sequence[str], what: str, flag: str, findings: list[LogFinding]) -> str | None:
    """Return the only candidate, the one with the usual name, or the one with by far the most messages."""
    if len(candidates) <= 1:
        return candidates[0] if candidates else None
    usual = [topic for topic in candidates if topic.lower() in ("/joint_states", "/imu/data", "/imu")]
    by_count = sorted(candidates, key=lambda topic: -found[topic][1])
    if len(usual) == 1:
        choice, why = usual[0], "it has the usual name"
    elif found[by_count[0]][1] >= _OFTEN * found[by_count[1]][1]:
        choice, why = by_count[0], "it has by far the most messages"
    else:
        raise RecordingError(
            f"several topics hold {what}: {', '.join(candidates)}. Choose one with {flag}; the bag has {_listed(found)}"
        )
    others = ", ".join(topic for topic in candidates if topic != choice)
    findings.append(LogFinding("topics", f"{choice} is used for {what}, not {others}: {why}"))
    return choice


def _listed(found: Found) -> str:
    return ", ".join(f"{topic} ({kind}, {count})" for topic, (kind, count) in found.items()) or "no topics"


def nothing_to_read(path: Path, found: Found, joints: str | None, imu: str | None) -> RecordingError:
    """Return the error of a bag without joints or IMU."""
    missing = [what for what, topic in (("joint states", joints), ("IMU samples", imu)) if topic is None]
    return RecordingError(
        f"the bag {str(path)!r} holds no {' and no '.join(missing)}: it needs {JOINT_STATE} and {IMU}, or {LOW_STATE} or "
        f"a similar type. It has {_listed(found)}"
    )
