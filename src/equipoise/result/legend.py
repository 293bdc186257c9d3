"""Notes below a table of parameters: frame, reference point, and meaning of verdicts and marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from equipoise.experiments.response_test import ResponseTest
from equipoise.json_form import from_json
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity
from equipoise.robot.imu import imu_line
from equipoise.robot.stance import stance_at

_VERDICTS = {
    "weak": "weak: posterior std above one tenth of the model file's prior std",
    "not identified": "not identified: posterior std above half of the model file's prior std",
    "doubtful": "doubtful: a check failed",
}
_REASONS = 3  # shown for motions that are not used


def frame_message(result: Calibration) -> str:
    """Return frame, reference point, axes and stance of the numbers, and the coverage of the intervals."""
    words = (
        f"CoM from the origin of base link {result.model['base_link']!r}, x forward, z up; inertia about the CoM, in the "
        f"same axes{_standing(result)}."
    )
    imu = f" {imu_line(result.model['imu'])}"
    if "response_test" in result.provenance:
        imu += f" {from_json(ResponseTest, result.provenance['response_test']).message}."
    return words + imu + " Of 20 intervals one is expected to miss the truth." * result.has_intervals


def _standing(result: Calibration) -> str:
    robot = result.robot_model
    if robot is None:
        return ""
    stance = stance_at(robot, robot.joint_vector(dict(result.joint_position), "the run's stance"))
    return f"; standing with its hips {stance.hip_height:.3f} m high"


def verdict_message(quantities: Iterable[Quantity], meanings: Mapping[str, str] = _VERDICTS) -> str:
    """Return the meaning of the verdicts and marks in a table that need explaining; empty if there are none.

    Args:
        meanings: explanation of each verdict, by verdict.
    """
    listed = list(quantities)
    notes = [words for verdict, words in meanings.items() if any(one.verdict == verdict for one in listed)]
    if any(quantity.missed for quantity in listed):
        notes.append("(!): the truth is outside the interval")
    return "; ".join(notes) + "." if notes else ""


def doubt_message(result: Calibration) -> str:
    """Return the headline of a result with failed checks, with both masses if they disagree; empty if all passed."""
    if result.trustworthy:
        return ""
    masses = result.mass_comparison
    disagreement = f"{masses.message}; " if masses is not None and masses.disagrees else ""
    return f"Doubtful: {disagreement}{checks_message(result)}."


def checks_message(result: Calibration) -> str:
    """Return the number of failed checks, in words."""
    failed = sum(not check.passed for check in result.checks)
    return "all checks passed" if not failed else f"{failed} of {len(result.checks)} checks failed"


def lifts_message(result: Calibration) -> str:
    """Return the number of lifts, and of those that were used if some were not."""
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    used = sum(trial.note is None for trial in lifts)
    return f"{len(lifts)} lifts" if used == len(lifts) else f"{used} of {len(lifts)} lifts used"


def left_out_message(result: Calibration) -> str:
    """Return the motions that were not used, with the most frequent reasons; empty if all were used."""
    reasons = Counter((trial.kind, trial.note) for trial in result.trials if trial.note is not None).most_common()
    words = [f"{count} {kind}{'s' * (count > 1)} ({note})" for (kind, note), count in reasons[:_REASONS]]
    if rest := sum(count for _, count in reasons[_REASONS:]):
        words.append(f"{rest} more, see the report's table of motions")
    return f"Not used: {', '.join(words)}." if words else ""
