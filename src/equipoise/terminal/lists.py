"""Lists of robots and platforms in the terminal."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, cast

from rich.console import Console
from rich.markup import escape

from equipoise.drivers.platforms import PlatformRow
from equipoise.robot.catalog import CatalogEntry
from equipoise.terminal.rich_tables import show_table


def print_robots(rows: Collection[CatalogEntry]) -> None:
    """Print the catalogue of robots."""
    heads = ["name", "|mass [kg]", "legs", "|leg [m]", "source", "note"]
    about = [
        [row.name, f"{row.mass:.3f}", row.legs, f"{row.leg_length:.3f}", row.source,
         row.note if row.install is None else "not installed"]
        for row in rows
    ]  # fmt: skip
    console = Console(emoji=False)
    show_table("", heads, about, console)
    console.print(
        "unitree_a1, a1: two model files of the Unitree A1, with other masses and inertias; the paper's is built in."
    )
    for install in dict.fromkeys(row.install for row in rows if row.install is not None):
        console.print(f"To install {', '.join(row.name for row in rows if row.install == install)}: {escape(install)}")
    console.print("Other robots: the path of a URDF or MJCF file, or robot_descriptions:NAME with that package.")


def print_platforms(rows: Sequence[PlatformRow]) -> None:
    """Print the platforms with their start and settings."""
    console = Console(emoji=False)
    console.print("mujoco, dart: simulators; mujoco is the default.\n")
    for row in rows:
        console.print(f"[bold]{escape(row.name)}[/bold]" + (f": {escape(row.what)}" if row.what else ""))
        if row.start:
            console.print(f"  starts: {escape(row.start)}; see {escape(row.page)}")
        if isinstance(row.settings, str):
            console.print(f"  {escape(row.settings)}\n")
            continue
        settings = [[name, kind, _setting(default)] for name, kind, default in row.settings]
        show_table("", ["", "", ""], settings, console)
    console.print("Your own class, also from this folder: --platform MODULE:CLASS.")


def _setting(value: Any) -> str:
    """Return the value of a setting in the form of --set."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ",".join(map(str, cast("tuple[Any, ...]", value)))
    return "" if value is None else str(value)
