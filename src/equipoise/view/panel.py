"""The words beside the robot, as Markdown."""

from __future__ import annotations

import numpy as np

from equipoise.method.reading import ComEstimate
from equipoise.recording.phases import Phase
from equipoise.view.frames import Frame

_PHASES = {
    Phase.STAND: "standing up", Phase.MOVE: "moving over the line", Phase.SETTLE: "coming to rest", Phase.REST: "at rest",
    Phase.UNLOAD: "unloading two feet", Phase.LIFT: "lifting two feet", Phase.WATCH: "on two feet: which way does it tip?",
    Phase.LOWER: "putting the feet down", Phase.REPLANT: "replanting the feet", Phase.READY: "taking the posture",
    Phase.BEFORE: "at rest", Phase.RAMP: "beginning to sway", Phase.SWAY: "swaying", Phase.END: "coming to rest",
}  # fmt: skip


def trial_text(frame: Frame, expected: int | None, over: bool) -> str:
    """The trial's progress.

    Args:
        expected: number of trials of the whole run, roughly; None if nobody knows.
        over: whether no trial will follow.
    """
    trial = frame.trial
    if trial is None:
        return f"**{_phase(frame)}**"
    if frame.phase == Phase.STAND:  # the way home is no trial's
        return f"**{trial.number} trials are done**"
    of = "" if expected is None else f" of {expected}" if over else f" of about {max(expected, trial.number)}"
    lines = [f"**Trial {trial.number}{of}: {trial.title}**", "", f"{_phase(frame)}"]
    if frame.tilt is not None:
        way = "forward" if frame.tilt > 0 else "backward"
        lines += ["", f"tilt about the line **{abs(np.degrees(frame.tilt)):.2f}°** {way}"]
    return "\n".join(lines)


def com_text(frame: Frame) -> str:
    """The CoM as it is known at the moment."""
    estimate = frame.estimate
    if estimate is None:
        return "**CoM**: by the model, until a trial says more"
    rows = [f"| {axis} | **{_mm(value)}** | {_half(half)} |" for axis, value, half in _axes(estimate)]
    what = "half bracket" if estimate.brackets else "95 %"
    table = [f"| CoM in base | mm | ± {what} |", "|:--|--:|--:|", *rows, ""]
    trials = f"after {estimate.trials} trial{'s' if estimate.trials > 1 else ''}"
    brackets = [
        f"{diagonal}: {1000 * lower:+.1f} to {1000 * upper:+.1f} mm"
        for diagonal, (lower, upper) in estimate.brackets.items()
    ]
    return "\n".join(
        [*table, trials + ("; brackets of the offset:" if brackets else ""), *(f"\n{b}" for b in brackets)]
    )


def _axes(estimate: ComEstimate) -> list[tuple[str, float, float]]:
    return list(zip("xyz", estimate.com.tolist(), estimate.half.tolist(), strict=True))


def _phase(frame: Frame) -> str:
    return _PHASES.get(frame.phase or "", frame.phase or "before the first trial")


def _mm(value: float) -> str:
    return f"{1000 * value:+.2f}"


def _half(value: float) -> str:
    return "by the model" if np.isnan(value) else f"{1000 * value:.2f}"
