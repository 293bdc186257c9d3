"""DDS as in Unitree's newer robots and ROS 2: one domain on one interface, and topics whose samples may be bytes."""

from __future__ import annotations

import dataclasses
import functools
import socket
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from equipoise.drivers.dds import cyclone
from equipoise.drivers.dds.versions import DiscoveryNotes, check_other_versions, check_version
from equipoise.errors import CommunicationError, SettingsError

LOOPBACK = "lo"
_PEER = "give the robot's address, as in peers=192.168.123.18, or a host name that this computer knows"
_NO_HOST = ("0.0.0.0", "255.255.255.255")
_MEETING = 0.3  # [s] in which others on the domain have answered; on loopback they take 10 ms

# A best-effort reader matches any offer of a robot; a reliable writer of the plain encoding any of its requests.
_PLAIN = cyclone.Policy.DataRepresentation(use_cdrv0_representation=True)
_READING: Any = cyclone.Policy.Reliability.BestEffort  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
_OTHERS: Any = cyclone.Policy.IgnoreLocal.Participant  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
_WRITING = cyclone.Policy.Reliability.Reliable(max_blocking_time=cyclone.duration(milliseconds=1))
_KEPT = 64  # newest samples kept until they are taken: a flood of samples must not delay a control loop
_FLOOD, _REST = 8, 1e-3  # samples at once after which a listening thread rests, and its rest [s]
_MOST_WRITERS = 1000  # on a domain
_PATIENCE = 0.1  # [s] after which a waiting thread checks whether it should end


class RawSample:
    """Sample as bytes: four bytes that identify the encoding, then the type's CDR encoding.

    cyclonedds decodes a robot's state in 0.4 ms, a large share of a control period; struct takes microseconds.

    Attributes:
        data: data from an inbox, or for an outbox.
        sample_info: metadata of a received sample, from cyclonedds.
    """

    sample_info: Any = None

    def __init__(self, data: bytes | bytearray) -> None:
        self.data = data

    def serialize(self, *_: object, **__: object) -> bytes | bytearray:
        return self.data

    @classmethod
    def deserialize(cls, data: bytes, *_: object, **__: object) -> RawSample:
        return cls(data)

    deserialize_key = deserialize


def raw(message_type: Any) -> type[RawSample]:
    """Return a type that is the same on the wire and in discovery, but with `RawSample` samples."""
    return type(message_type.__name__, (RawSample,), {"__idl__": message_type.__idl__})


def message_types(definitions: Mapping[str, str]) -> tuple[Any, ...]:
    """Create the DDS types of messages, in the order of their definitions; fields are zero or empty by default.

    Args:
        definitions: fields by "package/Name", in ROS syntax but with commas, as in "float64 x, uint8[3] reserve"; a
            message follows those that it contains.
    """
    made: dict[str, Any] = {}
    for full_name, definition in definitions.items():
        package, name = full_name.split("/")
        types = {field: _field_type(kind, made) for kind, field in (each.split() for each in definition.split(", "))}
        message = cyclone.make_idl_struct(name, f"{package}.msg.dds_.{name}_", types, dataclassify=False)
        for field, kind in types.items():
            setattr(message, field, dataclasses.field(default_factory=functools.partial(_zero, kind)))
        made[full_name] = dataclasses.dataclass(message)
    return tuple(made.values())


def _field_type(text: str, made: Mapping[str, Any]) -> Any:
    name, brackets, count = text.rstrip("]").partition("[")
    kind = cyclone.FIELD_TYPES[name] if name in cyclone.FIELD_TYPES else made[name]
    if not brackets:
        return kind
    return cyclone.array[kind, int(count)] if count else cyclone.sequence[kind]


def _zero(kind: Any) -> Any:
    """Return the zero of a field's type: a number, an empty text or sequence, or a message or an array of zeros."""
    [kind] = getattr(kind, "__metadata__", (kind,))
    if isinstance(kind, type):
        return kind()
    return 0 if isinstance(kind, str) else [_zero(kind.subtype) for _ in range(getattr(kind, "length", 0))]


class Inbox:
    """Received samples of a topic with their times of arrival, recorded by a thread. Created by `DdsDomain.inbox`.

    Attributes:
        writers: number of matched writers on the topic.
    """

    def __init__(self, participant: Any, topic: str, sample_type: Any, notes: DiscoveryNotes, own: bool) -> None:
        qos = cyclone.Qos(_READING, _PLAIN, cyclone.Policy.History.KeepLast(_KEPT))
        if not own:
            qos = qos + cyclone.Qos(_OTHERS)
        self.writers = 0
        self._participant, self._topic, self._notes = participant, topic, notes
        listener: Any = cyclone.Listener(on_subscription_matched=self._match)
        self._reader: Any = cyclone.DataReader(
            participant, cyclone.Topic(participant, topic, sample_type), qos, listener
        )
        self._waiting: Any = cyclone.WaitSet(participant)
        unread = cyclone.ViewState.Any | cyclone.InstanceState.Any | cyclone.SampleState.NotRead
        self._waiting.attach(cyclone.ReadCondition(self._reader, unread))
        self._arrived: deque[tuple[float, Any]] = deque(maxlen=_KEPT)
        self._collecting = threading.Lock()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._listen, name=f"inbox {topic}", daemon=True)
        self._thread.start()

    def take(self) -> list[tuple[float, Any]]:
        """Return (time of arrival on the monotonic clock [s], sample) since the last call, in order; never wait."""
        if not self._arrived and self._reader is not None:
            self._collect(self._reader)  # the thread may not have run yet
        arrived: list[tuple[float, Any]] = []
        while self._arrived:
            arrived.append(self._arrived.popleft())
        return arrived

    def names_of_writers(self) -> dict[int, str]:
        """Return the names of the processes that write on the topic, by their handles in samples."""
        reader: Any = cyclone.BuiltinDataReader(self._participant, cyclone.BuiltinTopicDcpsPublication)
        return {
            writer.sample_info.instance_handle: self._notes.name_of(writer.participant_key)
            for writer in reader.read(_MOST_WRITERS)
            if writer.topic_name == self._topic
        }

    def name_of_writer(self, sample: Any) -> str:
        """Return the name of the process that wrote a sample, if DDS has it."""
        return self.names_of_writers().get(sample.sample_info.publication_handle, "a process that has left")

    def close(self) -> None:
        """Stop listening; may be called twice."""
        self._closed.set()
        self._thread.join(timeout=10 * _PATIENCE)
        self._reader = self._waiting = None
        self.writers = 0

    def _listen(self) -> None:
        reader, waiting = self._reader, self._waiting
        patience = cyclone.duration(seconds=_PATIENCE)
        while not self._closed.is_set():
            if waiting.wait(patience) and self._collect(reader) > _FLOOD:
                time.sleep(_REST)

    def _match(self, _: Any, status: Any) -> None:
        self.writers = int(status.current_count)

    def _collect(self, reader: Any) -> int:
        received = time.monotonic()
        with self._collecting:
            samples = reader.take(_KEPT)
            for sample in samples:
                if sample.sample_info.valid_data:
                    self._arrived.append((received, sample))
        return len(samples)


class Outbox:
    """Sent samples of a topic; only the newest is kept. Created by `DdsDomain.outbox`.

    Attributes:
        readers: number of readers on the topic.
    """

    def __init__(self, participant: Any, topic: str, sample_type: Any) -> None:
        self._topic = topic
        self.readers = 0
        qos = cyclone.Qos(_WRITING, _PLAIN, cyclone.Policy.History.KeepLast(1))
        listener: Any = cyclone.Listener(on_publication_matched=self._match)
        self._writer: Any = cyclone.DataWriter(
            participant, cyclone.Topic(participant, topic, sample_type), qos, listener
        )

    def send(self, sample: Any) -> None:
        """Write a sample of the topic's type.

        Raises:
            CommunicationError: DDS rejects it.
        """
        if self._writer is None:
            raise CommunicationError(f"{self._topic} is closed; open the connection again")
        try:
            self._writer.write(sample)
        except cyclone.DDSException as error:
            raise CommunicationError(f"{self._topic}: the network rejects the sample ({error})") from error

    def close(self) -> None:
        """Stop sending; may be called twice."""
        self._writer = None

    def _match(self, _: Any, status: Any) -> None:
        self.readers = int(status.current_count)


class DdsDomain:
    """One DDS domain on one network interface.

    Args:
        domain: number of the domain.
        interface: name of the network interface, as "eth0"; on "lo" nothing leaves this computer, and discovery works
            without multicast.
        peers: addresses for discovery, in addition to multicast.
        accept_cyclonedds: version of cyclonedds to use although robots, or others on the domain, run another.

    Raises:
        SettingsError: the interface does not exist, a peer has no address, or the version may crash others and was not
            accepted by name.
        CommunicationError: the domain cannot be opened.

    Attributes:
        where: the domain in words, as in "domain 0 on eth0".
    """

    def __init__(self, domain: int, interface: str, peers: tuple[str, ...] = (), accept_cyclonedds: str = "") -> None:
        _check_interface(interface)
        _check_peers(peers)
        if interface != LOOPBACK:
            check_version(cyclone.VERSION, accept_cyclonedds)
        self.where, self._accepted = f"domain {domain} on {interface}", accept_cyclonedds
        self._boxes: list[Inbox | Outbox] = []
        self._domain: Any = None
        self._participant: Any = None
        self._notes = DiscoveryNotes()
        try:
            self._join(domain, configuration(interface, peers, self._notes.path))
            time.sleep(_MEETING)
            self.check_versions()  # before a topic is announced, which crashes others
        except BaseException:
            self.close()
            raise

    def check_versions(self) -> None:
        """Raise SettingsError if a process on the domain has a version that is unsafe together with this one."""
        check_other_versions(cyclone.VERSION, self._accepted, self._notes.processes(), self.where)

    def _join(self, domain: int, settings: str) -> None:
        try:
            self._domain = cyclone.Domain(domain, settings)
            self._participant = cyclone.DomainParticipant(domain)
        except cyclone.DDSException as error:
            raise CommunicationError(
                f"DDS {self.where} cannot be opened ({error}): is the interface up, or the domain open in "
                "this process already?"
            ) from error

    def inbox(self, topic: str, sample_type: Any, own: bool = True) -> Inbox:
        """Subscribe to a topic with samples of an IDL type or its `raw` type.

        Args:
            topic: name of the topic.
            sample_type: type of its samples.
            own: whether samples of this domain's own outboxes arrive too.
        """
        inbox = Inbox(self._participant, topic, sample_type, self._notes, own)
        self._boxes.append(inbox)
        return inbox

    def outbox(self, topic: str, sample_type: Any) -> Outbox:
        """Publish a topic with samples of an IDL type or its `raw` type."""
        outbox = Outbox(self._participant, topic, sample_type)
        self._boxes.append(outbox)
        return outbox

    def close(self) -> None:
        """Leave the domain, close all inboxes and outboxes; may be called twice."""
        while self._boxes:
            self._boxes.pop().close()
        self._participant = self._domain = None
        self._notes.close()


def configuration(interface: str, peers: tuple[str, ...], notes: str) -> str:
    """Return the XML configuration of Cyclone DDS for one interface and a file for its discovery log."""
    on_loopback = interface == LOOPBACK
    found = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in (*peers, *(["localhost"] if on_loopback else [])))
    return (
        "<CycloneDDS><Domain Id='any'><General>"
        f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>"
        f"{'<AllowMulticast>false</AllowMulticast>' if on_loopback else ''}</General>"
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers>{found}</Peers></Discovery>"
        f"<Tracing><Category>discovery</Category><OutputFile>{escape(notes)}</OutputFile></Tracing></Domain></CycloneDDS>"
    )


def _check_interface(interface: str) -> None:
    names = [name for _, name in socket.if_nameindex()]
    if interface not in names:
        raise SettingsError(f"network interface {interface!r} does not exist; choose from {', '.join(names)}")


def _check_peers(peers: tuple[str, ...]) -> None:
    """Raise SettingsError for invalid peers: Cyclone DDS would end the process."""
    for peer in peers:
        host, colon, port = peer.partition(":")
        if colon and not (port.isascii() and port.isdigit() and 0 < int(port) < 2**16):
            raise SettingsError(f"peers: the port of {peer!r} is not a number from 1 to 65535")
        try:
            found = socket.getaddrinfo(host, None, socket.AF_INET)
        except (OSError, UnicodeError) as error:
            raise SettingsError(f"peers: {peer!r} has no IPv4 address ({error}); {_PEER}") from error
        if any(address[0] in _NO_HOST for *_, address in found):
            raise SettingsError(f"peers: {peer!r} is not the address of one computer; {_PEER}")
