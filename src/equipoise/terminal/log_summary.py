"""Logs in the terminal: joints, segments, findings, and parameters that the log does not determine."""

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
    "move": "move over planted feet",
    "excitation": "excitation over planted feet",
    "walk": "step of a walk",
    "crawl": "step of a crawl",
    "rest": "rest",
}


def print_log_report(report: LogReport, verbose: bool = False, stderr: bool = False) -> None:
    """Print the source of the log's data, its joints, its segments and the findings.

    Args:
        verbose: whether every piece has a row of its own, and every joint.
        stderr: whether to print there, where stdout is for something else.
    """
    console = Console(stderr=stderr)
    for what, where in report.log.about.items():
        console.print(escape(f"{what}: {where}"))
    _print_joints(console, report, verbose)
    for finding in report.findings:
        console.print(f"[yellow]{escape(finding.about)}:[/] {escape(finding.message)}")
    rows = list(_rows(report.segments, verbose))
    show_table("What the log holds", ["|from [s]", "|to [s]", "what", ""], rows, console)
    nudges = sum(segment.kind == "nudge" for segment in report.segments)
    if nudges and not verbose:
        console.print(f"Not shown: {nudges} motions over planted feet that are too small to tell anything.")
    for message in report.limitations:
        console.print(f"[yellow]cannot be told:[/] {escape(message)}")


def _print_joints(console: Console, report: LogReport, verbose: bool) -> None:
    joint_map = report.log.joint_map
    by_name = all(match.robot_joint == match.log_joint for match in joint_map.matches)
    if by_name and not verbose:
        console.print(f"joints: all {len(joint_map.matches)} by their own names")
    else:
        rows = [[match.robot_joint, match.log_joint, match.how] for match in joint_map.matches]
        show_table("", ["joint", "in the log", "found by"], rows, console)
    if joint_map.ignored:
        console.print(escape(f"other joints, not used: {', '.join(joint_map.ignored)}"))


def _rows(segments: Sequence[LogSegment], verbose: bool) -> Iterable[tuple[str, str, str, str]]:
    """Cells; pieces that are used, or left out for the same reason, one after the other, share a row unless verbose."""
    if verbose:
        for segment in segments:
            yield _row([segment], segment.what, segment.why_not)
        return
    shown = [one for one in segments if one.kind != "nudge" and (one.kind != "rest" or one.why_not or one.recording)]
    for why_not, group in groupby(shown, key=lambda segment: segment.why_not):
        parts = list(group)
        if why_not is None:
            yield _row(parts, _counted(parts), None)
        else:
            yield _row(parts, parts[0].what if len(parts) == 1 else f"{len(parts)} times {parts[0].what}", why_not)


def _row(segments: Sequence[LogSegment], what: str, why_not: str | None) -> tuple[str, str, str, str]:
    verdict = "used" if why_not is None else f"not used: {why_not}"
    return f"{segments[0].start:.1f}", f"{segments[-1].end:.1f}", what, verdict


def _counted(segments: Sequence[LogSegment]) -> str:
    """As "3 lifts, 1 move over planted feet, 58 steps of a walk"."""
    counts = Counter(segment.kind for segment in segments)
    for kind in ("walk", "crawl"):
        counts[kind] = sum(segment.steps for segment in segments if segment.kind == kind)
    words: list[str] = []
    for kind, word in _COUNTED.items():
        if count := counts.get(kind):
            first, *rest = word.split(" ", 1)
            words.append(" ".join([f"{count} {first}{'s' if count > 1 else ''}", *rest]))
    return ", ".join(words)
