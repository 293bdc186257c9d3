"""How long a calibration computes between two signs of life: a robot is held no longer without."""

import gc
import threading
import time

import pytest

from equipoise import calibrate, simulate
from equipoise.alive import alive, last_sign
from equipoise.guard import held_robot
from equipoise.method.table import method_named
from equipoise.platform.wrapper import PlatformWrapper

pytestmark = pytest.mark.usefixtures("coarse_engine")


class Stretches(dict):
    """Signs of life; keeps the longest stretches between two, as computed and as waited for [s]."""

    def __init__(self):
        self.computed = self.waited = 0.0
        self._last = None

    def __setitem__(self, thread, moment):
        now = time.thread_time(), time.monotonic()
        if self._last is not None:
            self.computed = max(self.computed, now[0] - self._last[0])
            self.waited = max(self.waited, now[1] - self._last[1])
        self._last = now

    def pause(self):
        self._last = None


class Moved(PlatformWrapper):
    """A robot whose motions, during which the guard gives the signs, are left out."""

    def __init__(self, inner, stretches):
        super().__init__(inner)
        self._stretches = stretches

    def play(self, trajectory, stop=None):
        alive()
        self._stretches.pause()
        recording = super().play(trajectory, stop)
        alive()
        return recording


@pytest.mark.parametrize("method", ["precise", "paper", "static"])
def test_a_calibration_gives_signs_of_life_often_enough(a1, monkeypatch, method):
    """Computing alone counts: a machine that has other things to do is no reason to fail. Three times slower is in hand.

    Nor are the thousands of tests before this one, whose leavings a collection would go through.
    """
    gc.collect()
    gc.freeze()
    stretches = Stretches()
    monkeypatch.setattr("equipoise.alive._signs", stretches)
    settings = method_named(method)()
    with simulate(a1, "realistic", "1,0.05,0.02,0.08", 3, timestep=1e-3) as simulation:
        calibrate(Moved(simulation.platform, stretches), a1, settings)
    alive()
    gc.unfreeze()
    print(f"{method}: {stretches.computed:.3f} s computed, {stretches.waited:.3f} s waited for, at most")
    assert 0 < stretches.computed < held_robot._PATIENCE / 4


def test_each_thread_has_signs_of_its_own():
    before = time.monotonic()
    alive()
    assert last_sign(threading.get_ident()) >= before
    seen = []
    thread = threading.Thread(target=lambda: seen.append(last_sign(threading.get_ident())))
    thread.start()
    thread.join()
    assert seen[0] < before or seen[0] == -float("inf")
