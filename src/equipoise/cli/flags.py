"""Flag types that verbs share, and functions that load the runs, logs and platforms that flags name."""

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
from equipoise.cli.arguments import NEEDED_OR_LOG
from equipoise.cli.setting_flags import seconds
from equipoise.drivers.platforms import find_platform, given_settings, open_platform
from equipoise.errors import RecordingError, SettingsError
from equipoise.platform.engines import ENGINES
from equipoise.robot.description import RobotDescription

if TYPE_CHECKING:  # they take half a second to import
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.logs.raw_log import Log
    from equipoise.robot.model import RobotModel

DEFAULT_PLATFORM = "mujoco"
Robot = Annotated[
    Positional[str], arg(metavar="[ROBOT]", help="Name (see 'equipoise robots'), or a URDF or MJCF file.")
]
RobotOrNone = Annotated[
    Positional[str | None],
    arg(
        metavar="[ROBOT]",
        help="Name (see 'equipoise robots'), or a URDF or MJCF file.",
        help_behavior_hint="(default: unitree_a1)",
    ),
]
Run = Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration, or a log of another program.")]
Described = Annotated[RobotDescription, arg(name="robot")]
# Flags whose default is not shown: it depends on the run, or is off.
Duration = Annotated[str | None, arg(metavar="TIME", help_behavior_hint="")]
Topic = Annotated[str | None, arg(metavar="TOPIC", help_behavior_hint="")]
Verbose = Annotated[bool, arg(aliases=["-v"], help_behavior_hint="")]
Flag = Annotated[bool, arg(help_behavior_hint="")]
Count = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
_PLATFORMS = (
    "Simulator or robot. mujoco, dart: simulators. unitree-go2, unitree-b2: robot lying, cable connected, --set "
    "interface=eth0; sport mode is released. ros2: Gazebo or ros2_control with loaded controllers. unitree-a1, unitree-go1 "
    "(beta): robot lying in low-level mode, this computer in its network. MODULE:CLASS: your own class, also from this "
    "folder. 'equipoise platforms' lists all platforms and their settings."
)
PlatformName = Annotated[str, arg(metavar="PLATFORM", help=_PLATFORMS)]
_SET = "Setting of the platform, for example interface=eth0. May be repeated."
SettingsGiven = UseAppendAction[Annotated[tuple[str, ...], arg(metavar="KEY=VALUE", help=_SET, help_behavior_hint="")]]
_SETTINGS = "TOML file with settings of the platform."
SettingsFile = Annotated[Path | None, arg(metavar="PATH", help=_SETTINGS, help_behavior_hint="")]
_WITH = "Additional effects or other sizes, for example springs=3000,cable; see docs/simulation-studies.md. May be repeated."
_WITHOUT = "Effects to disable, for example springs,cable. May be repeated."
_CONTACTS = (
    "Foot contact: default, hard points as modified by the effects; file, the contacts of the model file (MJCF)."
)
PresetName = Annotated[
    Literal["ideal", "realistic", "stress"],
    arg(help="Effects: none (ideal); sensors, motors, legs, floor (realistic); also some not estimated (stress)."),
]
WithEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(metavar="NAME=SIZE,NAME", help=_WITH, help_behavior_hint="")]
]
WithoutEffects = UseAppendAction[
    Annotated[tuple[str, ...], arg(metavar="NAME,NAME", help=_WITHOUT, help_behavior_hint="")]
]
_PAYLOAD = "MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about the payload's CoM."
PayloadGiven = Annotated[str | None, arg(metavar="M,X,Y,Z", help=_PAYLOAD, help_behavior_hint="")]
ContactModelName = Annotated[Literal["default", "file"], arg(help=_CONTACTS)]
File = Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="")]
_REQUIRED = (
    "Exit with 11 unless all conditions are met, for example identified,checks. identified: every estimated quantity is "
    "identified; checks: all checks passed; com_x, com_y, ...: that quantity is identified."
)
Required = Annotated[str | None, arg(metavar="WORDS", help=_REQUIRED, help_behavior_hint="")]
Json = Annotated[bool, arg(help="Print one JSON object and nothing else on stdout.", help_behavior_hint="")]


@dataclass(frozen=True)
class Output:
    """Printed output."""

    json: Json = False
    quiet: Annotated[bool, arg(help="Print no progress and no warnings.", help_behavior_hint="")] = False
    debug: Annotated[bool, arg(help="Print a traceback if an error occurs.", help_behavior_hint="")] = False

    @property
    def silent(self) -> bool:
        """True if only the result is printed."""
        return self.quiet or self.json

    def write(self, table: Any, text: Callable[[], object]) -> None:
        """Print JSON values with --json; else call a function that prints text."""
        if self.json:
            print(json_module.dumps(table, indent=2))
        else:
            text()

    @contextmanager
    def reporting_failed_log(self, verbose: bool = False) -> Generator[None]:
        """Print the contents of a log whose estimate fails, unless JSON is printed.

        Args:
            verbose: true to print every segment of the log.
        """
        from equipoise.terminal.log_summary import print_log_report

        try:
            yield
        except RecordingError as error:
            if error.report is not None and not self.json:
                print_log_report(error.report, verbose)
            raise


@dataclass(frozen=True)
class LogFormat:
    """Format of a log of another program.

    Attributes:
        joint_topic: Topic of the joint states, if a bag has several.
        imu_topic: Topic of the IMU samples, if a bag has several.
        command_topic: Topic of the joint commands, if a bag has several.
        joint_map: TOML file with the log's name or column of each joint, for example FL_hip_joint = "front_left_hip".
        columns: TOML file with the columns of a table, for example gyro.x = "wx"; without it, columns are proposed.
        rate: Sampling rate of a table without time stamps.
        start: Start of the part to use, after the first sample.
        until: End of the part to use, after the first sample.
        tables: Further tables of the same run, for example of the IMU, merged by time.
    """

    joint_topic: Topic = None
    imu_topic: Topic = None
    command_topic: Topic = None
    joint_map: File = None
    columns: File = None
    rate: Annotated[float | None, arg(metavar="HERTZ", help_behavior_hint="")] = None
    start: Annotated[Duration, arg(name="from")] = None
    until: Duration = None
    tables: Annotated[Positional[tuple[Path, ...]], arg(metavar="[TABLE...]", help_behavior_hint="")] = ()

    def read(self, path: Path, model: RobotModel, asking: bool, standing: bool = False) -> Log:
        """Read a log as the flags describe it; raises SettingsError and RecordingError.

        Args:
            path: file, or folder of a bag.
            model: robot of the log.
            asking: true to ask the operator to confirm proposed columns.
            standing: true for a log of a standing robot, which may be one sample.
        """
        from equipoise.logs.tables.column_names import Columns
        from equipoise.logs.topics import Topics
        from equipoise.terminal.column_dialogue import read_with_dialogue

        if (path / HEADER).is_file() and (recorded := read_header(path).get("robot")) != model.name:
            raise SettingsError(
                f"the run {str(path)!r} is of the robot {recorded!r}, but --robot is {model.name!r}; leave out --robot"
            )
        topics = Topics(self.joint_topic, self.imu_topic, self.command_topic)
        span = seconds(self.start, "from"), seconds(self.until, "until")
        columns = None if self.columns is None else Columns.from_toml(self.columns)
        if self.rate is not None:
            columns = (columns or Columns()).with_changes(Columns(rate=self.rate))
        return read_with_dialogue(path, model, topics, self.joint_map, columns, span, asking, self.tables, standing)


@dataclass(frozen=True)
class LogFlags(LogFormat):
    """Log of another program.

    Attributes:
        robot: Robot of the log: a name or a model file, as in 'calibrate'. Not needed for a run folder.
    """

    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None


def open_run(path: Path, source: LogFlags, description: RobotDescription) -> RunFolder:
    """Open a run folder.

    Raises:
        SettingsError: flags for logs are given.
        RecordingError: the path is not a run folder.
    """
    if source != LogFlags() or description != RobotDescription():
        is_run = (path / HEADER).is_file()
        raise SettingsError(
            "tables, topics, --joint-map, --columns, --rate, --from, --until and robot flags are for logs of other programs; "
            + (f"{str(path)!r} is a run, which has its own: leave them out" if is_run else "pass --robot too")
        )
    header = read_header(path, NEEDED_OR_LOG)
    from equipoise.calibration.run_folder import RunFolder

    return RunFolder(path, header)


def is_simulated(platform: str) -> bool:
    """Return true if a platform is a simulator."""
    return platform in ENGINES


def exit_code(required: Sequence[str], verdicts: Mapping[str, bool]) -> int:
    """Return 0, or the exit code for unmet requirements, which are printed on stderr."""
    from equipoise.result.requirements import UNMET

    unmet = [word for word in required if not verdicts[word]]
    for word in unmet:
        print(f"requirement not met: {word}", file=sys.stderr)
    return UNMET if unmet else 0


@contextmanager
def connected(platform: str, model: Any, pairs: tuple[str, ...], settings: Path | None) -> Generator[Any]:
    """Connect to a robot, or simulate one with realistic sensors, and yield its platform."""
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
