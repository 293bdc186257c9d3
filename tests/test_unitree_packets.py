"""Packets of the A1 and the Go1: layouts, both ways there and back, and anything else that may come through a socket."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from equipoise.errors import SettingsError
from equipoise.platforms.unitree_crc import crc32_words
from equipoise.platforms.unitree_formats import A1, GO1
from equipoise.platforms.unitree_packets import (
    POSITION_STOP,
    VELOCITY_STOP,
    CommandPacket,
    Damage,
    LowState,
    MotorCommands,
    StatePacket,
    read_command,
    read_state,
)
from equipoise.robot.unitree_motors import MOTORS

FORMATS = pytest.mark.parametrize("packets", [A1, GO1], ids=["a1", "go1"])
COMMANDED = ("position", "velocity", "torque", "kp", "kd")
SENSED = ("position", "velocity", "torque", "temperature", "gyroscope", "accelerometer")
FLOAT32_MAX = float(np.finfo(np.float32).max)
FLOAT32_ERROR = {"rtol": 6e-8, "atol": 1e-38}
GO1_STEPS = {"torque": 1 / 256, "kp": 1 / 32, "kd": 1 / 16}
GO1_LIMITS = {"torque": (-(2**15), 2**15 - 1), "kp": (0, 2**16 - 1), "kd": (0, 2**16 - 1)}

numbers = st.floats(-1e300, 1e300)


def of_motors(elements=numbers, width=MOTORS):
    return arrays(float, width, elements=elements)


commands = st.builds(MotorCommands, *[of_motors()] * len(COMMANDED))
states = st.builds(
    LowState,
    position=of_motors(),
    velocity=of_motors(),
    torque=of_motors(),
    temperature=of_motors(st.integers(-128, 127).map(float)),
    gyroscope=of_motors(width=3),
    accelerometer=of_motors(width=3),
    tick=st.integers(0, 2**32 - 1),
    battery_charge=st.integers(0, 100).map(lambda percent: percent / 100),
    battery_voltage=st.floats(0, 48),
)


def some_commands():
    return MotorCommands(*(np.arange(MOTORS) * 0.125 + start for start in (-1.0, 2.0, -3.0, 40.0, 5.0)))


def some_state(tick=77):
    rows = (np.arange(MOTORS) * 0.125 + start for start in (-1.0, 2.0, -3.0))
    return LowState(
        *rows, np.arange(30.0, 42.0), np.array([0.5, -0.25, 2.0]), np.array([1.0, -2.0, 9.5]), tick, 0.5, 24.0
    )


def crc_mpeg_2(data):
    """CRC-32/MPEG-2 of the usual catalogues, by its definition."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc >> 31 else 0)) & 0xFFFFFFFF
    return crc


def big_endian(data):
    return b"".join(data[begin : begin + 4][::-1] for begin in range(0, len(data), 4))


def nearest(name, values, packets):
    """What the packet can hold of (n,) values."""
    step = GO1_STEPS.get(name) if packets is GO1 else None
    if step is None:
        return np.clip(values, -FLOAT32_MAX, FLOAT32_MAX)
    low, high = GO1_LIMITS[name]
    return np.clip(np.rint(np.clip(values, -1e6, 1e6) / step), low, high) * step


@given(st.binary(max_size=200).map(lambda data: data[: len(data) // 4 * 4]))
def test_the_checksum_is_the_known_one_of_words(data):
    assert crc32_words(data) == crc_mpeg_2(big_endian(data))


def test_the_known_checksum_is_known():
    assert crc_mpeg_2(b"123456789") == 0x0376E6E7  # the catalogues' check value


@FORMATS
def test_packets_are_as_long_as_the_robots(packets):
    lengths = {A1: (730, 891), GO1: (614, 807)}[packets]
    assert (packets.command.itemsize, packets.state.itemsize) == lengths
    assert len(CommandPacket(packets).write(some_commands())) == lengths[0]
    assert len(StatePacket(packets).write(some_state())) == lengths[1]


def test_an_a1s_command_byte_by_byte():
    data, commands = CommandPacket(A1).write(some_commands()), some_commands()
    assert data[:10] == b"\xff" + bytes(9)
    for motor in range(MOTORS):
        expected = [getattr(commands, name)[motor] for name in COMMANDED]
        assert struct.unpack_from("<B5f3I", data, 10 + 33 * motor) == (10, *expected, 0, 0, 0)
    for motor in range(MOTORS, 20):
        unused = (10, np.float32(POSITION_STOP), VELOCITY_STOP, 0, 0, 0)
        assert struct.unpack_from("<B5f", data, 10 + 33 * motor) == unused
    assert data[670:726] == bytes(56)
    assert struct.unpack_from("<I", data, 726) == (crc_mpeg_2(big_endian(data[:724])),)


def test_a_go1s_command_byte_by_byte():
    data, commands = CommandPacket(GO1).write(some_commands()), some_commands()
    assert data[:22] == b"\xfe\xef\xff" + bytes(17) + b"\x3a\xc0"
    for motor in range(MOTORS):
        position, velocity, torque, kp, kd = (getattr(commands, name)[motor] for name in COMMANDED)
        expected = (10, position, velocity, round(256 * torque), round(32 * kp), round(16 * kd))
        assert struct.unpack_from("<B2fh2H", data, 22 + 27 * motor) == expected
    assert data[562:610] == bytes(48)
    # Exclusive or with a constant, then the bytes moved on by one, cyclically.
    mixed = struct.pack("<I", crc_mpeg_2(big_endian(data[:608])) ^ 0xEDCAB9DE)
    assert data[610:] == mixed[1:] + mixed[:1]


def test_an_a1s_state_is_read_where_the_robot_writes_it():
    data, state = bytearray(891), some_state()
    data[0] = 0xFF
    struct.pack_into("<4f3f3f3fb", data, 10, 1, 0, 0, 0, *state.gyroscope, *state.accelerometer, 0, 0, 0, 25)
    for motor in range(MOTORS):
        position, velocity, torque, temperature = (getattr(state, name)[motor] for name in SENSED[:4])
        struct.pack_into("<B7fb", data, 63 + 38 * motor, 10, position, velocity, 1, torque, 7, 8, 9, round(temperature))
    struct.pack_into("<I", data, 839, state.tick)
    struct.pack_into("<I", data, 887, crc_mpeg_2(big_endian(data[:884])))
    assert_same(read_state(A1, bytes(data)), state)


@pytest.mark.parametrize("padding", [0, 13])
@pytest.mark.parametrize("scrambled", [False, True])
def test_a_go1s_state_is_read_where_the_robot_writes_it(scrambled, padding):
    data, state = bytearray(807), some_state()
    data[:3] = b"\xfe\xef\xff"
    struct.pack_into("<4f3f3f3fb", data, 22, 1, 0, 0, 0, *state.gyroscope, *state.accelerometer, 0, 0, 0, 25)
    for motor in range(MOTORS):
        position, velocity, torque, temperature = (getattr(state, name)[motor] for name in SENSED[:4])
        fields = (10, position, velocity, 1, round(256 * torque), 7, 8, 9, round(temperature))
        struct.pack_into("<B2fhh2fhb", data, 75 + 32 * motor, *fields)
    struct.pack_into("<4Bi", data, 715, 1, 2, 3, 50, -1500)
    data[729:735] = bytes([125] * 6)
    struct.pack_into("<I", data, 755, state.tick)
    checksum = struct.pack("<I", crc_mpeg_2(big_endian(data[:800])) ^ (0xEDCAB9DE if scrambled else 0))
    data[803:] = checksum[1:] + checksum[:1] if scrambled else checksum
    read = read_state(GO1, bytes(data) + bytes(padding))
    assert_same(read, state)
    assert read.battery_charge == 0.5
    assert read.battery_voltage == pytest.approx(6 * 125 * 0.032)


def assert_same(read, state):
    for name in SENSED:
        assert np.array_equal(getattr(read, name), getattr(state, name)), name
    assert read.tick == state.tick


@FORMATS
@given(sent=commands)
def test_commands_there_and_back_are_the_nearest_that_fit(packets, sent):
    read = read_command(packets, bytes(CommandPacket(packets).write(sent)))
    for name in COMMANDED:
        expected = nearest(name, getattr(sent, name), packets)
        assert np.allclose(getattr(read, name), expected, **FLOAT32_ERROR), name


@FORMATS
@given(sent=states)
def test_states_there_and_back_are_the_nearest_that_fit(packets, sent):
    read = read_state(packets, bytes(StatePacket(packets).write(sent)))
    for name in SENSED:
        expected = nearest(name, getattr(sent, name), packets)
        assert np.allclose(getattr(read, name), expected, **FLOAT32_ERROR), name
    assert read.tick == sent.tick
    if packets is GO1:
        assert read.battery_charge == pytest.approx(sent.battery_charge)
        assert read.battery_voltage == pytest.approx(sent.battery_voltage, abs=6 * 0.032)


@FORMATS
def test_what_was_read_is_written_as_it_was(packets):
    data = bytes(CommandPacket(packets).write(some_commands()))
    assert CommandPacket(packets).write(read_command(packets, data)) == data


@FORMATS
def test_without_torque_nothing_is_controlled(packets):
    read = read_command(packets, bytes(CommandPacket(packets).write(MotorCommands.without_torque())))
    assert (read.position == np.float32(POSITION_STOP)).all()
    assert (read.velocity == VELOCITY_STOP).all()
    assert not any(getattr(read, name).any() for name in ("torque", "kp", "kd"))


@FORMATS
def test_a_packet_that_is_written_again_holds_nothing_of_the_first(packets):
    packet = CommandPacket(packets)
    packet.write(MotorCommands.without_torque())
    assert packet.write(some_commands()) == CommandPacket(packets).write(some_commands())


@FORMATS
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_not_sent(packets, value):
    wrong = some_commands()
    wrong.kd[7] = value
    with pytest.raises(SettingsError, match="must be numbers"):
        CommandPacket(packets).write(wrong)


@FORMATS
@given(data=st.data())
def test_any_bytes_are_read_or_refused(packets, data):
    read, layout = data.draw(st.sampled_from([(read_command, packets.command), (read_state, packets.state)]))
    head = data.draw(st.sampled_from([b"", packets.begins]))
    body = data.draw(st.binary(max_size=1200) | st.binary(min_size=layout.itemsize, max_size=layout.itemsize))
    received = (head + body)[: max(len(body), 1)]
    assert isinstance(read(packets, received), (Damage, MotorCommands, LowState))


@FORMATS
@given(random=st.randoms(use_true_random=False))
def test_random_numbers_under_a_right_checksum_do_no_harm(packets, random):
    data = bytearray(random.randbytes(packets.state.itemsize))
    data[: len(packets.begins)] = packets.begins
    words = len(data) // 4 - 1
    data[-4:] = struct.pack("<I", crc32_words(data[: 4 * words]))
    assert isinstance(read_state(packets, bytes(data)), LowState)


@FORMATS
def test_other_lengths_are_damage(packets):
    command, state = (
        bytes(CommandPacket(packets).write(some_commands())),
        bytes(StatePacket(packets).write(some_state())),
    )
    for length in {*range(1000)} - {len(command)}:
        assert read_command(packets, (2 * command)[:length]) is Damage.LENGTH
    for length in {*range(1000)} - {*packets.state_lengths}:
        assert read_state(packets, (2 * state)[:length]) is Damage.LENGTH


@FORMATS
def test_packets_of_another_level_or_robot_are_damage(packets):
    state = StatePacket(packets).write(some_state())
    for index in range(len(packets.begins)):
        changed = bytearray(state)
        changed[index] ^= 0x11  # the level flag: 0xFF becomes 0xEE, the high level
        assert read_state(packets, bytes(changed)) is Damage.HEAD


@FORMATS
@given(data=st.data())
def test_a_flipped_bit_is_seen(packets, data):
    read, packet = data.draw(
        st.sampled_from(
            [
                (read_command, CommandPacket(packets).write(some_commands())),
                (read_state, StatePacket(packets).write(some_state())),
            ]
        )
    )
    covered = (len(packet) // 4 - 1) * 4
    at = data.draw(st.integers(len(packets.begins), covered - 1) | st.integers(len(packet) - 4, len(packet) - 1))
    changed = bytearray(packet)
    changed[at] ^= 1 << data.draw(st.integers(0, 7))
    assert read(packets, bytes(changed)) is Damage.CHECKSUM
    if read is read_state:
        assert isinstance(read_state(packets, bytes(changed), check=False), LowState)
