"""Packets of the A1 and the Go1: layouts, both ways there and back, and anything else that may come through a socket.

Layouts are written out here a second time, by offsets. Where the folder of packets that the makers' own SDKs sent is found,
they are also held against those, bit for bit.
"""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from equipoise.drivers.unitree.crc import crc32_words
from equipoise.drivers.unitree.motors import MOTORS, STOP_POSITION, STOP_VELOCITY
from equipoise.drivers.unitree.packet_formats import A1, A1_STRUCT, FORMS, GO1, GO1_SCRAMBLED, forms_of
from equipoise.drivers.unitree.packets import (
    NOT_CONTROLLED,
    CommandPacket,
    SensorReadings,
    read_state,
)
from equipoise.errors import SettingsError
from equipoise.lab.emulators.udp_packets import StatePacket, read_command
from equipoise.platform.platform import JointCommand

ALL = {"a1": A1, "a1 struct": A1_STRUCT, "go1": GO1, "go1 scrambled": GO1_SCRAMBLED}
PACKETS = pytest.mark.parametrize("packets", ALL.values(), ids=ALL)
COMPRESSED = pytest.mark.parametrize("packets", [A1, GO1, GO1_SCRAMBLED], ids=["a1", "go1", "go1 scrambled"])
COMMANDED = ("position", "velocity", "torque", "kp", "kd")
SENSED = ("position", "velocity", "torque", "temperature", "gyroscope", "accelerometer")
FLOAT32_MAX = float(np.finfo(np.float32).max)
FLOAT32_ERROR = {"rtol": 6e-8, "atol": 1e-38}
COUNTS = {"torque": 256, "kp": 32, "kd": 16}
CAPTURES = "EQUIPOISE_CAPTURES"  # names the folder of captured packets

numbers = st.floats(-1e300, 1e300)


def of_motors(elements=numbers, width=MOTORS):
    return arrays(float, width, elements=elements)


commands = st.builds(JointCommand, *[of_motors()] * len(COMMANDED))
states = st.builds(
    SensorReadings,
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
    return JointCommand(*(np.arange(MOTORS) * 0.125 + start for start in (-1.0, 2.0, -3.0, 40.0, 5.0)))


def some_state(tick=77):
    rows = (np.arange(MOTORS) * 0.125 + start for start in (-1.0, 2.0, -3.0))
    return SensorReadings(
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


def held(name, values, packets, whole):
    """Return the values that a packet can hold of (n,) values."""
    values = np.clip(values, 0 if name in ("kp", "kd") else -FLOAT32_MAX, FLOAT32_MAX)
    if packets is A1_STRUCT or name not in COUNTS:
        return values
    counts = whole(np.float32(values).astype(float) * COUNTS[name])
    return np.clip(counts, -(2**15), 2**15 - 1) / COUNTS[name]


@given(st.binary(max_size=200).map(lambda data: data[: len(data) // 4 * 4]))
def test_the_checksum_is_that_of_a_slow_implementation(data):
    assert crc32_words(data) == crc_mpeg_2(big_endian(data))


def test_the_checksum_has_its_check_value():
    assert crc_mpeg_2(b"123456789") == 0x0376E6E7  # the catalogues' check value


@PACKETS
def test_packets_are_as_long_as_the_robots(packets):
    lengths = {A1: (610, 771), A1_STRUCT: (730, 891)}.get(packets, (614, 807))
    assert (packets.command.itemsize, packets.state.itemsize) == lengths
    assert len(CommandPacket(packets).write(some_commands())) == lengths[0]
    assert len(StatePacket(packets).write(some_state())) == lengths[1]


def scrambled(checksum):
    """Exclusive or with a constant, then the bytes moved on by one, cyclically."""
    mixed = struct.pack("<I", checksum ^ 0xEDCAB9DE)
    return mixed[1:] + mixed[:1]


def described_command(packets, values):
    """A command's bytes by offsets, of (12,) values by name that fit into float32 and counts."""
    size, head = {A1: (610, b"\xff" + bytes(9)), A1_STRUCT: (730, b"\xff" + bytes(9))}.get(
        packets, (614, b"\xfe\xef\xff" + bytes(17) + (b"\x3a\xc0" if packets is GO1_SCRAMBLED else bytes(2)))
    )
    layout, counts = ("<B5f12x", {}) if packets is A1_STRUCT else ("<B2f3h12x", COUNTS)
    data = bytearray(size)
    data[: len(head)] = head
    for motor in range(20):
        fields = [STOP_POSITION, STOP_VELOCITY, 0, 0, 0]
        if motor < MOTORS:
            fields = [
                int(counts[name] * values[name][motor]) if name in counts else values[name][motor] for name in COMMANDED
            ]
        struct.pack_into(layout, data, len(head) + motor * struct.calcsize(layout), 0x0A, *fields)
    covered = {610: 604, 614: 608, 730: 724}[size]
    checksum = crc_mpeg_2(big_endian(data[:covered]))
    data[-4:] = scrambled(checksum) if packets is GO1_SCRAMBLED else struct.pack("<I", checksum)
    return bytes(data)


@PACKETS
def test_a_command_byte_by_byte(packets):
    commands = some_commands()
    values = {name: getattr(commands, name) for name in COMMANDED}
    assert CommandPacket(packets).write(commands) == described_command(packets, values)


def sdk_commands():
    """Return the values of the captured packets, in the SDKs' float32."""
    joint, f = np.arange(MOTORS, dtype=np.float32), np.float32
    values = (
        f(0.1) * (joint + f(1)) - f(0.7),
        f(-0.05) * joint,
        f(0.65) * (joint - f(6)),
        f(5) + f(7.3) * joint,
        f(0.5) + f(0.37) * joint,
    )
    return JointCommand(*(value.astype(float) for value in values))


@pytest.mark.parametrize(("packets", "checksum"), [(A1, "ceb5d18f"), (GO1, "256d4601")], ids=["a1", "go1"])
def test_commands_that_the_sdk_has_to_truncate_get_the_sdks_checksum(packets, checksum):
    data, values = CommandPacket(packets).write(sdk_commands()), sdk_commands()
    assert data == described_command(packets, {name: getattr(values, name) for name in COMMANDED})
    assert data[-4:].hex() == checksum
    first = {A1: 10, GO1: 22}[packets]
    assert data[first + 9 : first + 15].hex() == "1afca0000800"  # -3.9 Nm, 5 and 0.5: -998.4, 160 and 8 counts
    assert (
        data[first + 36 : first + 42].hex() == "c0fc89010d00"
    )  # -3.25 Nm, 12.3 and 0.87: -832, 393.6 and 13.92 counts


@COMPRESSED
def test_counts_are_of_the_float32_that_an_sdk_holds(packets):
    almost = JointCommand(*(np.full(MOTORS, value) for value in (0.0, 0.0, -(2 - 1e-9), 12.5 - 1e-9, 1 - 1e-9)))
    read = read_command(packets, bytes(CommandPacket(packets).write(almost)))
    assert (read.torque[0], read.kp[0], read.kd[0]) == (-2.0, 12.5, 1.0)


@PACKETS
def test_a_gain_is_never_negative(packets):
    wrong = JointCommand(*(np.full(MOTORS, value) for value in (0.0, 0.0, -1.0, -2.0, -0.5)))
    read = read_command(packets, bytes(CommandPacket(packets).write(wrong)))
    assert (read.torque == -1).all()
    assert not read.kp.any()
    assert not read.kd.any()


def described_state(packets, state, scrambles=False):
    """A state's bytes by offsets."""
    size, head, imu, tick, covered = {
        A1: (771, b"\xff", 10, 719, 764),
        A1_STRUCT: (891, b"\xff", 10, 839, 884),
    }.get(packets, (807, b"\xfe\xef\xff", 22, 755, 800))
    data = bytearray(size)
    data[: len(head)] = head
    struct.pack_into("<4f3f3f3fb", data, imu, 1, 0, 0, 0, *state.gyroscope, *state.accelerometer, 0, 0, 0, 25)
    for motor in range(MOTORS):
        position, velocity, torque, temperature = (getattr(state, name)[motor] for name in SENSED[:4])
        if packets is A1_STRUCT:
            fields = (position, velocity, 1, torque, 7, 8, 9, round(temperature))
            struct.pack_into("<B7fb", data, imu + 53 + 38 * motor, 10, *fields)
        else:
            fields = (position, velocity, 1, round(256 * torque), 7, 8, 9, round(temperature))
            struct.pack_into("<B2fhh2fhb", data, imu + 53 + 32 * motor, 10, *fields)
    if head != b"\xff":
        struct.pack_into("<4Bi", data, 715, 1, 2, 3, 50, -1500)
        data[729:735] = bytes([125] * 6)
    struct.pack_into("<I", data, tick, state.tick)
    checksum = crc_mpeg_2(big_endian(data[:covered]))
    data[-4:] = scrambled(checksum) if scrambles else struct.pack("<I", checksum)
    return bytes(data)


@PACKETS
def test_a_state_is_read_where_the_robot_writes_it(packets):
    state = some_state()
    for padding in {0, packets.state_lengths[-1] - packets.state_lengths[0]}:
        read = read_state(packets, described_state(packets, state) + bytes(padding))
        assert_same(read, state)
        if "battery" in packets.state.names:
            assert read.battery_charge == 0.5
            assert read.battery_voltage == pytest.approx(6 * 125 * 0.032)


def test_a_scrambled_state_is_taken_where_commands_are_scrambled_and_nowhere_else():
    state = described_state(GO1, some_state(), scrambles=True)
    assert_same(read_state(GO1_SCRAMBLED, state), some_state())
    assert read_state(GO1, state) == "wrong checksum"


def assert_same(read, state):
    for name in SENSED:
        assert np.array_equal(getattr(read, name), getattr(state, name)), name
    assert read.tick == state.tick


def test_forms_go_by_robot_and_name_the_likeliest_first():
    assert {protocol: list(forms) for protocol, forms in FORMS.items()} == {
        "a1": ["compressed", "struct"],
        "go1": ["plain", "scrambled"],
    }
    assert [*forms_of("a1", None).values()] == [A1, A1_STRUCT]
    assert [*forms_of("go1", "scrambled").values()] == [GO1_SCRAMBLED]


# --- against packets of the makers' own SDKs


def captured(name):
    """A captured packet; the folder is next to the checkout, or set in the environment."""
    candidates = [parent / "shared" / "unitree_udp" for parent in Path(__file__).resolve().parents]
    given = os.environ.get(CAPTURES)
    for folder in [Path(given)] if given else candidates:
        if (folder / name).is_file():
            return (folder / name).read_bytes()
    return pytest.skip(f"NOT compared with the makers' packets: no {name} next to the checkout or in {CAPTURES}")


SDKS = pytest.mark.parametrize(("packets", "sdk"), [(A1, "a1_sdk_3.3.1"), (GO1, "go1_sdk_3.8.4")], ids=["a1", "go1"])


@SDKS
def test_we_send_what_the_makers_sdk_sends_bit_for_bit(packets, sdk):
    assert CommandPacket(packets).write(sdk_commands()) == captured(f"{sdk}_command.bin")


@SDKS
def test_the_simulated_robot_reads_what_the_makers_sdk_means(packets, sdk):
    read, meant = read_command(packets, captured(f"{sdk}_command.bin")), sdk_commands()
    for name in COMMANDED:
        aside = getattr(meant, name) - getattr(read, name)
        step = 1 / COUNTS.get(name, np.inf)
        assert (np.abs(aside) < step).all() if step else not aside.any(), name
        assert (aside * getattr(meant, name) >= 0).all(), name  # towards zero


def sdk_state(packets):
    """Return the command of the captured packets."""
    joint = np.arange(float(MOTORS))
    battery = (0.77, 6 * 4.096) if packets is GO1 else (None, None)
    return SensorReadings(
        0.05 * joint - 0.3,
        0.1 * joint,
        0.7 * joint - 4,
        30 + joint,
        np.array([0.1, -0.2, 0.3]),
        np.array([0.5, -0.6, 9.7]),
        123756,
        *battery,
    )


@SDKS
def test_we_read_what_the_makers_sdk_reads(packets, sdk):
    read, meant = read_state(packets, captured(f"{sdk}_state.bin")), sdk_state(packets)
    for name in SENSED:
        assert np.allclose(getattr(read, name), getattr(meant, name), rtol=6e-8, atol=0.5 / COUNTS.get(name, 1e9)), name
    assert (read.tick, read.battery_charge) == (123756, meant.battery_charge)
    assert read.battery_voltage == pytest.approx(meant.battery_voltage)


@SDKS
def test_the_simulated_robot_sends_what_the_makers_sdk_accepts_bit_for_bit(packets, sdk):
    assert StatePacket(packets).write(sdk_state(packets)) == captured(f"{sdk}_state.bin")


@PACKETS
@given(sent=commands)
def test_commands_there_and_back_are_what_fits_of_them(packets, sent):
    read = read_command(packets, bytes(CommandPacket(packets).write(sent)))
    for name in COMMANDED:
        expected = held(name, getattr(sent, name), packets, np.trunc)
        assert np.allclose(getattr(read, name), expected, **FLOAT32_ERROR), name


@PACKETS
@given(sent=states)
def test_states_there_and_back_are_the_nearest_that_fit(packets, sent):
    read = read_state(packets, bytes(StatePacket(packets).write(sent)))
    for name in SENSED:
        expected = held(name, getattr(sent, name), packets, np.rint)
        assert np.allclose(getattr(read, name), expected, **FLOAT32_ERROR), name
    assert read.tick == sent.tick
    if "battery" in packets.state.names:
        assert read.battery_charge == pytest.approx(sent.battery_charge)
        assert read.battery_voltage == pytest.approx(sent.battery_voltage, abs=6 * 0.032)


@PACKETS
def test_what_was_read_is_written_as_it_was(packets):
    data = bytes(CommandPacket(packets).write(some_commands()))
    assert CommandPacket(packets).write(read_command(packets, data)) == data


@PACKETS
def test_without_torque_nothing_is_controlled(packets):
    read = read_command(packets, bytes(CommandPacket(packets).write(NOT_CONTROLLED)))
    assert (read.position == np.float32(STOP_POSITION)).all()
    assert (read.velocity == STOP_VELOCITY).all()
    assert not any(getattr(read, name).any() for name in ("torque", "kp", "kd"))


@PACKETS
def test_a_packet_that_is_written_again_holds_nothing_of_the_first(packets):
    packet = CommandPacket(packets)
    packet.write(NOT_CONTROLLED)
    assert packet.write(some_commands()) == CommandPacket(packets).write(some_commands())


@PACKETS
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_not_sent(packets, value):
    wrong = some_commands()
    wrong.kd[7] = value
    with pytest.raises(SettingsError, match="must be finite numbers"):
        CommandPacket(packets).write(wrong)


@PACKETS
@given(data=st.data())
def test_any_bytes_are_read_or_refused(packets, data):
    read, layout = data.draw(st.sampled_from([(read_command, packets.command), (read_state, packets.state)]))
    head = data.draw(st.sampled_from([b"", packets.begins]))
    body = data.draw(st.binary(max_size=1200) | st.binary(min_size=layout.itemsize, max_size=layout.itemsize))
    received = (head + body)[: max(len(body), 1)]
    assert isinstance(read(packets, received), (str, JointCommand, SensorReadings))


@PACKETS
@given(random=st.randoms(use_true_random=False))
def test_random_numbers_under_a_right_checksum_do_no_harm(packets, random):
    data = bytearray(random.randbytes(packets.state.itemsize))
    data[: len(packets.begins)] = packets.begins
    words = len(data) // 4 - 1
    data[-4:] = struct.pack("<I", crc32_words(data[: 4 * words]))
    assert isinstance(read_state(packets, bytes(data)), SensorReadings)


@PACKETS
def test_other_lengths_are_damage(packets):
    command, state = (
        bytes(CommandPacket(packets).write(some_commands())),
        bytes(StatePacket(packets).write(some_state())),
    )
    for length in {*range(1000)} - {len(command)}:
        assert read_command(packets, (2 * command)[:length]) == "wrong length"
    for length in {*range(1000)} - {*packets.state_lengths}:
        assert read_state(packets, (2 * state)[:length]) == "wrong length"


@PACKETS
def test_packets_of_another_level_or_robot_are_damage(packets):
    state = StatePacket(packets).write(some_state())
    for index in range(len(packets.begins)):
        changed = bytearray(state)
        changed[index] ^= 0x11  # the level flag: 0xFF becomes 0xEE, the high level
        assert read_state(packets, bytes(changed)) == "wrong head"


@PACKETS
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
    assert read(packets, bytes(changed)) == "wrong checksum"
    if read is read_state:
        assert isinstance(read_state(packets, bytes(changed), check=False), SensorReadings)
