"""Helpers of guard tests: states of a robot at rest, and robots that record their commands."""

import time
from dataclasses import replace

import numpy as np

from equipoise import nominal_stance, simulate
from equipoise.experiments.motion import Target
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.guard.check_context import CheckContext
from equipoise.guard.footing import feet_are_lifted
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import ACCEPTS_EVERYTHING, RobotState, Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.simulation.mujoco import MujocoPlatform

PERIOD = 2e-3  # [s] of samples that are made up
SLOW = 4e-3  # [s] of simulated robots: half of them in the same time


class Clock:
    """Clock that advances in `sleep`."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


def at_rest(robot, index=0, **changes):
    """The state of a robot in its stance after so many control periods; no two samples are quite the same."""
    position = nominal_stance(robot).joint_position + 1e-6 * (index % 7)
    up = np.array(robot.imu_in_base.rotation).T @ [0.0, 0.0, 9.81]
    zeros = np.zeros(len(position))
    state = RobotState(index * PERIOD, position, zeros, zeros, 1e-5 * np.array([index % 5, 0.0, 0.0]), up)
    return replace(state, **changes)


def look(checks, command, state, sent=None, standing=None):
    """Run checks as the guard does, on a command, a state and the last commands; they may raise."""
    context = CheckContext(state, sent or command, command, standing or command, TiltFilter(np.eye(3)))
    context.up.update(state)
    for check in checks:
        check(command, context)


def simulated(robot, start="standing", preset="realistic", seed=3, payload=None):
    """A simulated robot with longer steps, which take half the computing; its truth."""
    simulation = simulate(robot, preset, payload, seed, timestep=SLOW / 4)
    platform = MujocoPlatform(robot, simulation.platform._simulated, nominal_stance(robot), start, SLOW)
    return platform, simulation.truth


class Seen:
    """Simulated robot that records its commands, with an action of the test before each.

    `act(count)` is called before the command of that number reaches the robot, and may raise.
    """

    def __init__(self, platform, act=lambda count: None, accepts=ACCEPTS_EVERYTHING, hidden=()):
        self._platform, self.act, self.accepts, self._hidden = platform, act, accepts, hidden
        self.control_period, self.joint_names = platform.control_period, platform.joint_names
        self.commands, self.joints, self.closed = [], [], 0
        self._state = platform.read()

    def read(self):
        self._state = self._platform.read()
        return self.shown()

    def step(self, command):
        self.act(len(self.commands))
        self.commands.append(command)
        self.joints.append(self._state.joint_position)
        ignored = (
            {"velocity", "torque", "kp", "kd"} - self.accepts - ({"kp", "kd"} if "gains" in self.accepts else set())
        )
        self._state = self._platform.step(replace(command, **dict.fromkeys(ignored)))
        return self.shown()

    def shown(self):
        """Return the state without hidden values."""
        return replace(self._state, **dict.fromkeys(self._hidden))

    def play(self, trajectory, stop=None):
        return play_by_stepping(self, trajectory, stop)

    def close(self):
        self.closed += 1
        self._platform.close()


class MemoryConnection:
    """Connection to a robot that advances by a control period with every command; without a platform, to one at rest.

    `act(count)` is called before the command of that number is sent.
    """

    name, accepts, control_period = "a robot in memory", ACCEPTS_EVERYTHING, PERIOD

    def __init__(self, robot, platform=None, act=lambda count: None):
        self._robot, self._platform, self.act = robot, platform, act
        self.joint_names = robot.joint_names
        self.sent, self.released, self.closed, self.rejected = [], 0, 0, 0
        self._arrived: list = []
        self._state = None if platform is None else platform.read()

    @property
    def commands(self):
        return self.sent

    def receive(self):
        """Return the states after commands; without commands, the state is repeated."""
        arrived, self._arrived = self._arrived or [self._sample()], []
        return arrived

    def send(self, command):
        self.act(len(self.sent))
        self.sent.append(command)
        if self._platform is not None:
            self._state = self._platform.step(command)
        self._arrived.append(self._sample())

    def release(self):
        self.released += 1

    def close(self):
        self.closed += 1

    def _sample(self):
        state = at_rest(self._robot, len(self.sent)) if self._state is None else self._state
        return replace(state, received=time.monotonic())


def is_damped(command):
    """Return whether joints only resist motion."""
    return command.kp is not None and not command.kp.any() and bool((command.kd > 0).all())


def assert_put_down(seen, robot):
    """Check the safe ending on the robot's side: no foot in the air, joints damped, released once."""
    assert is_damped(seen.commands[-1])
    assert not feet_are_lifted(robot, nominal_stance(robot), seen.commands[-1].position)
    assert seen.closed == 1
    assert_sane(seen, robot)


def assert_sane(seen, robot):
    """Nothing that reached the robot was beyond its limits, and nothing jumped."""
    position = np.array([command.position for command in seen.commands])
    least, most = np.min(seen.joints, axis=0), np.max(seen.joints, axis=0)  # a joint may be beyond its limit by itself
    assert np.isfinite(position).all()
    assert (position >= np.minimum(robot.lower_limit, least) - 2e-3).all()
    assert (position <= np.maximum(robot.upper_limit, most) + 2e-3).all()
    assert (np.abs(np.diff(position, axis=0)) <= robot.velocity_limit * seen.control_period + 1e-9).all()
    for command in seen.commands:
        for values in (command.velocity, command.torque, command.kp, command.kd):
            assert values is None or np.isfinite(values).all()
        assert command.torque is None or (np.abs(command.torque) <= 1.15 * robot.effort_limit).all()


def lift(guard, robot, watch=0.3, diagonal="FL_RR"):
    """Lift two feet, and leave them up."""
    stance = nominal_stance(robot)
    target = Target.standing(robot, guard.read().joint_position)
    standing = StandingRobot(guard, robot, target, stance.feet_in_base)
    raised = target.feet_in_base.copy()
    raised[[leg not in DIAGONALS[diagonal] for leg in LEG_NAMES], 2] += 0.024 * stance.scale.length
    up = standing.motion().phase("unload").shift_load(DIAGONALS[diagonal], 0.1)
    standing.play(up.phase("lift").move_feet(raised, 0.15).phase("watch").hold(watch))


def hold(guard, seen, duration):
    """Stay where the joints were sent, or are."""
    here = seen.commands[-1].position if seen.commands else guard.read().joint_position
    return guard.play(Trajectory(np.repeat(here[None], round(duration / guard.control_period), axis=0)))
