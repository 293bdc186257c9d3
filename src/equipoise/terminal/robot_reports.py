"""Robot checks, calibration plans and recording progress in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from equipoise.calibration.rehearsal import Rehearsal
from equipoise.conventions import FloatArray
from equipoise.drivers.checkup import CheckupFinding
from equipoise.drivers.motor_boards import HangingPhase
from equipoise.drivers.platforms import DRIVERS
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.terminal.rich_tables import show_table

_MARKS = {True: "ok", False: "check", None: ""}
_HEAVY = 0.8  # of a torque limit


def print_checkup(
    robot: RobotModel,
    platform: str,
    joints: Sequence[tuple[str, str, float, float, float]],
    findings: Sequence[CheckupFinding],
) -> None:
    """Print the checks of a robot, and the gains that a calibration sends."""
    console = Console(emoji=False)
    positions = [
        [leg, joint, f"{position:+.3f}", f"{lower:+.2f}", f"{upper:+.2f}"]
        for leg, joint, position, lower, upper in joints
    ]
    heads = ["leg", "joint", "|position [rad]", "|from", "|to"]
    show_table(f"{robot.name} on {platform}: joint map", heads, positions, console)
    show_table("", ["", "", ""], [[_MARKS[one.fine], one.name, one.value] for one in findings], console)
    for finding in findings:
        if finding.advice:
            console.print(f"{finding.name}: {escape(finding.advice)}")
    console.print(escape(robot.imu.line))
    for line in gain_lines(robot, platform):
        console.print(line)
    failed = any(finding.fine is False for finding in findings)
    console.print("nothing was moved" if failed else "nothing was moved; all checks passed")


def print_hanging(robot: RobotModel, platform: str, phases: Sequence[HangingPhase]) -> None:
    """Print a row for each phase of the measurement on a hanging robot."""
    heads = [
        "phase", "|commanded [Nm s/rad]", "|measured", "|torque [Nm]", "|speed [rad/s]", "|modes", "|samples", "|rejected",
        "|gap [ms]", "|lost", "|deg C",
    ]  # fmt: skip
    rows = [
        [
            phase.name,
            _formatted(phase.commanded_damping, ".2f"),
            _formatted(phase.damping, ".2f"),
            _formatted(phase.largest_torque, ".2f"),
            _formatted(phase.largest_speed, ".2f"),
            ", ".join(map(str, phase.motor_modes)),
            str(phase.samples),
            str(phase.rejected),
            f"{phase.longest_gap * 1000:.0f}",
            _formatted(phase.lost, "d"),
            _formatted(phase.temperature, ".0f"),
        ]
        for phase in phases
    ]
    console = Console(emoji=False, width=max(120, Console().width))
    show_table(f"{robot.name} on {platform}, hanging", heads, rows, console)


def _formatted(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def print_rehearsal(rehearsal: Rehearsal, platform: str) -> None:
    """Print the plan of a calibration: postures, joint ranges and torques."""
    console = Console(emoji=False)
    for line in rehearsal_lines(rehearsal, platform):
        console.print(escape(line))
    robot, limit = rehearsal.robot, rehearsal.robot.effort_limit
    postures: list[list[str]] = []
    for name in dict.fromkeys(posture.what for posture in rehearsal.postures):
        same = [posture for posture in rehearsal.postures if posture.what == name]  # lifts that differ in rotation
        largest = np.max([np.abs(posture.torque) for posture in same], axis=0)
        joint = _hardest(robot, largest)
        limited = np.isfinite(limit[joint])
        share = f"{largest[joint] / limit[joint]:.0%}" if limited else f"{largest[joint]:.1f} Nm, no limit,"
        torque = f"{share} at {robot.joint_names[joint]}" if largest[joint] > 0 else "-"
        postures.append([name, str(sum(posture.times for posture in same)), torque])
    show_table("Postures", ["posture", "|times", "largest static torque, of the limit"], postures, console)
    joints: list[list[str]] = []
    lower, upper = rehearsal.joint_range
    for index, joint_name in enumerate(robot.joint_names):
        allowed = f"{robot.lower_limit[index]:+.2f}, {robot.upper_limit[index]:+.2f}"
        most = f" of {limit[index]:.1f}" if np.isfinite(limit[index]) else ", no limit"
        torque = f"{rehearsal.largest_torque[index]:.1f}{most}"
        joints.append([joint_name, f"{lower[index]:+.2f}", f"{upper[index]:+.2f}", allowed, torque])
    show_table("Joints", ["joint", "|from [rad]", "|to", "|limits [rad]", "|static torque [Nm]"], joints, console)
    around = ", from lying until it lies again" * _begins_lying(rehearsal)
    if rehearsal.course.replans:
        console.print("The run plans again from what it measures, so its postures may differ from these.")
    console.print(
        f"Computed with the model{around}, for its mass of {robot.mass:.1f} kg at rest: a payload and motion add torque. "
        "Nothing was moved."
    )


def rehearsal_lines(rehearsal: Rehearsal, platform: str) -> list[str]:
    """Return the plan in a few lines, as printed before the first motion."""
    robot, torque = rehearsal.robot, rehearsal.largest_torque
    joint = _hardest(robot, torque)
    share = torque[joint] / robot.effort_limit[joint]
    limit = f"{share:.0%} of its limit" if share > 0 else "which has no plausible limit in the model file"
    lying = _begins_lying(rehearsal)
    start, around = ("is checked, stands up", ", with checks, standing up and lying down") if lying else ("stands", "")
    lines = [
        f"{robot.name} on {platform}: method {rehearsal.method.name}, about {rehearsal.duration:.0f} s{around}.",
        f"The robot {start}, {rehearsal.course.doing}, and returns to its initial posture.",
        f"Largest static torque according to the model: {torque[joint]:.1f} Nm at {robot.joint_names[joint]}, {limit}.",
    ]
    lines += gain_lines(robot, platform)
    if share > _HEAVY:
        lines.append("This is close to the limit of the motor.")
    return lines


def _begins_lying(rehearsal: Rehearsal) -> bool:
    return rehearsal.postures[0].what == "lying"


def _hardest(robot: RobotModel, torque: FloatArray) -> int:
    """Return the joint with the largest share of its torque limit; without limits, with the largest torque.

    Args:
        torque: (nj,) absolute torques [Nm].
    """
    share = torque / robot.effort_limit
    return int(np.argmax(share if share.any() else torque))


def gain_lines(robot: RobotModel, platform: str) -> list[str]:
    """Return lines with the joint gains and those of the manufacturer; none for a simulator."""
    driver = DRIVERS.get(platform)
    if driver is None:
        return []
    kp, kd = robot.gains(nominal_stance(robot).hip_height)
    source = ", as in the manufacturer's example" if driver.makers_gains == (kp, kd) else ""
    lines = [
        f"Joint gains: {kp:.0f} Nm/rad and {kd:.1f} Nm s/rad{source}; at the end the robot is lowered, then damped."
    ]
    if driver.makers_gains is not None and driver.makers_gains != (kp, kd):
        example = "{:g} and {:g}; --kp {:g} --kd {:g}".format(*driver.makers_gains, *driver.makers_gains)
        lines.append(f"The manufacturer's example uses {example} sets these.")
    return lines


class RecordingProgress:
    """Progress of a recording, on one line of stderr."""

    def __init__(self, quiet: bool, into: Path, duration: float | None) -> None:
        self._console = Console(stderr=True, emoji=False)
        self._quiet = quiet or not self._console.is_terminal
        if not quiet:
            until = "until Ctrl-C" if duration is None else f"for {duration:g} s"
            self._console.print(escape(f"recording into {into} {until}"), soft_wrap=True)
        self._samples = 0
        self._start: float | None = None

    def __enter__(self) -> RecordingProgress:
        return self

    def __exit__(self, *exception: object) -> None:
        if not self._quiet:
            self._console.print()

    def update(self, piece: Recording) -> None:
        """Add a recorded piece and show the progress."""
        self._samples += len(piece.joints.time)
        if self._quiet or len(piece.joints.time) == 0:
            return
        if self._start is None:
            self._start = float(piece.joints.time[0])
        elapsed = float(piece.joints.time[-1]) - self._start
        self._console.print(f"{elapsed:.1f} s, {self._samples} joint samples; Ctrl-C ends it", end="\r")
