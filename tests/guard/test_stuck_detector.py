"""A joint that follows is never called stuck, whatever the start of the windows; one that does not follow is."""

import numpy as np
import pytest

from equipoise.guard.joint_checks import StuckDetector

PERIOD, DELAY, WINDOW = 2e-3, 75, 500


def complaint(answer, begin):
    """Return the finding for a joint whose target moves by 0.18 rad within 30 ms, from its answer."""
    detector = StuckDetector(1, DELAY, WINDOW)
    sent = np.interp(np.arange(3 * WINDOW), [begin, begin + 15], [0.0, 0.18])
    found = [
        detector.update(np.array([target]), np.array([position]))
        for target, position in zip(sent, answer(sent), strict=True)
    ]
    return [each for each in found if each is not None]


@pytest.mark.parametrize("begin", [WINDOW + by for by in (-200, -75, -40, -20, -10, -1, 0, 10, 60)])
@pytest.mark.parametrize("late", [0, 5, 40])
def test_a_quick_joint_is_not_stuck_because_a_window_begins_after_its_motion(begin, late):
    assert complaint(lambda sent: np.concatenate([np.zeros(late), sent[: len(sent) - late]]), begin) == []


def test_a_joint_that_stays_is_stuck():
    [(joint, sent, moved)] = complaint(np.zeros_like, WINDOW + 100)
    assert (joint, sent, moved) == (0, pytest.approx(0.18), 0.0)
