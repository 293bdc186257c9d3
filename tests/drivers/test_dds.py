"""DDS on loopback: what is sent arrives, raw samples are the type's own bytes, and no unproven version meets a robot."""

import hashlib
import time

import pytest
from emulator_processes import unused_domain

pytest.importorskip("cyclonedds")

from cyclonedds.idl import IdlStruct

from equipoise.drivers.dds.domain import DdsDomain, RawSample, configuration, raw
from equipoise.drivers.ros2 import ros_messages as ros2_messages
from equipoise.drivers.unitree import dds_types as unitree_messages
from equipoise.drivers.unitree.dds_types import Request, RequestHeader, RequestIdentity, RequestLease, RequestPolicy
from equipoise.errors import CommunicationError, SettingsError

DOMAIN, ANOTHER = unused_domain(), unused_domain()
REQUEST = Request(RequestHeader(RequestIdentity(7, 1001), RequestLease(0), RequestPolicy(0, False)), "{}", [1, 2])


@pytest.fixture
def domain():
    opened = DdsDomain(DOMAIN, "lo")
    yield opened
    opened.close()


def arrivals(inbox, count=1, patience=5.0):
    """The next samples; waits for them."""
    until, arrived = time.monotonic() + patience, []
    while len(arrived) < count and time.monotonic() < until:
        arrived += inbox.take()
        time.sleep(1e-3)
    return arrived


def test_samples_arrive_in_order_with_the_time_of_their_arrival(domain):
    inbox, outbox = domain.inbox("order", Request), domain.outbox("order", Request)
    before = time.monotonic()
    for number in range(5):
        header = RequestHeader(RequestIdentity(number, 1001), RequestLease(0), RequestPolicy(0, False))
        outbox.send(Request(header, "", []))
        time.sleep(2e-3)
    arrived = arrivals(inbox, 5)
    assert [sample.header.identity.id for _, sample in arrived] == [0, 1, 2, 3, 4]
    times = [received for received, _ in arrived]
    assert before < times[0] < times[-1] < time.monotonic()
    assert times == sorted(times)
    assert inbox.take() == []


def test_raw_samples_are_the_types_own_bytes_and_are_understood_by_who_does_not_know_of_them(domain):
    raw_request = raw(Request)
    assert not issubclass(raw_request, IdlStruct)
    assert issubclass(raw_request, RawSample)
    outbox, inbox = domain.outbox("to_type", raw_request), domain.inbox("to_type", Request)
    outbox.send(raw_request(bytearray(REQUEST.serialize())))
    [(_, sample)] = arrivals(inbox)
    assert sample.serialize() == REQUEST.serialize()
    outbox, inbox = domain.outbox("to_raw", Request), domain.inbox("to_raw", raw_request)
    outbox.send(REQUEST)
    [(_, sample)] = arrivals(inbox)
    assert bytes(sample.data[:4]) == b"\x00\x01\x00\x00"
    unpadded = REQUEST.serialize()
    assert bytes(sample.data)[: len(unpadded)] == unpadded


def test_an_outbox_counts_readers_and_an_inbox_counts_writers(domain):
    outbox = domain.outbox("counted", Request)
    assert not outbox.readers
    assert not domain.inbox("other", Request).writers
    inbox = domain.inbox("counted", Request)
    until = time.monotonic() + 5
    while not (outbox.readers and inbox.writers) and time.monotonic() < until:
        time.sleep(1e-3)
    assert outbox.readers
    assert inbox.writers
    inbox.close()
    assert not inbox.writers


@pytest.mark.parametrize(
    ("messages", "digest"),
    [
        (unitree_messages, "27309d56bd061613"),
        (ros2_messages, "e1891ed1afda1864"),
    ],
)
def test_types_are_announced_to_the_byte_alike_by_all_versions(messages, digest):
    """Announced types of 0.10.2, 0.10.5 and 11.0.1; an unsupported type ends a process of 0.10 with a segmentation fault."""
    types = [kind for kind in vars(messages).values() if isinstance(kind, type) and issubclass(kind, IdlStruct)]
    announced = hashlib.sha256()
    for kind in sorted(set(types) - {IdlStruct}, key=lambda kind: kind.__name__):
        kind.__idl__.fill_type_data()
        announced.update(b"".join(kind.__idl__._xt_bytedata))
    assert announced.hexdigest()[:16] == digest


def test_a_domain_is_open_once_a_process_and_can_be_opened_again():
    first = DdsDomain(ANOTHER, "lo")
    outbox = first.outbox("again", Request)
    with pytest.raises(CommunicationError, match=f"domain {ANOTHER} on lo cannot be opened .* open in this process"):
        DdsDomain(ANOTHER, "lo")
    first.close()
    first.close()
    with pytest.raises(CommunicationError, match="again is closed; open the connection again"):
        outbox.send(REQUEST)
    second = DdsDomain(ANOTHER, "lo")
    inbox, outbox = second.inbox("again", Request), second.outbox("again", Request)
    outbox.send(REQUEST)
    assert len(arrivals(inbox)) == 1
    second.close()


def test_an_interface_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(SettingsError, match=r"network interface 'nowhere7' does not exist; choose from .*lo"):
        DdsDomain(DOMAIN, "nowhere7")


def test_beyond_loopback_the_version_is_checked_before_anything_is_sent(monkeypatch):
    monkeypatch.setattr("equipoise.drivers.dds.cyclone.VERSION", "11.0.1")
    monkeypatch.setattr("socket.if_nameindex", lambda: [(1, "lo"), (2, "eth7")])
    monkeypatch.setattr("equipoise.drivers.dds.cyclone.Domain", lambda *_: pytest.fail("the domain was opened"))
    with pytest.raises(SettingsError, match=r"cyclonedds 11\.0\.1 is not proven"):
        DdsDomain(0, "eth7")


def test_only_loopback_goes_without_multicast():
    assert "<AllowMulticast>false" in configuration("lo", (), "notes")
    assert 'address="localhost"' in configuration("lo", (), "notes")
    assert "AllowMulticast" not in configuration("eth0", (), "notes")
    assert configuration("eth0", ("10.0.0.7",), "notes").count("<Peer ") == 1
    assert 'address="10.0.0.7"' in configuration("eth0", ("10.0.0.7",), "notes")


@pytest.mark.parametrize(
    ("peer", "message"),
    [
        ("no-such-robot.invalid", "has no IPv4 address"),
        ("", "has no IPv4 address"),
        ("300.1.1.1", "has no IPv4 address"),
        ("::1", "the port of '::1' is not a number from 1 to 65535"),
        ("127.0.0.1:70000", "the port of '127.0.0.1:70000' is not a number from 1 to 65535"),
        ("0.0.0.0", "is not the address of one computer"),
        ("255.255.255.255", "is not the address of one computer"),
    ],
)
def test_a_peer_that_cannot_be_looked_for_is_refused_before_cyclonedds_ends_the_process(peer, message):
    with pytest.raises(SettingsError, match=message):
        DdsDomain(ANOTHER, "lo", (peer,))


def test_a_peer_may_have_a_port():
    DdsDomain(ANOTHER, "lo", ("localhost:7411", "127.0.0.1")).close()
