"""Filter of plausible samples: a message for each fault, and none for sound streams."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest
from hypothesis import given
from hypothesis import strategies as st

from equipoise import nominal_stance
from equipoise.errors import CommunicationError, MotionError
from equipoise.guard.sample_filter import SampleFilter

SILENCE = 0.101  # between two control periods


@pytest.fixture
def sieve(a1):
    return SampleFilter(a1, PERIOD, SILENCE)


@pytest.fixture(scope="module")
def home(a1):
    return nominal_stance(a1).joint_position


def alive(robot, index, **changes):
    """A sample of a robot that moves: every joint and the IMU read something new."""
    position = nominal_stance(robot).joint_position + 1e-3 * np.sin(0.1 * index)
    rate = 1e-3 * np.array([np.sin(0.1 * index), 0.0, 0.0])
    return replace(at_rest(robot, index, joint_position=position, angular_velocity_in_imu=rate), **changes)


def run(sieve, samples, target):
    """The error that samples raise, and the number of the one that raised it. A list holds those that arrive together."""
    for count, sample in enumerate(samples):
        try:
            sieve.accept(sample if isinstance(sample, list) else [sample], target(count))
        except MotionError as error:
            return error, count
    return None, count + 1


def holding(home):
    return lambda count: home


def moving(home):
    """Targets that swing by 0.1 rad."""
    return lambda count: home + 0.05 * np.sin(2 * np.pi * count * PERIOD)


def test_a_sound_stream_passes(a1, sieve, home):
    samples = [alive(a1, index) for index in range(2000)]
    assert run(sieve, samples, moving(home)) == (None, 2000)
    assert sieve.counts.fresh == 2000
    assert sieve.counts.repeated == sieve.counts.out_of_order == sieve.counts.missing == 0
    assert sieve.counts.longest_silence == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_position": (3, np.nan)}, "the encoder reading of joint 'FR_hip_joint' is not finite at t = 0.010 s"),
        (
            {"joint_velocity": (4, np.inf)},
            "the velocity reading of joint 'FR_thigh_joint' is not finite at t = 0.010 s",
        ),
        ({"joint_torque": (5, np.nan)}, "the torque reading of joint 'FR_calf_joint' is not finite at t = 0.010 s"),
        ({"angular_velocity_in_imu": (1, np.nan)}, "the gyroscope reading is not finite at t = 0.010 s"),
        ({"acceleration_in_imu": (2, -np.inf)}, "the accelerometer reading is not finite at t = 0.010 s"),
    ],
)
@pytest.mark.parametrize("late", [False, True])
def test_what_is_no_number_is_noticed_at_once(a1, sieve, home, change, message, late):
    """Also in a sample that arrived together with a sound one."""
    bad = alive(a1, 5)
    for name, (index, value) in change.items():
        values = np.array(getattr(bad, name))
        values[index] = value
        bad = replace(bad, **{name: values})
    if late:
        bad = [bad, alive(a1, 6)]
    error, count = run(sieve, [*(alive(a1, index) for index in range(5)), bad], holding(home))
    assert type(error) is MotionError
    assert str(error) == message
    assert count == 5


def test_an_encoder_that_jumps_is_noticed_at_once(a1, sieve, home):
    jumped = alive(a1, 5)
    jumped.joint_position[7] += 0.3
    error, count = run(sieve, [*(alive(a1, index) for index in range(5)), jumped], holding(home))
    assert type(error) is MotionError
    assert str(error) == "the encoder of joint 'RL_thigh_joint' jumped by 0.30 rad in 2 ms at t = 0.010 s"
    assert count == 5


def test_after_a_gap_a_joint_may_be_somewhere_else(a1, sieve, home):
    late = alive(a1, 400)
    late.joint_position[7] += 0.3
    assert run(sieve, [alive(a1, 0), late], holding(home))[0] is None


def test_a_frozen_encoder_is_noticed_when_its_joint_is_sent_elsewhere(a1, sieve, home):
    samples = [alive(a1, index) for index in range(500)]
    for sample in samples:
        sample.joint_position[4] = home[4]
    error, count = run(sieve, samples, moving(home))
    assert type(error) is MotionError
    assert str(error).startswith(
        "the encoder of joint 'FR_thigh_joint' is frozen: its reading has not changed for 0.15 s while its target "
        "moved by 0.0"
    )
    assert 0.15 <= count * PERIOD < 0.2


def test_an_encoder_of_a_joint_that_is_sent_nowhere_may_read_the_same_for_good(a1, sieve, home):
    """Coarse encoders do, of robots that stand."""
    samples = [alive(a1, index, joint_position=home) for index in range(3000)]
    assert run(sieve, samples, holding(home))[0] is None


def test_a_frozen_imu_is_noticed_when_the_robot_moves(a1, sieve, home):
    still = at_rest(a1)
    samples = [
        alive(
            a1,
            index,
            angular_velocity_in_imu=still.angular_velocity_in_imu,
            acceleration_in_imu=still.acceleration_in_imu,
        )
        for index in range(500)
    ]
    assert run(sieve, samples, holding(home))[0] is None
    sieve = SampleFilter(a1, PERIOD, SILENCE)
    error, count = run(sieve, samples, moving(home))
    assert type(error) is MotionError
    assert str(error).startswith("the IMU is frozen: its readings have not changed for 0.1")
    assert count * PERIOD < 0.2


@pytest.mark.parametrize(
    ("again", "kind", "message"),
    [
        (
            lambda last: last,
            CommunicationError,
            "no sample has arrived for 102 ms: is the robot still on, and is the cable plugged in?",
        ),
        (
            lambda last: replace(last, joint_position=last.joint_position.copy()),
            MotionError,
            "samples are repeated: no fresh sample for 102 ms",
        ),
        (
            lambda last: replace(last, time=last.time - PERIOD, joint_position=last.joint_position.copy()),
            MotionError,
            "samples arrive out of order: no fresh sample for 102 ms",
        ),
    ],
)
def test_silence_and_repetition_have_different_errors(a1, sieve, home, again, kind, message):
    samples = [alive(a1, index) for index in range(20)]
    samples += [again(samples[-1]) for _ in range(100)]
    error, count = run(sieve, samples, moving(home))
    assert type(error) is kind
    assert str(error) == message
    assert count == 19 + 51
    assert sieve.counts.longest_silence == pytest.approx(SILENCE, abs=2 * PERIOD)


def test_an_imu_that_falls_silent_alone_is_named(a1, sieve, home):
    samples = [alive(a1, index, imu_time=min(index, 30) * PERIOD) for index in range(200)]
    error, count = run(sieve, samples, holding(home))
    assert type(error) is CommunicationError
    assert str(error) == "no IMU sample has arrived for 102 ms; joint samples have"
    assert count * PERIOD < 0.2


def test_a_few_lost_repeated_and_swapped_samples_are_counted_and_do_no_harm(a1, sieve, home):
    samples = [alive(a1, index) for index in range(100)]
    samples[20:23] = [samples[19]] * 3
    samples[40] = replace(samples[39], joint_position=samples[39].joint_position.copy())
    samples[60], samples[61] = samples[61], samples[60]
    times = [fresh.time for sample in samples for fresh in sieve.accept([sample], home)]
    assert times == sorted(set(times))
    assert (sieve.counts.missing, sieve.counts.repeated, sieve.counts.out_of_order) == (3, 1, 1)
    assert sieve.counts.fresh == 95


def test_what_arrived_together_is_returned_in_order_and_once(a1, sieve, home):
    first, second, third, fourth = (alive(a1, index) for index in range(4))
    sieve.accept([first], home)
    assert sieve.accept([first, second, second, third], home) == [second, third]
    assert sieve.accept([second, third], home) == []
    assert sieve.accept([], home) == []
    assert sieve.accept([fourth], home) == [fourth]


def test_a_robot_that_is_only_observed_may_give_the_same_sample_for_good(a1, sieve, home):
    for _ in range(200):
        sieve.accept([alive(a1, 0)], None)
    for _ in range(45):
        sieve.accept([alive(a1, 0)], home)
    assert sieve.counts.longest_silence == pytest.approx(45 * PERIOD)


@pytest.mark.parametrize("together", [1, 2])
def test_a_tolerant_filter_leaves_out_what_is_not_plausible(a1, sieve, home, together):
    """A robot is damped whatever its sensors send."""
    sieve.accept([alive(a1, 0)], home)
    bad = replace(alive(a1, 1), joint_position=np.full(12, np.nan))
    assert sieve.accept([bad, alive(a1, 2)][:together], home, tolerant=True) == []
    for _ in range(200):
        assert sieve.accept([], home, tolerant=True) == []
    assert sieve.accept([alive(a1, 3)], home, tolerant=True) != []
    with pytest.raises(MotionError):
        sieve.accept([replace(alive(a1, 4), joint_position=np.full(12, np.nan))], home)


@pytest.mark.parametrize("frozen", ["joint_position", "angular_velocity_in_imu"])
def test_what_read_the_same_before_the_first_command_has_not_been_sent_anywhere_yet(a1, sieve, home, frozen):
    samples = [at_rest(a1, index, **{frozen: getattr(at_rest(a1), frozen)}) for index in range(400)]
    for sample in samples[:150]:
        sieve.accept([sample], None)
    error, count = run(sieve, samples[150:], lambda index: home + (0.2 if index >= 150 else 0.0))
    assert count == 150
    assert "frozen" in str(error)


@given(st.lists(st.integers(0, 30), min_size=1, max_size=60), st.data())
def test_time_never_goes_back_whatever_arrives(a1, order, data):
    """And no sample is handed on twice."""
    sieve = SampleFilter(a1, PERIOD, 10.0)
    samples = [alive(a1, index) for index in range(31)]
    handed = []
    while order:
        count = data.draw(st.integers(1, len(order)))
        together, order = order[:count], order[count:]
        handed += [
            sample.time for sample in sieve.accept([samples[index] for index in together], samples[0].joint_position)
        ]
    assert handed == sorted(set(handed))
