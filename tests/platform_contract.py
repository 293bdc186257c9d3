"""Contract of every platform, simulated or real: inherit the class and define how to create one.

    class TestMyRobot(PlatformContract):
        def make(self): return MyPlatform(...)

All platforms that `make` returns begin in the same state; a robot that is never twice the same loosens `tolerances`.
"""

import dataclasses
import itertools
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from equipoise import simulate
from equipoise.errors import SettingsError
from equipoise.platform.platform import JointCommand, MotionInterrupted, TiltLimit, Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import PHASE, Event, Recording
from equipoise.simulation.simulated import PERIODS_BETWEEN_STOP_TESTS

NEVER = TiltLimit(np.pi, (0.0, 0.0, 1.0))


class PlatformContract:
    tolerances: ClassVar = {
        "position": 0.0,
        "velocity": 0.0,
        "torque": 0.0,
        "angular_velocity_in_imu": 0.0,
        "acceleration_in_imu": 0.0,
    }
    """Largest difference between `play` and stepping through the same motion."""
    reads_alike = True
    """Whether two reads at one moment return the same."""
    interrupted_method = "step"
    """Point of Ctrl-C in the tests."""
    periods_between_stop_tests = 1

    def make(self):
        raise NotImplementedError

    @pytest.fixture
    def another(self):
        """Makes platforms, and closes them after the test."""
        made = []

        def make():
            made.append(self.make())
            return made[-1]

        yield make
        for platform in made:
            platform.close()

    @pytest.fixture
    def platform(self, another):
        return another()

    def test_reading_senses_without_moving_time_on(self, platform):
        first, second = platform.read(), platform.read()
        assert first.time == second.time
        if self.reads_alike:
            assert np.array_equal(first.joint_position, second.joint_position)
            assert np.array_equal(first.acceleration_in_imu, second.acceleration_in_imu)

    def test_reading_does_not_change_what_follows(self, another):
        read, unread = another(), another()
        for _ in range(3):
            read.read()
        motion = wave(read, 40)
        assert_alike(read.play(motion), unread.play(motion), {**self.tolerances, "position": 1e-12})

    def test_the_joints_are_named_once_each_and_every_vector_is_in_their_order(self, platform):
        names = platform.joint_names
        state = platform.read()
        assert isinstance(names, tuple)
        assert len(set(names)) == len(names)
        for vector in (state.joint_position, state.joint_velocity, state.joint_torque):
            assert vector is None or vector.shape == (len(names),)
        assert state.angular_velocity_in_imu.shape == state.acceleration_in_imu.shape == (3,)

    def test_commands_reach_the_joints_in_the_order_of_their_names(self, platform):
        target = platform.read().joint_position
        moved = np.zeros((len(target), len(target)))
        for joint in range(len(target)):
            platform.play(Trajectory(np.repeat(target[None], 100, axis=0)))
            before = platform.read().joint_position
            kick = target.copy()
            kick[joint] += 0.1
            platform.play(Trajectory(np.repeat(kick[None], 10, axis=0)))
            moved[joint] = np.abs(platform.read().joint_position - before)
        # On planted feet the other joints of the leg give way a little: each kick has its own joint as a whole.
        assert np.array_equal(linear_sum_assignment(moved, maximize=True)[1], np.arange(len(target)))

    def test_a_step_takes_one_control_period(self, platform):
        before = platform.read()
        after = platform.step(JointCommand(before.joint_position))
        assert after.time == pytest.approx(before.time + platform.control_period, abs=1e-9)
        assert platform.read().time == after.time

    def test_times_advance_by_the_control_period_without_gaps(self, platform):
        motion = wave(platform, 33)
        first = platform.play(motion)
        state = platform.step(motion.command(0))
        second, third = platform.play(motion), platform.play(wave(platform, 7))
        after = platform.read().time
        time = np.concatenate([first.joints.time, [state.time - platform.control_period]])
        time = np.concatenate([time, second.joints.time, third.joints.time, [after]])
        assert np.allclose(np.diff(time), platform.control_period, rtol=0, atol=1e-9)

    def test_a_recording_holds_a_sample_of_everything_for_each_command(self, platform):
        motion = wave(platform, 50)
        recording = platform.play(motion)
        state = platform.read()
        assert isinstance(recording, Recording)
        assert recording.joint_names == platform.joint_names
        assert np.array_equal(recording.commands.position, motion.position)
        for stream in (recording.joints, recording.imu, recording.commands):
            assert len(stream.time) == len(motion.position)
        assert (recording.joints.velocity is None) == (state.joint_velocity is None)
        assert (recording.joints.torque is None) == (state.joint_torque is None)

    def test_sample_k_is_sensed_as_command_k_is_sent(self, another):
        calm, struck = another(), another()
        before = calm.read().joint_position
        motion = Trajectory(np.repeat(before[None], 60, axis=0))
        jump = motion.position.copy()
        jump[30:] += 0.1
        without, struck_recording = calm.play(motion), struck.play(Trajectory(jump))
        moved = np.abs(struck_recording.joints.position - without.joints.position).max(axis=1)
        assert moved[:31].max() <= max(self.tolerances["position"], 1e-12)
        assert moved[31:].max() > 0.01

    def test_the_first_sample_is_what_read_returns(self, platform):
        state = platform.read()
        recording = platform.play(wave(platform, 5))
        assert recording.joints.time[0] == pytest.approx(state.time, abs=1e-9)
        assert np.allclose(
            recording.joints.position[0], state.joint_position, atol=max(self.tolerances["position"], 1e-12)
        )

    @pytest.mark.parametrize("feed_forward", [False, True])
    def test_playing_is_stepping(self, another, feed_forward):
        played, stepped = another(), another()
        motion = wave(played, 150, feed_forward)
        for platform in (played, stepped):
            platform.play(Trajectory(np.repeat(motion.position[:1], 50, axis=0)))  # so that it begins without a jump
        assert_alike(played.play(motion), play_by_stepping(stepped, motion), self.tolerances)
        assert np.allclose(
            played.read().joint_position, stepped.read().joint_position, atol=max(self.tolerances["position"], 1e-12)
        )

    def test_a_stop_rule_ends_a_motion_early(self, another):
        free, stopped = another(), another()
        motion = turning(free, 200)
        period = free.control_period
        turned = np.cumsum(free.play(motion).imu.angular_velocity_in_imu, axis=0) * period
        peak = turned[np.argmax(np.linalg.norm(turned, axis=1))]
        axis = tuple(peak / np.linalg.norm(peak))
        limit = TiltLimit(0.5 * float(np.linalg.norm(peak)), axis)
        reached = int(np.argmax(np.abs(turned @ peak) >= limit.angle * np.linalg.norm(peak)))
        recording = stopped.play(motion, limit)
        assert 0 < reached <= len(recording.joints.time) <= reached + 1 + self.periods_between_stop_tests
        assert stopped.read().time == pytest.approx(recording.joints.time[-1] + period, abs=1e-9)

    def test_a_stop_rule_that_is_not_met_changes_nothing(self, another):
        free, watched = another(), another()
        motion = wave(free, 90)
        assert_alike(free.play(motion), watched.play(motion, NEVER), {**self.tolerances, "position": 1e-12})

    def test_events_get_absolute_times(self, platform):
        period = platform.control_period
        events = (Event(0.0, PHASE, {"name": "begin"}), Event(10 * period, PHASE, {"name": "later"}))
        motion, begin = wave(platform, 20), platform.read().time
        platform.play(motion)
        recording = platform.play(Trajectory(motion.position, events=events))
        start = recording.joints.time[0]
        assert start == pytest.approx(begin + 20 * period)
        assert [event.time - start for event in recording.events] == pytest.approx([0.0, 10 * period], abs=1e-9)
        assert len(recording.phase("begin").joints.time) == len(recording.phase("later").joints.time) == 10

    def test_events_after_a_stop_did_not_happen(self, platform):
        motion = turning(platform, 200)
        events = (Event(0.0, "early"), Event(199 * platform.control_period, "late"))
        motion = Trajectory(motion.position, events=events)
        recording = platform.play(motion, TiltLimit(1e-3, (0.0, 1.0, 0.0)))
        assert [event.name for event in recording.events] == ["early"]

    @pytest.mark.parametrize("kind", ["velocity", "torque"])
    def test_feed_forward_acts(self, another, kind):
        plain, fed = another(), another()
        motion = wave(plain, 100)
        forward = np.full(motion.position.shape, 0.5)
        without = plain.play(motion)
        by_play = fed.play(Trajectory(motion.position, **{kind: forward}))
        assert np.abs(by_play.joints.position - without.joints.position).max() > 1e-3

    def test_feed_forward_and_gains_may_come_with_a_step(self, another):
        platform, plain, soft = another(), another(), another()
        here = platform.read().joint_position
        ones = np.ones_like(here)
        command = JointCommand(here, velocity=0.1 * ones, torque=0.1 * ones, kp=20 * ones, kd=1 * ones)
        for _ in range(70):
            state, own = platform.step(command), plain.step(JointCommand(here))
            without = soft.step(JointCommand(here, kp=command.kp, kd=command.kd))
        assert np.abs(without.joint_position - own.joint_position).max() > 0.01  # soft joints sag
        assert (state.joint_position - without.joint_position).mean() > 1e-3

    @pytest.mark.parametrize("whole", [0, 1, 2])
    def test_an_interrupted_motion_hands_over_the_recording_so_far(self, another, monkeypatch, whole):
        free, interrupted = another(), another()
        motion = wave(free, 90)
        expected = free.play(motion, NEVER)
        with monkeypatch.context() as patched:
            interrupt_after(patched, interrupted, self.interrupted_method, whole)
            with pytest.raises(MotionInterrupted, match="interrupted") as caught:
                interrupted.play(motion, NEVER)
        recording = caught.value.recording
        assert isinstance(caught.value, KeyboardInterrupt)
        if whole == 0:
            assert recording is None
            return
        count = len(recording.joints.time)
        assert count == whole * self.periods_between_stop_tests
        assert np.array_equal(recording.commands.position, motion.position[:count])
        assert np.allclose(
            recording.joints.position, expected.joints.position[:count], atol=max(self.tolerances["position"], 1e-12)
        )
        after = interrupted.play(motion)
        assert after.joints.time[0] == pytest.approx(recording.joints.time[-1] + free.control_period, abs=1e-9)

    def test_commands_for_another_number_of_joints_are_refused(self, platform):
        with pytest.raises(SettingsError, match=f"commands for 3 joints; .* has {len(platform.joint_names)}"):
            platform.play(Trajectory(np.zeros((5, 3))))

    def test_closing_twice_is_closing(self, another):
        platform = another()
        platform.play(wave(platform, 5))
        platform.close()
        platform.close()

    def test_leaving_a_with_block_closes(self, another):
        with another() as platform:
            platform.play(wave(platform, 5))
        platform.close()


# Without any delay, what a command changes at once (torque, acceleration) shows in the sample that it is sent at when
# playing, and in the next one when stepping; this is what one command of a smooth motion changes.
WITHOUT_DELAY = {
    "position": 1e-12,
    "velocity": 0.01,
    "torque": 0.2,
    "angular_velocity_in_imu": 0.01,
    "acceleration_in_imu": 0.8,  # a mean about the moment, of which a reading knows only what the last command does
}
TO_ROUNDING = dict.fromkeys(PlatformContract.tolerances, 1e-10)


class SimulationContract(PlatformContract):
    interrupted_method = "_roll"
    periods_between_stop_tests = PERIODS_BETWEEN_STOP_TESTS
    noise = "ideal"

    @pytest.fixture(autouse=True)
    def _robot(self, a1):
        self.robot = a1

    def make(self):
        return simulate(self.robot, self.noise, seed=3).platform


class SteppedRobot:
    """A robot as hardware is: it has only `step`, and does not report torques."""

    def __init__(self, simulated):
        self._simulated = simulated
        self.control_period = simulated.control_period
        self.joint_names = simulated.joint_names
        self.accepts = simulated.accepts

    def read(self):
        return dataclasses.replace(self._simulated.read(), joint_torque=None)

    def step(self, command):
        return dataclasses.replace(self._simulated.step(command), joint_torque=None)

    def play(self, trajectory, stop=None):
        return play_by_stepping(self, trajectory, stop)

    def close(self):
        self._simulated.close()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()


def wave(platform, count, feed_forward=False):
    """A smooth motion of all joints and back, from where they are."""
    here = platform.read().joint_position
    return _smooth(platform, here, count, 0.05 * np.ones_like(here), feed_forward)


def turning(platform, count):
    """A smooth motion that turns the base, from where the joints are."""
    here = platform.read().joint_position
    half = len(here) // 2
    return _smooth(platform, here, count, np.repeat([0.12, -0.12], [half, len(here) - half]))


def _smooth(platform, here, count, amplitude, feed_forward=False):
    phase = 2 * np.pi * np.arange(count) / count
    position = here + (1 - np.cos(phase))[:, None] / 2 * amplitude
    if not feed_forward:
        return Trajectory(position)
    velocity = np.gradient(position, platform.control_period, axis=0)
    return Trajectory(position, velocity, 0.2 * np.sin(phase)[:, None] * np.ones_like(here))


def assert_alike(a, b, tolerances):
    assert np.allclose(a.joints.time, b.joints.time, rtol=0, atol=1e-9)
    for stream, names in (
        ("joints", ("position", "velocity", "torque")),
        ("imu", ("angular_velocity_in_imu", "acceleration_in_imu")),
    ):
        for name in names:
            one, other = getattr(getattr(a, stream), name), getattr(getattr(b, stream), name)
            assert (one is None) == (other is None)
            if one is not None:
                difference = np.abs(one - other).max()
                assert difference <= max(tolerances[name], 1e-9), f"{name} differs by {difference:.3g}"


def interrupt_after(monkeypatch, platform, method, calls):
    """Let Ctrl-C happen in the call of a method after so many whole ones; of a wrapped platform, inside."""
    while hasattr(platform, "_inner"):
        platform = platform._inner
    original, count = getattr(platform, method), itertools.count()

    def interrupted(*arguments):
        if next(count) == calls:
            raise KeyboardInterrupt
        return original(*arguments)

    monkeypatch.setattr(platform, method, interrupted)
