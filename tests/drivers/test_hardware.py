"""The deadline loop over a link, and the guard over that: in real time, with a simulated robot on the other side."""

import time
from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, MemoryConnection, at_rest, hold, is_damped

from equipoise import nominal_stance, simulate
from equipoise.drivers import hardware
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.errors import CommunicationError, MotionError, StoppedError
from equipoise.guard.guard import Guard
from equipoise.platform.platform import JointCommand

pytestmark = pytest.mark.realtime


@pytest.fixture
def link(a1):
    return MemoryConnection(a1)


@pytest.fixture
def platform(link):
    with HardwarePlatform(link) as platform:
        yield platform


@pytest.fixture(scope="module")
def stand(a1):
    position = nominal_stance(a1).joint_position
    return JointCommand(position, velocity=np.full(12, 0.5), torque=np.ones(12))


def test_a_command_that_slept_on_its_way_is_not_sent(platform, link, stand, monkeypatch):
    platform.step(stand)
    sent = link.sent[-1]
    monkeypatch.setattr(hardware, "_wait_until", lambda moment: time.sleep(0.3))
    with pytest.raises(StoppedError, match=r"^no command was sent for \d{3} ms: this program was stopped$"):
        platform.step(replace(stand, kp=np.ones(12)))
    assert link.sent[-1].kp is sent.kp is None


@pytest.mark.parametrize(
    ("raised", "error", "message"),
    [
        (
            OSError("no route"),
            CommunicationError,
            "platform 'a robot in memory' cannot be reached: {} fails (no route)",
        ),
        (KeyError("motor"), MotionError, "platform 'a robot in memory': {} fails (KeyError: 'motor')"),
        (MotionError("too far"), MotionError, "too far"),
    ],
)
@pytest.mark.parametrize("method", ["receive", "send", "release"])
def test_an_exception_of_a_third_party_connection_becomes_an_equipoise_error(
    platform, link, stand, monkeypatch, method, raised, error, message
):
    def fail(*arguments):
        raise raised

    platform.step(stand)
    monkeypatch.setattr(link, method, fail)
    with pytest.raises(error) as caught:
        platform.close() if method == "release" else platform.step(stand)
    assert str(caught.value) == message.format(method)


def test_closing_releases_once_and_sends_no_more(platform, link, stand):
    platform.step(stand)
    platform.close()
    platform.close()
    assert (link.released, link.closed, len(link.sent)) == (1, 1, 1)
    with pytest.raises(MotionError, match="a robot in memory is closed; open it again to move it"):
        platform.step(stand)


def test_who_only_looked_has_nothing_to_release(platform, link):
    platform.read()
    platform.close()
    assert (link.released, link.closed) == (0, 1)


def test_all_samples_that_arrived_in_a_control_period_are_kept_and_the_newest_is_returned(a1, platform, link, stand):
    late, newest = at_rest(a1, 2), at_rest(a1, 4)
    platform.step(stand)
    link._arrived = [at_rest(a1, 3), newest, late]
    state = platform.read()
    assert state is newest
    assert [sample.time for sample in platform.arrived] == [3 * PERIOD, 4 * PERIOD, 2 * PERIOD]
    link.rejected = 7
    assert platform.rejected == 7


def test_a_computer_that_stalls_ends_the_run_and_the_robot_is_lowered(a1):
    """It stood meanwhile, stiff: nothing that continues the motion is sent, and the ending is."""
    link = MemoryConnection(a1, simulate(a1, "realistic", seed=3).platform)
    guard = Guard(HardwarePlatform(link), a1)
    hold(guard, link, 0.1)
    stall = len(link.sent) + 20
    link.act = lambda count: time.sleep(0.4) if count == stall else None
    with pytest.raises(StoppedError) as caught:
        hold(guard, link, 0.5)
    assert str(caught.value).startswith("no command was sent for ")
    assert "the robot process was stopped" in str(caught.value)
    report = guard.report()
    assert report.ending == ("lowered", "damped", "released")
    assert is_damped(link.sent[-1])
    assert (link.released, link.closed) == (1, 1)
    assert report.overruns >= 1
    assert report.late_999 > 0
    assert len(caught.value.recordings[0].commands.time) >= 10  # of 20; a busy computer may be late before, too
