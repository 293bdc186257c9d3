"""Topics read in batches equal those read as a whole."""

import numpy as np
import pytest
from foreign_logs import EPOCH, store
from mcap.writer import CompressionType, Writer

from equipoise.logs.bag_streams import GatheredTopic
from equipoise.logs.message_types import JOINT_STATE, known_types
from equipoise.recording.mcap_reader import MessageReader

TYPES = store()


def message(stamp, names, position, velocity=()):
    types = TYPES.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    made = types[JOINT_STATE](
        header=types["std_msgs/msg/Header"](stamp=time, frame_id=""), name=list(names),
        position=np.array(position, dtype=float), velocity=np.array(velocity, dtype=float), effort=np.zeros(0),
    )  # fmt: skip
    return bytes(TYPES.serialize_cdr(made, JOINT_STATE))


def gathered(batches, room=10_000):
    """A topic of batches of (times, bodies), and its joints."""
    topic = GatheredTopic("/joint_states", JOINT_STATE, known_types(), room)
    for times, bodies in batches:
        for received, body in zip(times, bodies, strict=True):
            topic.take([("/joint_states", JOINT_STATE, received, body)])
    topic.finish()
    return topic, topic.joints(np.empty(0))


@pytest.fixture(scope="module")
def batches():
    """5,000 messages of two joints, then as many of three in another order that have velocities too."""
    first = [message(k, ("a", "b"), (k, -k)) for k in range(5000)]
    second = [message(k, ("c", "b", "a"), (1, -k, k), (7, 8, 9)) for k in range(5000, 10_000)]
    return [(range(5000), first), (range(5000, 10_000), second)]


def test_joints_and_velocities_that_come_later_are_nan_before(batches):
    topic, joints = gathered(batches)
    assert joints.names == ("a", "b", "c")
    np.testing.assert_array_equal(joints.position[:, 0], np.arange(10_000))
    np.testing.assert_array_equal(joints.position[:, 1], -np.arange(10_000))
    assert np.isnan(joints.position[:5000, 2]).all()
    assert np.isnan(joints.velocity[:5000]).all()
    assert (joints.velocity[5000:] == [9, 8, 7]).all()
    assert joints.torque is None
    np.testing.assert_array_equal(topic.header, np.arange(10_000))


def test_messages_are_put_in_order_of_receipt(batches):
    """Recorders with several threads write messages out of order."""
    (times, bodies), _ = batches
    topic, joints = gathered([(list(reversed(times)), list(reversed(bodies)))])
    np.testing.assert_array_equal(topic.received, np.arange(5000))
    np.testing.assert_array_equal(joints.position[:, 0], np.arange(5000))


@pytest.mark.parametrize("room", [0, 3000])
def test_a_topic_may_have_more_messages_than_the_bag_states(batches, room):
    whole, cramped = gathered(batches)[1], gathered(batches, room)[1]
    np.testing.assert_array_equal(whole.position, cramped.position)
    np.testing.assert_array_equal(whole.velocity, cramped.velocity)
    assert len(cramped.position) == 10_000


def test_messages_that_alternate_keep_their_places(batches):
    """Two publishers on one topic."""
    (times, first), (later, second) = batches
    mixed = [body for pair in zip(first, second, strict=True) for body in pair]
    _, joints = gathered([([*times, *later], mixed)])
    np.testing.assert_array_equal(joints.position[::2, 0], np.arange(5000))
    np.testing.assert_array_equal(joints.position[1::2, 0], np.arange(5000, 10_000))


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_messages_of_a_file_are_those_that_were_written(tmp_path, chunked, compression):
    path, written = tmp_path / "log.mcap", []
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=5000, compression=compression, use_chunking=chunked)
        writer.start("ros2")
        channels = {}
        for topic, kind in (("/a", "x/msg/A"), ("/b", "x/msg/B")):
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
        for k in range(2000):
            key = ("/a", "x/msg/A") if k % 3 else ("/b", "x/msg/B")
            written.append((*key, EPOCH + k, bytes([k % 251]) * (k % 40)))
            writer.add_message(channels[key], EPOCH + k, written[-1][3], EPOCH + k)
        writer.finish()
    assert MessageReader(path).messages() == written
