"""What the verbs share: the types of their flags, and loading what the flags name."""

from __future__ import annotations

import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from equipoise.cli.settings import flags_class, read_flags, settings_of
from equipoise.errors import EquipoiseError, SettingsError, UnconfirmedMassError
from equipoise.robot.description import RobotDescription
from equipoise.user_file import typed

Robot = Annotated[Positional[str], arg(metavar="ROBOT", help="Name (see 'equipoise robots'), or a URDF or MJCF file.")]
RobotOrNone = Annotated[
    Positional[str | None],
    arg(
        metavar="ROBOT",
        help="Name (see 'equipoise robots'), or a URDF or MJCF file.",
        help_behavior_hint="(default: unitree_a1)",
    ),
]
# An option whose default is found at run time: its help says how.
Kilograms = Annotated[float | None, arg(metavar="KG", help_behavior_hint="")]
Duration = Annotated[str | None, arg(metavar="TIME", help_behavior_hint="")]
Topic = Annotated[str | None, arg(metavar="TOPIC", help_behavior_hint="")]
Verbose = Annotated[bool, arg(aliases=["-v"], help_behavior_hint="")]
Flag = Annotated[bool, arg(help_behavior_hint="")]
Count = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
_PLATFORMS = (
    "Where: mujoco, dart (simulated); unitree-go2, unitree-b2 (robot lies, cable in, --set interface=eth0; its sport mode is "
    "released); ros2 (Gazebo, ros2_control: load its controllers; settings are domain, interface, topics); unitree-a1, "
    "unitree-go1 (beta: lying, in low-level mode, this computer in its network); MODULE:CLASS, a class of your own, also in "
    "this folder. 'equipoise platforms' lists what packages add too, and all settings."
)
PlatformName = Annotated[str, arg(metavar="PLATFORM", help=_PLATFORMS)]
SettingsGiven = UseAppendAction[Annotated[tuple[str, ...], arg(metavar="KEY=VALUE", help_behavior_hint="")]]
_WITH = (
    "Effects besides, or of another size, as springs=3000,cable; docs/method/world.md lists all. May be given again."
)
_WITHOUT = "Effects that are left out, as springs,cable. May be given again."
_CONTACTS = (
    "How feet touch the floor: own, hard points or as the effects have them; file, as the model file (an MJCF) says."
)
NoiseName = Annotated[
    Literal["ideal", "realistic", "stress"],
    arg(help="Effects of the simulated robot; ideal has none, and no friction; stress has more than is estimated."),
]
WithEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(name="with", metavar="NAME=SIZE,NAME", help=_WITH, help_behavior_hint="")]
]
WithoutEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(metavar="NAME,NAME", help=_WITHOUT, help_behavior_hint="")]
]
ContactsName = Annotated[Literal["own", "file"], arg(help=_CONTACTS)]
File = Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="")]
FOR_LOGS = (
    "topics, --joint-map, --columns, --from, --until and descriptions are for logs that are not ours: give --robot too"
)
"""What is told to who gives such flags without."""
Required = Annotated[str | None, arg(metavar="WORDS", help_behavior_hint="")]
Json = Annotated[bool, arg(help="Print one JSON object and nothing else on stdout.", help_behavior_hint="")]


@dataclass(frozen=True)
class Output:
    """What is printed."""

    json: Json = False
    quiet: Annotated[bool, arg(help="No progress, no warnings.", help_behavior_hint="")] = False
    debug: Annotated[bool, arg(help="Show a traceback if something goes wrong.", help_behavior_hint="")] = False

    @property
    def silent(self) -> bool:
        """Whether nothing but the result is printed."""
        return self.quiet or self.json


_ABOUT_ROBOT = "What the model file leaves out or gets wrong."
if TYPE_CHECKING:

    @dataclass(frozen=True)
    class RobotFlags:
        """Flags of a robot description, and of a file that holds one."""

        description_file: Path | None = None
else:
    RobotFlags = flags_class(
        "RobotFlags", _ABOUT_ROBOT, settings_of(RobotDescription),
        [("description_file", Annotated[File, arg(help="TOML file with a robot description; flags win over it.")], None)],
    )  # fmt: skip
Described = Annotated[RobotFlags, arg(name="robot", help=_ABOUT_ROBOT)]


def load(robot: str, flags: RobotFlags) -> Any:
    """The robot model that the flags name and describe."""
    from equipoise.robot.catalog import load_robot

    return load_robot(robot, described(flags))


def exit_code(required: Sequence[str], verdicts: Mapping[str, bool]) -> int:
    """0, or where something that was required is not so, which is told on stderr, the code that says so."""
    from equipoise.result.requirements import UNMET

    unmet = [word for word in required if not verdicts[word]]
    for word in unmet:
        print(f"required, and not met: {word}", file=sys.stderr)
    return UNMET if unmet else 0


def described(flags: RobotFlags) -> RobotDescription:
    """What a file and the flags say together; flags win."""
    description = read_flags(RobotDescription, flags)
    if flags.description_file is None:
        return description
    return RobotDescription.from_toml(flags.description_file).overridden_by(description)


@contextmanager
def interruption_told(folder: Any) -> Generator[None]:
    """Say where the recordings are, and what goes on with them, if a run, or what shows it, does not come to its end."""
    log = folder.log  # which a folder that is closed no longer has
    try:
        yield
    except UnconfirmedMassError:
        folder.discard()
        raise
    except (KeyboardInterrupt, EquipoiseError):
        if not log.empty:
            print(f"what was measured so far is kept in {folder.path}", file=sys.stderr)
            print(f"go on: equipoise calibrate --resume {typed(folder.path)}", file=sys.stderr)
        raise


@contextmanager
def connected(platform: str, model: Any, pairs: tuple[str, ...], settings: Path | None) -> Generator[Any]:
    """A platform to look at: a robot that is connected to, or one that is simulated with ordinary sensors."""
    from equipoise.drivers.platforms import find_platform, given_settings, open_platform
    from equipoise.platform.engines import ENGINES

    find_platform(platform)
    given = given_settings(pairs, settings)
    if platform not in ENGINES:
        with open_platform(platform, model, given) as connection:
            yield connection
        return
    refuse_settings(platform, given)
    from equipoise.simulation.simulation import simulate

    with simulate(model, "realistic", engine=platform) as simulation:
        yield simulation.platform


def refuse_settings(platform: str, given: Any) -> None:
    """A simulator has none."""
    if given:
        raise SettingsError(f"platform {platform!r} has no settings; --set and --settings are for robots")
