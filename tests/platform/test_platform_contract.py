"""Every platform, put through the contract."""

import contextlib

import numpy as np
import pytest
from guarded import simulated
from platform_contract import (
    TO_ROUNDING,
    WITHOUT_DELAY,
    PlatformContract,
    SimulationContract,
    SteppedRobot,
    interrupt_after,
    wave,
)
from robots import load_text

from equipoise import simulate
from equipoise.errors import FallError, MotionError, SettingsError
from equipoise.guard import endings, footing
from equipoise.guard.guard import Guard
from equipoise.platform.platform import JointCommand, MotionInterrupted, Trajectory


class TestIdealSimulation(SimulationContract):
    tolerances = WITHOUT_DELAY


class TestRealisticSimulation(SimulationContract):
    noise = "realistic"
    tolerances = TO_ROUNDING


class TestSteppedRobot(PlatformContract):
    tolerances = TO_ROUNDING

    @pytest.fixture(autouse=True)
    def _robot(self, a1):
        self.robot = a1

    def make(self):
        return SteppedRobot(simulate(self.robot, "realistic", seed=3).platform)


class TestGuardedRobot(PlatformContract):
    """Its joints may be fast, for the contract's kicks are such as the guard refuses otherwise."""

    tolerances = TO_ROUNDING

    @pytest.fixture(autouse=True)
    def _robot(self, a1, a1_urdf, tmp_path, monkeypatch):
        monkeypatch.setattr(endings, "LIE_DOWN", 0.1)  # the contract is over by then
        monkeypatch.setattr(endings, "DAMPED_TIME", 0.1)
        monkeypatch.setattr(footing, "_SUNK", 0.1)
        self.robot = a1
        self.fast = load_text(tmp_path, a1_urdf.replace('velocity="21"', 'velocity="100"'))

    @pytest.fixture
    def another(self):
        """A robot that the contract has turned so far that it falls while it is lowered is an error of its guard."""
        made = []
        yield lambda: made.append(self.make()) or made[-1]
        for guard in made:
            with contextlib.suppress(FallError):
                guard.close()

    def make(self):
        guard = Guard(simulated(self.robot)[0], self.fast)
        guard.step(JointCommand(guard.read().joint_position))  # the soft start comes first
        return guard

    def test_an_interrupted_motion_hands_over_the_recording_so_far(self, another, monkeypatch):
        """And the robot was put down: nothing moves it any more."""
        free, interrupted = another(), another()
        motion = wave(free, 20)
        expected = free.play(motion)
        interrupt_after(monkeypatch, interrupted._loop.platform, "step", 7)
        with pytest.raises(MotionInterrupted, match="interrupted") as caught:
            interrupted.play(motion)
        recording = caught.value.recording
        assert len(recording.joints.time) == 7
        assert np.allclose(recording.joints.position, expected.joints.position[:7], atol=1e-10)
        with pytest.raises(MotionError, match="the robot was put down and released"):
            interrupted.play(motion)


@pytest.fixture
def platform(a1):
    with simulate(a1, "ideal") as simulation:
        yield simulation.platform


def test_the_simulated_robot_shows_no_more_than_a_platform_does(platform):
    public = {name for name in dir(platform) if not name.startswith("_")}
    assert public == {"control_period", "joint_names", "accepts", "read", "step", "play", "close"}


def test_a_closed_simulation_raises(platform):
    motion = wave(platform, 5)
    platform.close()
    with pytest.raises(MotionError, match="the simulated robot is closed"):
        platform.play(motion)


@pytest.mark.parametrize("gains", [{"kp": -1.0}, {"kd": -1.0}, {"kp": np.nan}])
def test_gains_that_no_simulated_joint_can_have_are_refused(platform, gains):
    here = platform.read().joint_position
    command = JointCommand(here, **{name: np.full_like(here, value) for name, value in gains.items()})
    with pytest.raises(SettingsError, match="joint gains kp and kd must be numbers of zero or more"):
        platform.step(command)


def test_a_joint_without_gains_still_takes_torques(platform):
    here = platform.read().joint_position
    none, torque = np.zeros_like(here), np.full_like(here, 0.7)
    for _ in range(3):
        state = platform.step(JointCommand(here, torque=torque, kp=none, kd=none))
    assert np.allclose(state.joint_torque, 0.7, atol=1e-4)


def test_gains_of_a_step_do_not_outlast_it(a1):
    stances = []
    for steps in (0, 5):
        with simulate(a1, "ideal") as simulation:
            here = simulation.platform.read().joint_position
            for _ in range(steps):
                simulation.platform.step(JointCommand(here, kp=np.full_like(here, 20.0)))
            simulation.platform.play(Trajectory(np.repeat(here[None], 500, axis=0)))
            stances.append(simulation.platform.read().joint_position)
    assert np.allclose(stances[0], stances[1], atol=1e-3)


def test_feed_forward_torque_folds_into_the_target_with_the_gains_in_force(a1):
    torques = []
    for kp in (None, 40.0):
        with simulate(a1, "ideal") as simulation:
            before = simulation.platform.read()
            forward = np.full(12, 1.0)
            # Where the joints stand, so that position and damping ask for nothing.
            command = JointCommand(before.joint_position, torque=forward, kp=None if kp is None else np.full(12, kp))
            torques.append(simulation.platform.step(command).joint_torque)
    assert np.allclose(torques[0], torques[1], atol=0.35)
    assert np.allclose(np.mean(torques), 1.0, atol=0.25)  # joints that give way are damped already


def test_ctrl_c_during_a_motion_without_a_stop_rule_waits_for_a_second_at_most(platform):
    rolled = []
    original = platform._roll
    platform._roll = lambda control, *turn: rolled.append(len(control)) or original(control, *turn)
    platform.play(wave(platform, 1200))
    assert max(rolled) * platform._model.opt.timestep <= 1.0
    assert len(rolled) > 1


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"position": np.zeros(12)}, r"a trajectory needs \(n, nj\) finite positions, got shape \(12,\)"),
        ({"position": np.zeros((0, 12))}, r"a trajectory needs \(n, nj\) finite positions, got shape \(0, 12\)"),
        ({"position": np.full((2, 12), np.nan)}, r"a trajectory needs \(n, nj\) finite positions"),
        (
            {"position": np.zeros((2, 12)), "velocity": np.zeros((3, 12))},
            "trajectory velocity must be finite and of shape",
        ),
        ({"position": np.zeros((2, 12)), "torque": np.full((2, 12), np.inf)}, "trajectory torque must be finite"),
    ],
)
def test_a_trajectory_refuses_what_no_robot_can_follow(arrays, message):
    with pytest.raises(SettingsError, match=message):
        Trajectory(**arrays)
