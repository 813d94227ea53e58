"""Links between the processes: whole messages, non-blocking, with the time of the sample (design 2).

Two disciplines over a transport of `link_transport.py`:

* *latest value* (state, set-points): the reader keeps the newest message and its age; a full link drops and counts;
* *ordered* (commands, events, acknowledgements): sequence numbers without a gap; a full link refuses to the sender.

Packet: header {schema u16, kind u16, sequence u32, sample_ns i64}, little-endian, then the payload, opaque here.
`sample_ns` is the monotonic time, in nanoseconds, at which the thing reported was so; not the time of sending.
Source: design 2; real-time-python reference 4d.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from typing import NamedTuple

from controller.service.link_transport import (
    MAXIMUM_DESCRIPTORS,
    MAXIMUM_PACKET_BYTES,
    Link,
    LinkClosed,
    LinkError,
    LinkFull,
    SocketLink,
    VirtualLink,
    socket_links,
)

__all__ = [
    "MAXIMUM_DESCRIPTORS",
    "MAXIMUM_PAYLOAD_BYTES",
    "SCHEMA",
    "LatestReader",
    "LatestSender",
    "Link",
    "LinkClosed",
    "LinkError",
    "LinkFull",
    "Message",
    "OrderedReader",
    "OrderedSender",
    "SocketLink",
    "VirtualLink",
    "socket_links",
]

SCHEMA = 1
"""Version of the message layouts; both ends of a link must agree."""

_HEADER = struct.Struct("<HHIq")
MAXIMUM_PAYLOAD_BYTES = MAXIMUM_PACKET_BYTES - _HEADER.size


class Message(NamedTuple):
    """One message of an ordered link. `descriptors` belong to the receiver, who closes them."""

    kind: int
    sequence: int
    sample_ns: int
    payload: bytes
    descriptors: tuple[int, ...] = ()


class LatestSender:
    """Sends values of which only the newest matters; a full link loses the value and counts it."""

    def __init__(self, link: Link, *, kind: int = 0, schema: int = SCHEMA) -> None:
        self.link = link
        self.dropped = 0
        self._kind = kind
        self._schema = schema
        self._sequence = 0

    @property
    def closed(self) -> bool:
        """True as soon as the reader has gone."""
        return self.link.closed

    def send(self, payload: bytes, sample_ns: int) -> bool:
        """Offer the value of monotonic time `sample_ns`; False if it was dropped (full, or the reader has gone)."""
        try:
            sent = self.link.put(_packed(self._schema, self._kind, self._sequence, sample_ns, payload))
        except LinkClosed:
            sent = False  # `closed` says so; a publisher does not fail with its reader
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        self.dropped += not sent
        return sent


class LatestReader:
    """Keeps the newest value. `missed` counts the values that a full link dropped."""

    def __init__(self, link: Link, *, kind: int = 0, schema: int = SCHEMA) -> None:
        self.link = link
        self.missed = 0
        self._kind = kind
        self._schema = schema
        self._next_sequence = 0
        self._newest: tuple[bytes, int] | None = None

    @property
    def closed(self) -> bool:
        """True as soon as the sender has gone; `newest()` still gives its last value."""
        return self.link.closed

    def newest(self) -> tuple[bytes, int] | None:
        """(payload, sample_ns) of the newest value that has arrived, seen before or not; None before the first.

        Raises `LinkError` if the sender speaks another schema or sends another kind of message.
        """
        self.new_values()
        return self._newest

    def new_values(self) -> list[tuple[bytes, int]]:
        """Every (payload, sample_ns) that has arrived since the last call, oldest first: what a recorder wants.

        Raises `LinkError` as `newest` does.
        """
        values: list[tuple[bytes, int]] = []
        while (packet := self.link.take()) is not None:
            for descriptor in packet.descriptors:
                os.close(descriptor)
            schema, kind, sequence, sample_ns = _header(packet.data)
            if schema != self._schema or kind != self._kind:
                raise _mismatch("schema and kind", (schema, kind), (self._schema, self._kind))
            self.missed += (sequence - self._next_sequence) & 0xFFFFFFFF
            self._next_sequence = (sequence + 1) & 0xFFFFFFFF
            values.append((packet.data[_HEADER.size :], sample_ns))
        if values:
            self._newest = values[-1]
        return values

    def age_ns(self, now_ns: int) -> int | None:
        """Age of the newest value's sample at `now_ns`, ns; None before the first. Call `newest()` first."""
        return None if self._newest is None else now_ns - self._newest[1]


class OrderedSender:
    """Sends messages of which every one matters."""

    def __init__(self, link: Link, *, schema: int = SCHEMA) -> None:
        self.link = link
        self._schema = schema
        self._sequence = 0

    @property
    def closed(self) -> bool:
        """True as soon as the reader has gone."""
        return self.link.closed

    def send(self, payload: bytes, sample_ns: int, kind: int = 0) -> int:
        """Send one message and return its sequence number. Raises `LinkFull` (nothing was sent) and `LinkClosed`."""
        return self.send_fds(payload, (), sample_ns, kind)

    def send_fds(self, payload: bytes, descriptors: Sequence[int], sample_ns: int, kind: int = 0) -> int:
        """As `send`, with up to four file descriptors; they are duplicated, the caller keeps its own."""
        if len(descriptors) > MAXIMUM_DESCRIPTORS:
            raise LinkError(f"{len(descriptors)} descriptors in one message; a link takes {MAXIMUM_DESCRIPTORS}.")
        sequence = self._sequence
        if not self.link.put(_packed(self._schema, kind, sequence, sample_ns, payload), descriptors):
            raise LinkFull(
                f"The link is full; message {sequence} of kind {kind} was not sent.",
                help="Its reader is stuck or slower than its sender.",
            )
        self._sequence = (sequence + 1) & 0xFFFFFFFF
        return sequence


class OrderedReader:
    """Receives every message of an `OrderedSender`, in order."""

    def __init__(self, link: Link, *, schema: int = SCHEMA) -> None:
        self.link = link
        self._schema = schema
        self._next_sequence = 0

    @property
    def closed(self) -> bool:
        """True as soon as the sender has gone; messages it sent before can still be received."""
        return self.link.closed

    def receive(self) -> Message | None:
        """The next message, or None if none has arrived. Raises `LinkError` on a gap or another schema."""
        packet = self.link.take()
        if packet is None:
            return None
        try:
            schema, kind, sequence, sample_ns = _header(packet.data)
            if schema != self._schema:
                raise _mismatch("schema", schema, self._schema)
            if sequence != self._next_sequence:
                raise _mismatch("sequence number", sequence, self._next_sequence)
        except LinkError:
            for descriptor in packet.descriptors:
                os.close(descriptor)
            raise
        self._next_sequence = (sequence + 1) & 0xFFFFFFFF
        return Message(kind, sequence, sample_ns, packet.data[_HEADER.size :], packet.descriptors)


def _packed(schema: int, kind: int, sequence: int, sample_ns: int, payload: bytes) -> bytes:
    if len(payload) > MAXIMUM_PAYLOAD_BYTES:
        raise LinkError(f"A payload of {len(payload)} bytes; a link takes {MAXIMUM_PAYLOAD_BYTES}.")
    return _HEADER.pack(schema, kind, sequence, sample_ns) + payload


def _header(data: bytes) -> tuple[int, int, int, int]:
    if len(data) < _HEADER.size:
        raise LinkError(f"A packet of {len(data)} bytes; its header alone has {_HEADER.size}.")
    schema, kind, sequence, sample_ns = _HEADER.unpack_from(data)
    return schema, kind, sequence, sample_ns


def _mismatch(what: str, received: object, expected: object) -> LinkError:
    return LinkError(
        f"A message with {what} {received} came over a link; expected {expected}.",
        help="Both processes must come from the same start and the same installation.",
    )
