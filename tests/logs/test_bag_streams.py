"""Topics that are read a batch at a time are what they are as a whole, whatever changes in between."""

import numpy as np
import pytest
from foreign_logs import EPOCH, store
from mcap.writer import CompressionType, Writer

from equipoise.logs.bag_streams import GatheredTopic
from equipoise.logs.message_types import JOINT_STATE, known_types
from equipoise.logs.rosbag import runs_of
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


def gathered(batches):
    """A topic of batches of (times, bodies), each long enough to be read by itself."""
    topic = GatheredTopic("/joint_states", JOINT_STATE, known_types())
    for times, bodies in batches:
        topic.take(np.array(times), np.array([np.frombuffer(body, np.uint8) for body in bodies]))
    return topic.stream()


@pytest.fixture(scope="module")
def batches():
    """5,000 messages of two joints, then as many of three in another order that have velocities too."""
    first = [message(k, ("a", "b"), (k, -k)) for k in range(5000)]
    second = [message(k, ("c", "b", "a"), (1, -k, k), (7, 8, 9)) for k in range(5000, 10_000)]
    return [(range(5000), first), (range(5000, 10_000), second)]


def test_joints_and_velocities_that_come_later_are_no_numbers_before(batches):
    stream = gathered(batches)
    assert stream.joints.names == ("a", "b", "c")
    np.testing.assert_array_equal(stream.joints.position[:, 0], np.arange(10_000))
    np.testing.assert_array_equal(stream.joints.position[:, 1], -np.arange(10_000))
    assert np.isnan(stream.joints.position[:5000, 2]).all()
    assert np.isnan(stream.joints.velocity[:5000]).all()
    assert (stream.joints.velocity[5000:] == [9, 8, 7]).all()
    assert stream.joints.torque is None
    np.testing.assert_array_equal(stream.clock.header, np.arange(10_000))


def test_messages_are_put_in_order_of_receipt(batches):
    """As a recorder with several threads writes them."""
    (times, bodies), _ = batches
    turned = gathered([(list(reversed(times)), list(reversed(bodies)))])
    np.testing.assert_array_equal(turned.clock.received, np.arange(5000))
    np.testing.assert_array_equal(turned.joints.position[:, 0], np.arange(5000))


def test_a_topic_has_more_messages_than_room(batches, monkeypatch):
    whole = gathered(batches * 3)
    monkeypatch.setattr("equipoise.logs.bag_streams._ROOM", 3000)
    cramped = gathered(batches * 3)
    np.testing.assert_array_equal(whole.joints.position, cramped.joints.position)
    assert len(whole.joints.position) == 30_000


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


@pytest.mark.parametrize("turn", ["JII", "JJI", "JIJ"])
def test_messages_of_a_topic_keep_their_order_whatever_their_turns_and_times(tmp_path, turn):
    """Topics of different rates, lengths that alternate, and times of receipt that are the same for many."""
    path, written = tmp_path / "log.mcap", {"/J": [], "/I": []}
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2")
        schema = writer.register_schema("x/msg/A", "ros2msg", b"")
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in written}
        for k in range(300):
            topic = f"/{turn[k % 3]}"
            written[topic].append(k.to_bytes(2, "little") + bytes(k % 2 * 4))
            writer.add_message(channels[topic], EPOCH + k // 50, written[topic][-1], EPOCH + k // 50)
        writer.finish()
    read = {"/J": [], "/I": []}
    for topic, _, bodies in runs_of(MessageReader(path).chunks(), dict.fromkeys(read, "x/msg/A")):
        read[topic] += [bytes(body) for body in bodies]
    assert read == written
