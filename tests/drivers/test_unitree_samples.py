"""Go2 messages as bytes are what cyclonedds makes of the same fields, and their checksum is the published one."""

import struct
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("cyclonedds")


from equipoise.drivers.unitree.crc import crc32_words
from equipoise.drivers.unitree.dds_types import (
    BmsCmd,
    BmsState,
    IMUState,
    LowCmd,
    LowState,
    MotorCmd,
    MotorState,
)
from equipoise.drivers.unitree.low_level import COMMAND, LOW_CMD, LOW_STATE, STATE, read_message
from equipoise.drivers.unitree.motors import joints_of_motors
from equipoise.errors import SettingsError

# As in the robot's memory, fields in order: of a command and of a state.
C_COMMAND = "<4B4IH2x" + "B3x5f3I" * 20 + "4B" + "55Bx2I"
C_STATE = "<4B4IH2x" + "13fb3x" + "B3x7fb3x3I" * 20 + "4BiH4b15H" + "8hI41B3xf2b2x2f4h2I"

u8, u16, u32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
i16, i32 = st.integers(-(2**15), 2**15 - 1), st.integers(-(2**31), 2**31 - 1)
small = st.integers(0, 127)  # the published format of the checksum reads these bytes as signed
f32 = st.floats(width=32, allow_nan=False)


def some(value, count):
    return st.lists(value, min_size=count, max_size=count)


HEAD = (some(u8, 2), u8, u8, some(u32, 2), some(u32, 2), u16)
COMMANDS = st.builds(
    LowCmd,
    *HEAD,
    some(st.builds(MotorCmd, u8, f32, f32, f32, f32, f32, some(u32, 3)), 20),
    st.builds(BmsCmd, u8, some(u8, 3)),
    some(u8, 40), some(u8, 12), some(u8, 2), u8, u32, u32,
)  # fmt: skip
MOTOR = st.builds(MotorState, u8, f32, f32, f32, f32, f32, f32, f32, small, u32, some(u32, 2))
STATES = st.builds(
    LowState,
    *HEAD,
    st.builds(IMUState, some(f32, 4), some(f32, 3), some(f32, 3), some(f32, 3), small),
    some(MOTOR, 20),
    st.builds(BmsState, u8, u8, u8, u8, i32, u16, some(small, 2), some(small, 2), some(u16, 15)),
    some(i16, 4), some(i16, 4), u32, some(u8, 40), u8, f32, small, small, f32, f32, some(st.integers(0, 2**15 - 1), 4),
    u32, u32,
)  # fmt: skip
BOTH = [(COMMAND, LowCmd, COMMANDS, C_COMMAND), (STATE, LowState, STATES, C_STATE)]


def flat(value):
    """All numbers of a message, in order."""
    if is_dataclass(value):
        return [number for field in fields(value) for number in flat(getattr(value, field.name))]
    return [number for item in value for number in flat(item)] if isinstance(value, (list, bytes)) else [value]


def crc_bit_by_bit(data):
    """Encode as in the definition."""
    register = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        for bit in range(31, -1, -1):
            top = (register >> 31) ^ (word >> bit & 1)
            register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if top else 0)
    return register


def test_the_checksum_of_nothing_is_what_it_begins_with():
    assert crc32_words(b"") == 0xFFFFFFFF


@given(st.lists(u32, max_size=300))
def test_the_checksum_is_the_bitwise_one(words):
    data = struct.pack(f"<{len(words)}I", *words)
    assert crc32_words(data) == crc_bit_by_bit(data)


@pytest.mark.parametrize(("layout", "kind", "messages", "in_memory"), BOTH)
def test_records_are_laid_out_as_in_the_robots_memory(layout, kind, messages, in_memory):
    assert struct.calcsize(in_memory) == layout.memory.itemsize

    @settings(max_examples=30)
    @given(messages)
    def check(message):
        packed = struct.pack(in_memory, *flat(message))
        assert layout.to_memory(message.serialize(use_version_2=False)) == packed
        assert layout.to_wire(packed) == message.serialize(use_version_2=False)
        assert kind.deserialize(layout.to_wire(packed)).serialize() == message.serialize()

    check()


@settings(max_examples=30)
@given(STATES)
def test_fields_read_from_bytes_are_those_that_cyclonedds_reads(message):
    message.crc = 0
    record = read_message(STATE, message.serialize(), check=False)
    for name in ("q", "dq", "ddq", "tau_est", "temperature", "lost"):
        expected = [getattr(motor, name) for motor in message.motor_state]
        assert np.array_equal(record["motor_state"][name], np.array(expected, record["motor_state"][name].dtype))
    assert record["imu_state"]["gyroscope"].tolist() == message.imu_state.gyroscope
    assert record["imu_state"]["accelerometer"].tolist() == message.imu_state.accelerometer
    assert (record["tick"], record["power_v"]) == (message.tick, np.float32(message.power_v))
    assert record["bms_state"]["soc"] == message.bms_state.soc


@pytest.mark.parametrize(("layout", "kind", "messages", "in_memory"), BOTH)
def test_messages_carry_the_published_checksum(layout, kind, messages, in_memory):
    del messages
    written = layout.blank()
    written[layout.motors]["q"] = np.linspace(-3, 3, 20)
    message = kind.deserialize(layout.encoded(written))
    packed = struct.pack(in_memory, *flat(message))
    assert message.crc == crc_bit_by_bit(packed[:-4])


def test_a_fresh_command_has_the_values_that_robots_start_with():
    command = LowCmd.deserialize(COMMAND.encoded(COMMAND.blank()))
    assert (bytes(command.head), command.level_flag) == (b"\xfe\xef", 0xFF)
    assert {motor.mode for motor in command.motor_cmd} == {1}


@pytest.mark.parametrize("layout", [COMMAND, STATE])
@given(data=st.data())
def test_any_damaged_bit_is_noticed(layout, data):
    record = layout.blank()
    record[layout.motors]["q"] = 0.7
    encoded = bytearray(layout.encoded(record))
    assert read_message(layout, bytes(encoded)) is not None
    memory = layout.to_memory(bytes(encoded))
    at = data.draw(st.integers(4, len(encoded) - 5))
    encoded[at] ^= 1 << data.draw(st.integers(0, 7))
    if layout.to_memory(bytes(encoded)) != memory:  # else it is padding, which means nothing
        assert read_message(layout, bytes(encoded)) is None


@pytest.mark.parametrize("layout", [COMMAND, STATE])
def test_what_is_cut_short_or_otherwise_encoded_is_no_message(layout):
    encoded = layout.encoded(layout.blank())
    assert read_message(layout, encoded[:-4]) is None
    assert read_message(layout, encoded + bytes(4)) is None
    assert read_message(layout, b"") is None
    assert read_message(layout, b"\x00\x07\x00\x00" + encoded[4:]) is None


def test_a_wrong_checksum_and_a_zero_one_are_damage_unless_they_are_not_to_be_checked():
    encoded = STATE.encoded(STATE.blank())
    wrong = encoded[:-4] + bytes([encoded[-4] ^ 1]) + encoded[-3:]
    assert read_message(STATE, wrong) is None
    assert read_message(STATE, wrong, check=False) is not None
    assert read_message(STATE, encoded[:-4] + bytes(4)) is None
    assert read_message(STATE, encoded[:-4] + bytes(4), check=False) is not None


def test_motors_come_right_legs_first(a1):
    order = joints_of_motors(a1, "unitree-go2")
    assert [a1.joint_names[joint] for joint in order] == [
        f"{leg}_{joint}_joint" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")
    ]


def test_motors_are_found_whatever_the_models_order(skewed):
    order = joints_of_motors(skewed, "unitree-go2")
    for place, leg in enumerate(("FR", "FL", "RR", "RL")):
        names = [skewed.joint_names[joint] for joint in order[3 * place : 3 * place + 3]]
        assert names == list(skewed.legs[leg].joint_names)


def test_a_robot_with_other_legs_is_refused(two_jointed):
    with pytest.raises(SettingsError, match=r"unitree-go2 has 12 joints, three per leg; .* has 8"):
        joints_of_motors(two_jointed, "unitree-go2")


def test_layouts_are_as_long_as_published():
    assert (LOW_CMD.itemsize, LOW_STATE.itemsize) == (812, 1180)
