"""Segments of a long recording without events: rests, stance motions, excitations, lift trials, walks, crawls.

Every piece becomes a `LogSegment`: its kind, and the reason if it is not used. A segment that is used as a motion has a
`Recording` with the trial and the phases of a commanded motion; a rest may serve only the motions before and after it.

Encoders and gyroscope determine the paths of the feet (foot_paths.py), encoders and accelerometer the rests (rests.py).
Joint torques and foot force sensors, if there are any, must not contradict the steps (loads.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from equipoise.conventions import Axis, FloatArray
from equipoise.estimator.diagnostics.screening import screen
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.walking import CONTEXT, MARGIN, gyro_bias_of_walks
from equipoise.logs.finding import LogFinding
from equipoise.logs.motions.diagonal_stances import SHORTEST_STANCE, diagonal_stances, why_no_lift
from equipoise.logs.motions.foot_paths import FootPaths
from equipoise.logs.motions.loads import Contacts, FootLoads
from equipoise.logs.motions.oscillation import find_oscillation
from equipoise.logs.motions.rests import LoggedRest, find_rests, why_not_carried
from equipoise.logs.motions.track import Track
from equipoise.logs.motions.walking_feet import SHORTEST_ON_THREE, WalkingFeet, crawls, walks
from equipoise.recording.event import PHASE, Event
from equipoise.recording.gaps import split_at_gaps
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import (
    CrawlTrial,
    ExcitationTrial,
    LiftTrial,
    PostureTrial,
    RecordedTrial,
    StandTrial,
    Step,
    SteppingTrial,
    WalkTrial,
)
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import carried_mass

Kind = Literal["rest", "move", "nudge", "excitation", "lift", "walk", "crawl", "steps", "slip", "motion", "gap"]

# On an A1; lengths and times are multiplied by those of the stance's scale.
_OFF_FLOOR = 6e-3  # [m] above the standing feet: clearly off the floor
_SLID = 6e-3  # [m] of apparent foot displacement after a stance motion: 1 to 4 mm with encoders off by 5 mrad
_SLIDING = 12e-3  # [m] during it
_FALLING = 5.0  # [m/s2]: a robot whose accelerometer reads less has no foot on the floor
_MOVED = 0.1  # [rad] of a joint: smaller moves determine no joint offsets, and add the creep of the feet
_LONGEST_MOVE = 8.0  # [s]: up to this duration the gyroscope's attitude is accurate within a milliradian
_USED_REST = 1.0  # [s] of a rest that are used, at most: the part nearest to the motion
# [s] at a rest's ends that are left out, if it is long enough: 0.2 mm of creep there moves the CoM by 0.2 mm.
_SETTLING, _LEAVING = 0.3, 0.12
_LANDED = 0.2  # [s] after a lift that are kept with it
_NEGLIGIBLE = 0.5  # [s] around a walk that are not reported separately
_SHORTEST_EXCITATION = 1.5  # [s] of motion on four feet whose torques are informative
_OF_STEPS = ("steps", "slip", "motion")
"""Kinds of segments in which the robot may walk."""


@dataclass(frozen=True, eq=False)
class LogSegment:
    """Piece of a recording.

    Attributes:
        start, end: times at which the piece begins and ends [s].
        kind: kind of motion.
        what: description of the motion.
        reason_unused: reason why it is not used, or None if it is.
        recording: recording with the trial and the phases that the estimators expect, if it is used on its own.
    """

    start: float
    end: float
    kind: Kind
    what: str
    reason_unused: str | None = None
    recording: Recording | None = None

    @property
    def used(self) -> bool:
        """Return whether it has no reason to be left out; most rests serve only the motions between them."""
        return self.reason_unused is None

    @property
    def steps(self) -> int:
        """Return the number of times on two feet of a walk, on three of a crawl."""
        trial = None if self.recording is None else self.recording.trial
        return len(trial.steps) if isinstance(trial, SteppingTrial) else 0


def find_segments(
    robot: RobotModel,
    stance: Stance,
    recording: Recording,
    foot_forces: FootLoads | None = None,
    findings: list[LogFinding] | None = None,
) -> list[LogSegment]:
    """Return all segments of a recording, in order of time.

    Args:
        foot_forces: readings of its foot force sensors, if it has any.
        findings: list to which findings on contacts are appended.

    Raises:
        RecordingError: a sensor that is not plausible, as `screen` finds it in the rests.
        MotionError: the IMU is rotated from its pose in the model.
    """
    pieces = split_at_gaps(recording)
    tracks = [Track.of(robot, piece, stance.scale.time) for piece, _ in pieces]
    rests = [find_rests(robot, stance, track) for track in tracks]
    all_rests = [rest for of_piece in rests for rest in of_piece]
    _screen_rests(robot, recording, all_rests)
    bias = _gyro_bias(stance, tracks, all_rests)
    segments: list[LogSegment] = []
    contacts = Contacts(robot, foot_forces)
    for (piece, gap), track, of_piece in zip(pieces, tracks, rests, strict=True):
        if gap is not None and segments:
            start, end, missing = gap
            what = f"no {missing} samples for {end - start:.2f} s"
            segments.append(LogSegment(start, end, "gap", what, "nothing was recorded"))
        reader = _PieceReader(robot, stance, piece, track.without_bias(bias), of_piece, contacts)
        segments += reader.segments()
    if findings is not None:
        findings += contacts.findings()
    return segments


def _gyro_bias(stance: Stance, tracks: Sequence[Track], rests: Sequence[LoggedRest]) -> FloatArray:
    """Return the (3,) bias of the gyroscope in base axes [rad/s], from the rests or, without rests, from gravity."""
    if rests:
        return np.asarray(np.median([rest.angular_velocity_in_base for rest in rests], axis=0), dtype=float)
    long = [track for track in tracks if len(track.time) * track.step > 2 * CONTEXT * stance.scale.time]
    return gyro_bias_of_walks([(one.time, one.angular_velocity_in_base, one.acceleration_in_base) for one in long])


def usable(segments: Sequence[LogSegment]) -> list[Recording]:
    """Return the recordings of all segments that can be used."""
    return [segment.recording for segment in segments if segment.recording is not None]


def _screen_rests(robot: RobotModel, recording: Recording, rests: Sequence[LoggedRest]) -> None:
    """Screen the sensors at the rests, if the robot does not seem to stand in most: a sensor may be wrong."""
    if 2 * sum(rest.standing for rest in rests) > len(rests):
        return
    upright = [rest for rest in rests if not rest.folded]
    screen(robot, [marked(recording, [(Phase.REST, rest.start)], rest.start, rest.end) for rest in upright])


class _PieceReader:
    """Reader of one piece without gaps."""

    def __init__(
        self, robot: RobotModel, stance: Stance, recording: Recording, track: Track, rests: list[LoggedRest],
        contacts: Contacts,
    ) -> None:  # fmt: skip
        self.robot, self.stance, self.recording, self.track, self.rests = robot, stance, recording, track, rests
        self.legs, self.contacts = LegChains(robot), contacts
        self._weighed: set[int] = set()  # rests by index whose torques a motion has: none counts twice

    @cached_property
    def _walking(self) -> WalkingFeet | None:
        return WalkingFeet.of(self.legs, self.stance, self.track)

    @cached_property
    def _steps(self) -> list[Step]:
        """Return the times on two feet and those on three."""
        if self._walking is None:
            return []
        steps = [*self._walking.on_two(), *self._walking.on_three()]
        return self.contacts.confirmed(self.track, steps, SHORTEST_ON_THREE * self.stance.scale.time)

    def segments(self) -> list[LogSegment]:
        """Return rests and the segments between them, in order."""
        segments = self._between_rests()
        for feet in (2, 3):
            segments = [piece for segment in segments for piece in self._stepped(segment, feet)]
        return segments

    def _stepped(self, segment: LogSegment, feet: int) -> list[LogSegment]:
        """Return the walks on two feet, or crawls on three, in a segment that is not used otherwise, and the rest of it."""
        if segment.used or segment.kind not in _OF_STEPS:
            return [segment]
        inside = [one for one in self._steps if segment.start <= one.start and one.end <= segment.end]
        steps = [one for one in inside if len(one.standing) == feet]
        if feet == 2:
            return self._around([self._walk(walk) for walk in walks(steps, self.stance)], segment)
        return self._around([self._crawl(crawl) for crawl in crawls(steps, self.stance)], segment)

    def _around(self, motions: Sequence[LogSegment], segment: LogSegment) -> list[LogSegment]:
        """Return motions in a segment, and the rest of it around them; short parts are merged into the next motion."""
        pieces, start, negligible = list[LogSegment](), segment.start, _NEGLIGIBLE * self.stance.scale.time
        for motion in motions:
            if motion.start > start + negligible:
                pieces.append(replace(segment, start=start, end=motion.start))
                start = motion.start
            pieces.append(replace(motion, start=start))
            start = motion.end
        if not pieces:
            return [segment]
        if segment.end > start + negligible:
            return [*pieces, replace(segment, start=start)]
        return [*pieces[:-1], replace(pieces[-1], end=segment.end)]

    def _walk(self, steps: list[Step]) -> LogSegment:
        assert self._walking is not None  # where the steps are from
        start, end = steps[0].start, steps[-1].end
        heading = float(np.interp(start, self.track.time, self._walking.turned))
        trial = WalkTrial(steps=tuple(steps), heading=heading, found_at=start)
        what = f"walk, {len(steps)} times on two feet"
        return LogSegment(start, end, "walk", what, None, self._of_walk(start, end, trial))

    def _crawl(self, steps: list[Step]) -> LogSegment:
        start, end = steps[0].start, steps[-1].end
        reason_unused = self._why_no_crawl(steps)
        what = f"crawl, {len(steps)} times on three feet" if reason_unused is None else "crawl, its steps on three feet"
        trial = CrawlTrial(steps=tuple(steps), found_at=start)
        recording = None if reason_unused else self._of_walk(start, end, trial)
        return LogSegment(start, end, "crawl", what, reason_unused, recording)

    def _why_no_crawl(self, steps: Sequence[Step]) -> str | None:
        """Return why times on three feet determine nothing, or None."""
        if self.track.joint_torque is None:
            return "no joint torques: times on three feet determine nothing without them"
        parts = [self.track.indices(step.start, step.end) for step in steps]
        position = np.concatenate([self.track.joint_position[part] for part in parts]).mean(axis=0)
        torque = np.concatenate([self.track.joint_torque[part] for part in parts]).mean(axis=0)
        if carried_mass(self.robot, position, torque) < 0:  # where the robot rests this is screened for
            return "the joint torques pull the robot down: check their sign"
        return why_not_carried(self.robot, position, torque)

    def _of_walk(self, start: float, end: float, trial: RecordedTrial) -> Recording:
        margin = MARGIN * self.stance.scale.time
        return marked(self.recording, [(Phase.WALK, start), (Phase.END, end)], start - margin, end + margin, trial)

    def _between_rests(self) -> list[LogSegment]:
        start, end = self.recording.joints.time[0], self.recording.joints.time[-1]
        if not self.rests:
            reason_unused = "no rest in it: the robot never stands still on four feet"
            return [LogSegment(start, end, "motion", "motion", reason_unused)]
        found: list[LogSegment] = []
        if self.rests[0].start > start + self.track.step:
            found.append(LogSegment(start, self.rests[0].start, "motion", "motion", "no rest before it"))
        for index, rest in enumerate(self.rests):
            after = self.rests[index + 1] if index + 1 < len(self.rests) else None
            until = after.start if after is not None else end
            if until > rest.end + self.track.step:
                found += self._motion(index, until, after)
        found += [self._rest(index) for index in range(len(self.rests))]
        return sorted(found, key=lambda segment: segment.start)

    def _rest(self, index: int) -> LogSegment:
        """Return the segment of a rest; its torques are used on their own if no motion uses it."""
        rest = self.rests[index]
        if not rest.standing:
            return LogSegment(rest.start, rest.end, "rest", "still", rest.reason_unused)
        recording = None
        if index not in self._weighed and self.recording.joints.torque is not None:
            start, end = self._before(index)
            recording = marked(self.recording, [(Phase.REST, start)], start, end, trial=StandTrial(found_at=start))
        return LogSegment(rest.start, rest.end, "rest", "rest on four feet", None, recording)

    def _motion(self, index: int, until: float, after: LoggedRest | None) -> list[LogSegment]:
        """Return the segments that follow a rest."""
        rest = self.rests[index]
        if not rest.standing:
            return [LogSegment(rest.end, until, "motion", "motion", "no rest on four feet before it")]
        moving = self.track.part(self.track.indices(rest.end, until))
        if len(moving.time) < 2:
            return []
        paths = FootPaths.after(self.legs, moving, rest)
        lift = self._lift(index, paths, until)
        if lift is not None:
            return [lift]
        if paths.slid().max() > _SLIDING * self.stance.scale.length:
            return self._not_standing(rest, paths, until, after)
        return [self._stance_motion(index, paths, until, after)]

    # --- lifts

    def _lift(self, index: int, paths: FootPaths, until: float) -> LogSegment | None:
        """Return the segment of the first time that two diagonal feet are up; None if they never are."""
        scale, rest = self.stance.scale, self.rests[index]
        stances = diagonal_stances(paths, self.stance)
        if not stances:
            return None
        first = stances[0]
        reason_unused = why_no_lift(paths, stances, rest, self.stance)
        force = self.track.acceleration_in_base[self.track.indices(first.start, first.end)]
        if reason_unused is None and np.linalg.norm(force, axis=1).min(initial=np.inf) < _FALLING:
            reason_unused = "it jumps: no foot is on the floor for a moment"
        if reason_unused is not None:
            return LogSegment(rest.end, until, "steps", f"steps, the first on {first.pair}", reason_unused)
        what = f"lift on {first.pair}, {first.end - first.start:.2f} s on two feet"
        begin, leaves = self._before(index)
        phases = [(Phase.REST, begin), (Phase.UNLOAD, leaves), (Phase.LOWER, first.end)]
        landed = min(first.end + _LANDED * scale.time, until)
        joints = self.recording.joints if index not in self._weighed else replace(self.recording.joints, torque=None)
        whole = replace(self.recording, joints=joints)
        self._weighed.add(index)
        recording = marked(whole, phases, begin, landed, LiftTrial(diagonal=first.pair, found_at=begin))
        return LogSegment(rest.end, until, "lift", what, None, recording)

    # --- four feet on the floor

    def _stance_motion(self, index: int, paths: FootPaths, until: float, after: LoggedRest | None) -> LogSegment:
        """Return the segment of a stance motion or an excitation."""
        rest = self.rests[index]
        excitation = self._excitation(rest.end, until)
        if excitation is not None:
            return excitation
        reason_unused = self._why_no_move(rest, until, after)
        if reason_unused is None:
            return self._move(index, paths, until)
        kind: Kind = "nudge" if after is not None and _moved(rest, after) < _MOVED else "motion"
        motion = LogSegment(rest.end, until, kind, "motion on four feet", reason_unused)
        return self._weighable(rest.end, until, after) or motion

    def _why_no_move(self, rest: LoggedRest, until: float, after: LoggedRest | None) -> str | None:
        if after is None or not after.standing:
            return "no rest on four feet after it"
        if until - rest.end > _LONGEST_MOVE * self.stance.scale.time:
            return f"{until - rest.end:.0f} s from rest to rest: the gyroscope's attitude drifts by then"
        moved = _moved(rest, after)
        if moved < _MOVED:
            return (
                f"it ends within {np.degrees(moved):.0f} deg of where it began: too little to determine joint offsets"
            )
        return None

    def _move(self, index: int, paths: FootPaths, until: float) -> LogSegment:
        start, what = self.rests[index].end, f"stance motion, {np.degrees(paths.turned[-1]):.0f} deg"
        slid = float(paths.slid()[-1])
        if slid > _SLID * self.stance.scale.length:
            return LogSegment(start, until, "slip", what, f"feet slipped by {slid * 1000:.0f} mm")
        (begin, leaves), (arrives, end) = self._before(index), self._after(index + 1)
        phases = [(Phase.BEFORE, begin), (Phase.MOVE, leaves), (Phase.REST, arrives)]
        trial = PostureTrial(posture=None, found_at=begin)
        self._weighed.add(index + 1)
        return LogSegment(start, until, "move", what, None, marked(self.recording, phases, begin, end, trial))

    def _excitation(self, start: float, end: float) -> LogSegment | None:
        """Return the segment of an oscillation on four feet; None if there is none."""
        part = self.track.part(self.track.indices(start, end))
        found = find_oscillation(part.time, part.angular_velocity_in_base, self.stance.scale.time)
        if found is None:
            return None
        begin, stop, frequencies = found
        axes = [f"{axis} {frequency:.1f} Hz" for axis, frequency in frequencies.items()]
        what = ", ".join(["excitation", *axes, f"{stop - begin:.1f} s"])
        if self.recording.joints.torque is None:
            reason_unused = "no joint torques: an excitation determines nothing without them"
            return LogSegment(start, end, "excitation", what, reason_unused)
        recording = self._excitation_recording(start, end, begin, stop, frequencies)
        return LogSegment(start, end, "excitation", what, None, recording)

    def _weighable(self, start: float, end: float, after: LoggedRest | None) -> LogSegment | None:
        """Return the segment of any other motion on four feet that is long enough for its torques to be informative.

        After it the robot must stand: a robot that lies down touches the floor with more than its feet before it is still.
        """
        short = end - start < _SHORTEST_EXCITATION * self.stance.scale.time
        if self.recording.joints.torque is None or short or after is None or not after.standing:
            return None
        recording = self._excitation_recording(start, end, start, end, {})
        return LogSegment(start, end, "excitation", f"motion on four feet, {end - start:.1f} s", None, recording)

    def _excitation_recording(
        self, start: float, end: float, steady_from: float, steady_to: float, frequencies: dict[Axis, float]
    ) -> Recording:
        phases = [(Phase.RAMP, start), (Phase.EXCITATION, steady_from), (Phase.END, steady_to)]
        trial = ExcitationTrial(frequencies=frequencies, found_at=start)
        return marked(self.recording, phases, start, end, trial)

    def _not_standing(
        self, rest: LoggedRest, paths: FootPaths, until: float, after: LoggedRest | None
    ) -> list[LogSegment]:
        """Return the segments of walking or sliding, with an excitation if the feet stay for long enough."""
        stretch = paths.longest_standing(self.stance, _SHORTEST_EXCITATION * self.stance.scale.time)
        excitation = None if stretch is None else self._excitation(*stretch) or self._weighable(*stretch, after)
        if stretch is not None and excitation is not None:
            parts = [(rest.end, stretch[0]), (stretch[1], until)]
            around = [self._moving_feet(paths, a, b) for a, b in parts if b - a > 2 * self.track.step]
            return sorted([excitation, *around], key=lambda segment: segment.start)
        return [self._moving_feet(paths, rest.end, until)]

    def _moving_feet(self, paths: FootPaths, start: float, end: float) -> LogSegment:
        part = paths.between(start, end)
        feet = part.off_the_floor(_OFF_FLOOR * self.stance.scale.length, SHORTEST_STANCE * self.stance.scale.time)
        if feet:
            reason_unused = f"feet leave the floor ({', '.join(feet)}), but no two feet stand alone for long"
            return LogSegment(start, end, "steps", "steps", reason_unused)
        slid = float(part.slid().max(initial=0.0))
        return LogSegment(start, end, "slip", "motion with sliding feet", f"feet slipped by {slid * 1000:.0f} mm")

    # --- a rest is used by the motions on either side of it

    def _before(self, index: int) -> tuple[float, float]:
        """Return start and end of the part of a rest that the motion after it uses [s]."""
        start, end = self._settled(index)
        return max(start, end - _USED_REST * self.stance.scale.time), end

    def _after(self, index: int) -> tuple[float, float]:
        """Return start and end of the part of a rest that the motion before it uses [s]."""
        start, end = self._settled(index)
        return start, min(end, start + _USED_REST * self.stance.scale.time)

    def _settled(self, index: int) -> tuple[float, float]:
        """Return start and end of a rest without the creep of the base at its ends [s]."""
        rest, scale = self.rests[index], self.stance.scale
        length = rest.end - rest.start
        return rest.start + min(_SETTLING * scale.time, length / 3), rest.end - min(_LEAVING * scale.time, length / 4)


def _moved(rest: LoggedRest, after: LoggedRest) -> float:
    """Return the largest change of a joint's position [rad]."""
    return float(np.abs(after.joint_position - rest.joint_position).max())


def marked(
    recording: Recording,
    phases: Sequence[tuple[str, float]],
    start: float,
    end: float,
    trial: RecordedTrial | None = None,
) -> Recording:
    """Return a part of a recording as a trial with phases, given by their names and starts [s]."""
    events = [Event(time, PHASE, {"name": name}) for name, time in sorted(phases, key=lambda phase: phase[1])]
    return replace(recording.between(start, end), events=tuple(events), found_trial=trial)
