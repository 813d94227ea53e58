"""Links: what each discipline promises, over real sockets and over virtual time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.service.links import (
    MAXIMUM_PAYLOAD_BYTES,
    LatestReader,
    LatestSender,
    Link,
    LinkClosed,
    LinkError,
    LinkFull,
    OrderedReader,
    OrderedSender,
    SocketLink,
    VirtualLink,
    socket_links,
)
from drivers.clock import VirtualClock


def real() -> tuple[Link, Link]:
    return socket_links(buffer_bytes=8192)


def virtual() -> tuple[Link, Link]:
    link = VirtualLink(VirtualClock(), VirtualClock(), capacity=8)
    return link, link


def fill(sender: OrderedSender) -> int:
    for number in range(1000):
        try:
            sender.send(b"%d" % number, sample_ns=number, kind=7)
        except LinkFull:
            return number
    raise AssertionError("the link never became full")


both = pytest.mark.parametrize("make", [real, virtual])
Make = Callable[[], tuple[Link, Link]]


@both
def test_the_latest_value_is_kept_with_its_age(make: Make) -> None:
    """A reader that comes late gets the newest value only, and again until a newer one comes."""
    here, there = make()
    sender, reader = LatestSender(here), LatestReader(there)
    assert reader.newest() is None
    assert reader.age_ns(5) is None
    for number in range(4):
        sender.send(b"value %d" % number, sample_ns=1000 + number)
    assert reader.newest() == (b"value 3", 1003)
    assert reader.newest() == (b"value 3", 1003)
    assert reader.age_ns(1500) == 497
    assert reader.missed == 0


@both
def test_a_recorder_gets_every_value(make: Make) -> None:
    """A reader slower than its sender can still have all that the link held, each once."""
    here, there = make()
    sender, reader = LatestSender(here), LatestReader(there)
    for number in range(4):
        sender.send(b"%d" % number, sample_ns=number)
    assert reader.new_values() == [(b"%d" % number, number) for number in range(4)]
    assert reader.new_values() == []
    assert reader.newest() == (b"3", 3)


@both
def test_a_full_latest_link_drops_and_counts(make: Make) -> None:
    """A stuck reader neither stops its sender nor loses the count of what went missing."""
    here, there = make()
    sender, reader = LatestSender(here), LatestReader(there)
    sent = sum(sender.send(bytes(200), sample_ns=number) for number in range(100))
    assert 0 < sent < 100
    assert sender.dropped == 100 - sent
    newest = reader.newest()
    assert newest is not None
    assert newest[1] == sent - 1
    assert sender.send(b"", sample_ns=100)
    assert reader.newest() == (b"", 100)
    assert reader.missed == sender.dropped


@both
def test_a_full_ordered_link_refuses_and_nothing_vanishes(make: Make) -> None:
    """What was refused was not half sent: after the reader has read, the same message follows without a gap."""
    here, there = make()
    sender, reader = OrderedSender(here), OrderedReader(there)
    accepted = fill(sender)
    for number in range(accepted):
        message = reader.receive()
        assert message is not None
        assert message == (7, number, number, b"%d" % number, ())
    assert reader.receive() is None
    assert sender.send(b"again", sample_ns=0) == accepted
    message = reader.receive()
    assert message is not None
    assert message.payload == b"again"


@both
def test_a_gap_in_an_ordered_link_is_an_error(make: Make) -> None:
    """A lost command is never passed over in silence."""
    here, there = make()
    sender, reader = OrderedSender(here), OrderedReader(there)
    sender.send(b"one", sample_ns=0)
    assert there.take() is not None  # vanishes behind the reader's back
    sender.send(b"two", sample_ns=0)
    with pytest.raises(LinkError, match=r"sequence number 1 .* expected 0"):
        reader.receive()


@both
def test_another_schema_or_kind_is_refused(make: Make) -> None:
    """Processes of two installations do not misread each other."""
    here, there = make()
    LatestSender(here, schema=1, kind=3).send(b"", sample_ns=0)
    with pytest.raises(LinkError, match=r"schema and kind \(1, 3\) .* expected \(2, 3\)"):
        LatestReader(there, schema=2, kind=3).newest()
    OrderedSender(here, schema=1).send(b"", sample_ns=0)
    with pytest.raises(LinkError, match=r"schema 1 .* expected 2"):
        OrderedReader(there, schema=2).receive()


@both
@given(data=st.binary(max_size=40))
def test_foreign_bytes_give_a_clear_error(make: Make, data: bytes) -> None:
    """Whatever comes over a link, the reader returns a message or says what is wrong."""
    here, there = make()
    if data:  # an empty packet is end-of-file to the kernel
        here.put(data)
    with suppress(LinkError):
        message = OrderedReader(there).receive()
        assert (message is None) == (not data)
    here.close()
    there.close()


@both
def test_an_oversized_payload_is_refused(make: Make) -> None:
    """A payload that the reader could not take whole is not sent."""
    here, _ = make()
    with pytest.raises(LinkError, match=str(MAXIMUM_PAYLOAD_BYTES)):
        OrderedSender(here).send(bytes(MAXIMUM_PAYLOAD_BYTES + 1), sample_ns=0)


def test_a_dead_peer_shows_at_once_and_its_last_words_are_heard() -> None:
    """End-of-file is seen without waiting, and messages sent before it are still received."""
    here, there = socket_links()
    OrderedSender(there).send(b"never read", sample_ns=0)  # makes the kernel report a reset first
    sender, reader = OrderedSender(here), OrderedReader(there)
    sender.send(b"last words", sample_ns=5)
    assert not reader.closed
    here.close()
    assert reader.closed
    message = reader.receive()
    assert message is not None
    assert message.payload == b"last words"
    assert reader.receive() is None
    with pytest.raises(LinkClosed):
        OrderedSender(there).send(b"to nobody", sample_ns=0)
    publisher = LatestSender(there)
    assert publisher.send(b"to nobody", sample_ns=0) is False
    assert publisher.closed


def test_a_descriptor_passes_to_another_process() -> None:
    """A memory file written here is read there, and the child's end of the link shows its death."""
    here, there = socket_links()
    memory = os.memfd_create("table")
    os.write(memory, b"coefficients")
    child = (
        "import os, sys; from controller.service.links import *\n"
        "link = SocketLink.from_fileno(int(sys.argv[1]))\n"
        "message = OrderedReader(link).receive()\n"
        "text = os.pread(message.descriptors[0], 100, 0)\n"
        "OrderedSender(link).send(message.payload + b': ' + text, sample_ns=message.sample_ns + 1)\n"
    )
    OrderedSender(here).send_fds(b"table 3", [memory], sample_ns=41)
    process = subprocess.Popen(
        [sys.executable, "-c", child, str(there.fileno())],
        pass_fds=[there.fileno()],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    there.close()
    assert process.wait(timeout=30) == 0
    reader = OrderedReader(here)
    answer = reader.receive()
    assert answer is not None
    assert (answer.payload, answer.sample_ns) == (b"table 3: coefficients", 42)
    assert reader.closed


def test_virtual_descriptors_are_duplicated_as_real_ones_are() -> None:
    """The sender may close its descriptor at once; the receiver owns its own."""
    link = VirtualLink(VirtualClock(), VirtualClock())
    memory = os.memfd_create("table")
    OrderedSender(link).send_fds(b"", [memory], sample_ns=0)
    os.close(memory)
    message = OrderedReader(link).receive()
    assert message is not None
    os.fstat(message.descriptors[0])
    os.close(message.descriptors[0])


def test_a_virtual_message_is_visible_from_the_moment_it_was_sent() -> None:
    """A part whose clock is behind its sender's does not see into the future."""
    cycle, hand = VirtualClock(), VirtualClock()
    link = VirtualLink(cycle, hand)
    sender, reader = OrderedSender(link), OrderedReader(link)
    cycle.advance_to_ns(2_000_000)
    sender.send(b"wind", sample_ns=2_000_000)
    hand.advance_to_ns(1_999_999)
    assert reader.receive() is None
    assert hand.wait_readable(link, deadline_ns=3_000_000)
    assert hand.now_ns() == 2_000_000
    message = reader.receive()
    assert message is not None
    assert message.payload == b"wind"


def test_only_seqpacket_sockets_make_a_link() -> None:
    """A wrong descriptor from the parent process is named, not read from."""
    with open(os.devnull, "rb") as file, pytest.raises(LinkError, match="not a socket"):
        SocketLink.from_fileno(file.fileno())
