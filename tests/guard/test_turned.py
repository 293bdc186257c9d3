"""A guarded robot that the operator turns while it lies limp."""

import re
from dataclasses import replace

import numpy as np
import pytest
from guarded import SLOW, Seen, assert_put_down, simulated

from equipoise import nominal_stance
from equipoise.bayesian.trials import BayesianTrials
from equipoise.cli import operator_prompt
from equipoise.cli.operator_prompt import Keyboard
from equipoise.errors import FallError, MotionError
from equipoise.experiments import turn as turn_module
from equipoise.experiments.stand import stand_up
from equipoise.guard.guard import Guard
from equipoise.platform.platform import TURNS, MotionInterrupted
from equipoise.recording.trials import TurnTrial
from equipoise.robot.inertial import composite_parameters

WHILE = 500  # control periods that the operator takes


class Carried(Seen):
    """A robot that the operator turns by an angle [rad] while it is limp."""

    def __init__(self, platform, angle):
        super().__init__(platform)
        self._simulated, self._step, self.carried = platform, angle / WHILE, 0
        self._rate = 0.0

    def shown(self):
        state = super().shown()
        up = state.acceleration_in_imu / np.linalg.norm(state.acceleration_in_imu)
        return replace(state, angular_velocity_in_imu=state.angular_velocity_in_imu + self._rate * up)

    def step(self, command):
        turns = command.limp and self.carried < WHILE
        self._rate = self._step / SLOW if turns else 0.0
        if turns:
            self._simulated._turn_by(self._step)
            self.carried += 1
        return super().step(command)


def turned(a1, angle, confirmed=None):
    """The robot, and what the trial recorded."""
    robot = Carried(simulated(a1, preset="ideal")[0], angle)
    stance, kept = nominal_stance(a1), []
    with Guard(robot, a1) as guard:
        assert TURNS not in guard.accepts
        standing, _ = stand_up(guard, a1, stance)
        standing.keep = kept.append
        standing.operator_done = confirmed or (lambda: robot.carried == WHILE)
        BayesianTrials(standing, stance, composite_parameters(a1, stance.joint_position).com).turn()
    return robot, kept[0]


@pytest.mark.parametrize("degrees", [-160.0])
def test_a_robot_that_the_operator_turned_stands_up_again(a1, degrees):
    robot, recording = turned(a1, np.radians(degrees))
    assert isinstance(recording.trial, TurnTrial)
    assert recording.complete
    limp = [command.limp for command in robot.commands]
    first = limp.index(True)
    last = limp.index(False, first)
    assert last - first >= WHILE
    assert np.abs(robot.commands[last].position - robot.joints[last]).max() < 0.05
    assert recording.phase("rest").duration > 0.1
    stands = np.array([command.position for command in robot.commands[last:] if not command.limp])
    assert (np.abs(np.diff(stands, axis=0)) <= a1.velocity_limit * SLOW + 1e-9).all()
    assert robot.closed == 1


@pytest.mark.parametrize("degrees", [0.0, 140.0])
def test_a_robot_that_was_hardly_turned_does_not_stand_up(a1, degrees):
    with pytest.raises(MotionError) as caught:
        turned(a1, np.radians(degrees))
    measured = int(
        re.search(r"^the robot was turned by (\d+) deg according to its gyroscope; it must be 150", str(caught.value))[
            1
        ]
    )
    assert measured == pytest.approx(degrees, abs=1.0)
    assert caught.value.recordings[0].has_phase("turn")


def test_the_operator_does_not_turn_it(a1, monkeypatch):
    monkeypatch.setattr(turn_module, "_PATIENCE", 1.0)
    with pytest.raises(MotionError) as caught:
        turned(a1, 0.0, confirmed=lambda: False)
    assert str(caught.value) == (
        "the rotation of the robot was not confirmed within 1 s; resume the run with an operator present"
    )


def test_ctrl_c_while_it_waits_lets_it_down(a1):
    robots, asked = [], []

    def confirmed():
        asked.append(1)
        if len(asked) == 20:
            raise KeyboardInterrupt

    class Kept(Carried):
        def __init__(self, *given):
            super().__init__(*given)
            robots.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(turned.__globals__, "Carried", Kept)
        with pytest.raises(MotionInterrupted) as caught:
            turned(a1, 0.0, confirmed)
    assert caught.value.recording is not None
    assert_put_down(robots[0], a1)


def test_a_robot_that_was_put_on_its_side_does_not_stand_up(a1):
    class Tipped(Carried):
        def shown(self):
            state = super().shown()
            up = state.acceleration_in_imu
            return replace(state, acceleration_in_imu=up[[0, 2, 1]]) if self.carried == WHILE else state

    asked = []

    def confirmed():
        asked.append(1)
        return len(asked) > 2 * WHILE

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(turned.__globals__, "Carried", Tipped)
        with pytest.raises(FallError, match="the base leans by"):
            turned(a1, np.pi, confirmed)


class Terminal:
    """Typed lines."""

    def __init__(self, *lines):
        self.lines = list(lines)

    def isatty(self):
        return False

    def readline(self):
        return self.lines.pop(0)


def test_enter_is_received_without_waiting(monkeypatch, capsys):
    terminal = Terminal("\n", "")
    ready = [False, False, True, True]
    monkeypatch.setattr(operator_prompt.sys, "stdin", terminal)
    monkeypatch.setattr(operator_prompt.select, "select", lambda *given: ([terminal] if ready.pop(0) else [], [], []))
    confirmed = Keyboard().rotation_confirmed
    assert [confirmed(), confirmed(), confirmed()] == [False, False, True]
    assert capsys.readouterr().err.count("press Enter") == 1
    with pytest.raises(MotionError, match="the standard input is closed"):
        confirmed()
