"""What the verbs share: the types of their flags, and loading what the flags name."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from equipoise.calibration.run_header import HEADER, read_header
from equipoise.cli.setting_flags import seconds
from equipoise.drivers.platforms import find_platform, given_settings, open_platform
from equipoise.errors import RecordingError, SettingsError
from equipoise.platform.engines import ENGINES
from equipoise.robot.description import RobotDescription

if TYPE_CHECKING:  # half a second that neither the help of a verb nor a wrong flag needs
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.logs.raw_log import Log
    from equipoise.robot.model import RobotModel

DEFAULT_PLATFORM = "mujoco"
Robot = Annotated[Positional[str], arg(metavar="ROBOT", help="Name (see 'equipoise robots'), or a URDF or MJCF file.")]
RobotOrNone = Annotated[
    Positional[str | None],
    arg(
        metavar="ROBOT",
        help="Name (see 'equipoise robots'), or a URDF or MJCF file.",
        help_behavior_hint="(default: unitree_a1)",
    ),
]
Run = Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration, or a log of another kind.")]
Described = Annotated[RobotDescription, arg(name="robot")]
# An option whose default is found at run time: its help says how.
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
_SET = "A setting of the platform, as interface=eth0; may be given again."
SettingsGiven = UseAppendAction[Annotated[tuple[str, ...], arg(metavar="KEY=VALUE", help=_SET, help_behavior_hint="")]]
_SETTINGS = "TOML file with settings of the platform."
SettingsFile = Annotated[Path | None, arg(metavar="PATH", help=_SETTINGS, help_behavior_hint="")]
_WITH = "Effects besides, or of another size, as springs=3000,cable; docs/simulation-studies.md lists all. May be given again."
_WITHOUT = "Effects that are left out, as springs,cable. May be given again."
_CONTACTS = (
    "How feet touch the floor: own, hard points or as the effects have them; file, as the model file (an MJCF) says."
)
PresetName = Annotated[
    Literal["ideal", "realistic", "stress"],
    arg(help="Effects of the simulated robot; ideal has none, and no friction; stress has more than is estimated."),
]
WithEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(metavar="NAME=SIZE,NAME", help=_WITH, help_behavior_hint="")]
]
WithoutEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(metavar="NAME,NAME", help=_WITHOUT, help_behavior_hint="")]
]
_PAYLOAD = "MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about its own CoM."
PayloadGiven = Annotated[str | None, arg(metavar="M,X,Y,Z", help=_PAYLOAD, help_behavior_hint="")]
ContactModelName = Annotated[Literal["default", "file"], arg(help=_CONTACTS)]
File = Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="")]
_REQUIRED = (
    "End with 11 where the result is less than that, as identified,checks: all that the method estimates is identified; all "
    "checks passed; or com_x, com_y and other quantities are identified."
)
Required = Annotated[str | None, arg(metavar="WORDS", help=_REQUIRED, help_behavior_hint="")]
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

    def write(self, table: Any, text: Callable[[], object]) -> None:
        """Print JSON values with --json, else what a function prints."""
        if self.json:
            print(json_module.dumps(table, indent=2))
        else:
            text()


@dataclass(frozen=True)
class LogFlags:
    """A log that is not ours.

    Attributes:
        robot: Whose log it is: a name or a model file, as in 'calibrate'. A run of ours knows.
        joint_topic: Joint states of a bag that has several.
        imu_topic: IMU samples of a bag that has several.
        command_topic: Joint commands of a bag that has several.
        joint_map: TOML file with lines as FL_hip_joint = "front_left_hip": the log's name, or column, of a joint.
        columns: TOML file with lines as gyro.x = "wx", for a table with other names; without it they are proposed.
        rate: Samples a second of a table that has no time.
        start: Use the log from here on, after its first sample.
        until: Use the log until here.
        tables: Further tables of the same run, as of the IMU, joined by time.
    """

    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None
    joint_topic: Topic = None
    imu_topic: Topic = None
    command_topic: Topic = None
    joint_map: File = None
    columns: File = None
    rate: Annotated[float | None, arg(metavar="HERTZ", help_behavior_hint="")] = None
    start: Annotated[Duration, arg(name="from")] = None
    until: Duration = None
    tables: Annotated[Positional[tuple[Path, ...]], arg(metavar="[TABLE...]", help_behavior_hint="")] = ()

    def read(self, path: Path, model: RobotModel, asking: bool) -> Log:
        """Read a log with what the flags say of it; raises SettingsError and LogError.

        Args:
            path: file, or folder of a bag.
            model: robot whose log it is.
            asking: whether the operator is asked to confirm proposed columns.
        """
        from equipoise.logs.tables.column_names import Columns
        from equipoise.logs.topics import Topics
        from equipoise.terminal.column_dialogue import read_as_told

        if (path / HEADER).is_file() and (recorded := read_header(path).get("robot")) != model.name:
            raise SettingsError(
                f"the run {str(path)!r} is of the robot {recorded!r}, and --robot names {model.name!r}; leave out --robot"
            )
        topics = Topics(self.joint_topic, self.imu_topic, self.command_topic)
        span = seconds(self.start, "from"), seconds(self.until, "until")
        columns = None if self.columns is None else Columns.from_toml(self.columns)
        if self.rate is not None:
            columns = (columns or Columns()).with_changes(Columns(rate=self.rate))
        return read_as_told(path, model, topics, self.joint_map, columns, span, asking, self.tables)


def open_run(path: Path, source: LogFlags, description: RobotDescription) -> RunFolder:
    """Open a run folder.

    Raises:
        SettingsError: flags were given that are for logs.
        RecordingError: it is not a run folder.
    """
    if source != LogFlags() or description != RobotDescription():
        raise SettingsError(
            "tables, topics, --joint-map, --columns, --rate, --from, --until and descriptions are for logs that are not ours: "
            "give --robot too"
        )
    try:
        header = read_header(path)
    except RecordingError as error:
        from equipoise.logs.reader import is_log

        foreign = is_log(path) and "expected" not in error.details  # a file with a schema of equipoise is not foreign
        hint = "; if it is another kind of log, say whose with --robot" if foreign else ""
        raise RecordingError(f"{error}{hint}") from error
    from equipoise.calibration.run_folder import RunFolder

    return RunFolder(path, header)


def is_simulated(platform: str) -> bool:
    """Return whether a platform is a simulator."""
    return platform in ENGINES


def exit_code(required: Sequence[str], verdicts: Mapping[str, bool]) -> int:
    """Return 0, or the exit code for unmet requirements, which are printed on stderr."""
    from equipoise.result.requirements import UNMET

    unmet = [word for word in required if not verdicts[word]]
    for word in unmet:
        print(f"required, and not met: {word}", file=sys.stderr)
    return UNMET if unmet else 0


@contextmanager
def connected(platform: str, model: Any, pairs: tuple[str, ...], settings: Path | None) -> Generator[Any]:
    """A platform to look at: a robot that is connected to, or one that is simulated with ordinary sensors."""
    find_platform(platform)
    given = given_settings(pairs, settings)
    if not is_simulated(platform):
        with open_platform(platform, model, given) as connection:
            yield connection
        return
    if given:
        raise SettingsError(f"platform {platform!r} has no settings; --set and --settings are for robots")
    from equipoise.simulation.simulation import simulate

    with simulate(model, "realistic", engine=platform) as simulation:
        yield simulation.platform
