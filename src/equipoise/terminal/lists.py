"""Lists of verbs, robots and platforms in the terminal."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, cast

from rich.console import Console
from rich.markup import escape

from equipoise.drivers.platforms import PlatformRow
from equipoise.robot.catalog import CatalogEntry
from equipoise.terminal.rich_tables import show_table


def print_verbs(verbs: Mapping[str, str]) -> None:
    """Print a line for each verb."""
    console = Console(highlight=False)
    console.print("What your quadruped weighs, where its centre of mass is and how hard it is to turn.\n")
    console.print("  equipoise calibrate                  try it: a simulated Unitree A1")
    console.print("  equipoise calibrate my_robot.urdf    yours, simulated")
    console.print("  equipoise platforms                  yours, on its own feet\n")
    print_group("", verbs)


def print_group(group: str, verbs: Mapping[str, str]) -> None:
    """Print the verbs of a group, a line each."""
    console = Console(highlight=False)
    for verb, words in verbs.items():
        console.print(f"  [bold]{verb:<12}[/bold]  {words}")
    console.print(f"\n'{' '.join(filter(None, ('equipoise', group, 'VERB')))} --help' says more.")


def print_robots(rows: Collection[CatalogEntry]) -> None:
    """The catalogue."""
    heads = ["name", "|mass [kg]", "legs", "|leg [m]", "source", "what"]
    about = [
        [row.name, f"{row.mass:.3f}", row.legs, f"{row.leg_length:.3f}", row.source,
         row.note if row.install is None else "not installed"]
        for row in rows
    ]  # fmt: skip
    console = Console(emoji=False)
    show_table("", heads, about, console)
    for install in dict.fromkeys(row.install for row in rows if row.install is not None):
        console.print(f"To install {', '.join(row.name for row in rows if row.install == install)}: {escape(install)}")
    console.print("Any URDF or MJCF file works too, by its path; so does robot_descriptions:NAME with that package.")


def print_platforms(rows: Sequence[PlatformRow]) -> None:
    """Platforms, how they start, and their settings."""
    console = Console(emoji=False)
    console.print("mujoco, dart: simulators; without --platform a calibration is simulated in MuJoCo.\n")
    for row in rows:
        console.print(f"[bold]{escape(row.name)}[/bold]" + (f": {escape(row.what)}" if row.what else ""))
        if row.start:
            console.print(f"  starts: {escape(row.start)}; see {escape(row.page)}")
        if isinstance(row.settings, str):
            console.print(f"  {escape(row.settings)}\n")
            continue
        settings = [[name, kind, _setting(default)] for name, kind, default in row.settings]
        show_table("", ["", "", ""], settings, console)
    console.print("A class of your own, perhaps in this folder: --platform MODULE:CLASS.")


def _setting(value: Any) -> str:
    """A setting's value as --set takes it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ",".join(map(str, cast("tuple[Any, ...]", value)))
    return "" if value is None else str(value)
