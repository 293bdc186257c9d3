"""Log summary in the terminal: joints, segments, findings, and parameters that are not identified."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from equipoise.terminal.rich_tables import show_table

if TYPE_CHECKING:
    from equipoise.logs.motions.segments import LogSegment
    from equipoise.logs.offline import LogReport

_COUNTED = {
    "lift": "lift",
    "move": "stance motion",
    "excitation": "excitation",
    "walk": "walking step",
    "crawl": "crawling step",
    "rest": "rest",
}
_CONTACTS = (
    "Legs and IMU alone can mistake which feet are up; the estimate uses the other steps only. If most steps of a "
    "walk are left out, check order, sign and unit of the joint torques or foot forces."
)


def print_log_report(report: LogReport, verbose: bool = False) -> None:
    """Print the source of the log's data, its joints, its segments and the findings.

    Args:
        verbose: true for a row per segment and per joint.
    """
    console = Console()
    for name, value in report.log.about.items():
        console.print(escape(f"{name}: {value}"))
    _print_joints(console, report, verbose)
    for finding in report.findings:
        console.print(f"[yellow]{escape(finding.about)}:[/] {escape(finding.message)}")
    if any(finding.about == "contacts" for finding in report.findings):
        console.print(_CONTACTS)
    rows = list(_rows(report.segments, verbose))
    show_table("Segments of the log", ["|from [s]", "|to [s]", "segment", "use"], rows, console)
    nudges = sum(segment.kind == "nudge" for segment in report.segments)
    if nudges and not verbose:
        console.print(f"Not shown: {nudges} stance motions that are too small to be used.")
    for message in report.limitations:
        console.print(f"[yellow]limitation:[/] {escape(message)}")


def _print_joints(console: Console, report: LogReport, verbose: bool) -> None:
    joint_map = report.log.joint_map
    by_name = all(match.robot_joint == match.log_joint for match in joint_map.matches)
    if by_name and not verbose:
        console.print(f"joints: all {len(joint_map.matches)} matched by name")
    else:
        rows = [[match.robot_joint, match.log_joint, match.how] for match in joint_map.matches]
        show_table("", ["joint", "in the log", "matched by"], rows, console)
    if joint_map.ignored:
        console.print(escape(f"other joints, not used: {', '.join(joint_map.ignored)}"))


def _rows(segments: Sequence[LogSegment], verbose: bool) -> Iterable[tuple[str, str, str, str]]:
    """Yield rows; unless verbose, consecutive segments with the same use or reason share a row."""
    if verbose:
        for segment in segments:
            yield _row([segment], segment.what, segment.reason_unused)
        return
    shown = [
        one for one in segments if one.kind != "nudge" and (one.kind != "rest" or one.reason_unused or one.recording)
    ]
    for reason_unused, group in groupby(shown, key=lambda segment: segment.reason_unused):
        parts = list(group)
        if reason_unused is None:
            yield _row(parts, _counted(parts), None)
        else:
            yield _row(parts, parts[0].what if len(parts) == 1 else f"{len(parts)} x {parts[0].what}", reason_unused)


def _row(segments: Sequence[LogSegment], what: str, reason_unused: str | None) -> tuple[str, str, str, str]:
    verdict = "used" if reason_unused is None else f"not used: {reason_unused}"
    return f"{segments[0].start:.1f}", f"{segments[-1].end:.1f}", what, verdict


def _counted(segments: Sequence[LogSegment]) -> str:
    """Return counts by kind, such as "3 lifts, 1 stance motion, 58 walking steps"."""
    counts = Counter(segment.kind for segment in segments)
    for kind in ("walk", "crawl"):
        counts[kind] = sum(segment.steps for segment in segments if segment.kind == kind)
    words: list[str] = []
    for kind, word in _COUNTED.items():
        if count := counts.get(kind):
            words.append(f"{count} {word}{'s' if count > 1 else ''}")
    return ", ".join(words)
