"""What carries packets between the processes, whole and without waiting: AF_UNIX SOCK_SEQPACKET, or virtual time.

`SocketLink` is one end of a SEQPACKET socket pair: the kernel keeps packets whole and shows a dead peer at once as
end-of-file. `VirtualLink` is its twin in a simulation: a packet sent at the sender's clock time t is visible once the
reader's clock has come to t. Neither looks into a packet; `links.py` says what is in one.
Source: real-time-python reference 4a (SEQPACKET against pipes and ZeroMQ); design 2.
"""

from __future__ import annotations

import array
import errno
import os
import select
import socket
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from drivers.clock import Clock
from drivers.errors import StillgraspError

MAXIMUM_PACKET_BYTES = 16400
MAXIMUM_DESCRIPTORS = 4

_ANCILLARY_BYTES = socket.CMSG_SPACE(MAXIMUM_DESCRIPTORS * array.array("i").itemsize)
_PEER_GONE = {errno.EPIPE, errno.ECONNRESET, errno.ECONNREFUSED, errno.ENOTCONN, errno.ESHUTDOWN}


class LinkError(StillgraspError):
    """What came over a link cannot be right: the two ends do not belong together, or something vanished."""


class LinkFull(LinkError):  # noqa: N818 - a state of the link, named as one
    """An ordered link takes no more until its reader has read."""


class LinkClosed(LinkError):  # noqa: N818 - a state of the link, named as one
    """The process at the other end has gone."""


class Packet(NamedTuple):
    """Bytes with the file descriptors that came beside them; whoever takes a packet owns its descriptors."""

    data: bytes
    descriptors: tuple[int, ...] = ()


class Link(Protocol):
    """A transport of whole packets that never waits."""

    @property
    def closed(self) -> bool:
        """True as soon as the other end has gone; what it sent before can still be taken."""
        ...

    def put(self, data: bytes, descriptors: Sequence[int] = ()) -> bool:
        """Send one packet; False if the link is full. Descriptors are duplicated. Raises `LinkClosed`."""
        ...

    def take(self) -> Packet | None:
        """The next packet, or None if none has arrived."""
        ...

    def fileno(self) -> int:
        """File descriptor to wait on; −1 for a virtual link."""
        ...

    def next_arrival_ns(self) -> int | None:
        """Virtual time of the next packet; None if none is on its way, and on real links."""
        ...

    def close(self) -> None:
        """Close this end."""
        ...


class SocketLink:
    """One end of a SEQPACKET pair. Both directions may be used, one discipline each way.

    Every process must close the ends it does not use, else end-of-file does not show.
    """

    def __init__(self, end: socket.socket) -> None:
        if end.family != socket.AF_UNIX or end.type != socket.SOCK_SEQPACKET:
            raise LinkError(
                f"Socket {end.fileno()} is {end.family.name} {end.type.name}; a link needs AF_UNIX SOCK_SEQPACKET.",
                help="Make both ends with socket_links().",
            )
        end.setblocking(False)
        self._socket = end
        self._closed = False
        self._hang_up = select.poll()
        self._hang_up.register(end, select.POLLHUP)

    @classmethod
    def from_fileno(cls, fileno: int) -> SocketLink:
        """The end that a parent process left open for this one as descriptor `fileno`; takes it over."""
        try:
            return cls(socket.socket(fileno=fileno))
        except OSError as error:
            raise LinkError(f"Descriptor {fileno} is not a socket ({error.strerror}).") from error

    @property
    def closed(self) -> bool:
        if not self._closed and self._hang_up.poll(0):
            self._closed = True
        return self._closed

    def put(self, data: bytes, descriptors: Sequence[int] = ()) -> bool:
        try:
            if descriptors:
                socket.send_fds(self._socket, [data], list(descriptors))
            else:
                self._socket.send(data)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.ENOBUFS):
                return False
            if error.errno in _PEER_GONE or self._socket.fileno() < 0:
                self._closed = True
                raise LinkClosed("The process at the other end of the link has gone.") from error
            raise LinkError(f"The link refused a packet of {len(data)} bytes: {error.strerror}.") from error
        return True

    def take(self) -> Packet | None:
        try:
            data, ancillary, flags, _ = self._socket.recvmsg(
                MAXIMUM_PACKET_BYTES, _ANCILLARY_BYTES, socket.MSG_CMSG_CLOEXEC
            )
        except BlockingIOError:
            return None
        except OSError as error:
            if error.errno == errno.ECONNRESET:
                # The peer closed with our packets unread. The kernel says so once, ahead of what it sent to us.
                self._closed = True
                return self.take()
            if self._socket.fileno() < 0:
                self._closed = True
                return None
            raise LinkError(f"Nothing can be received from the link: {error.strerror}.") from error
        descriptors = _descriptors(ancillary) if ancillary else ()
        if flags & (socket.MSG_TRUNC | socket.MSG_CTRUNC):
            for descriptor in descriptors:
                os.close(descriptor)
            raise LinkError(
                f"A packet was longer than {MAXIMUM_PACKET_BYTES} bytes or {MAXIMUM_DESCRIPTORS} descriptors."
            )
        if not data:
            self._closed = True
            return None
        return Packet(data, descriptors)

    def fileno(self) -> int:
        return self._socket.fileno()

    def next_arrival_ns(self) -> int | None:
        return None

    def close(self) -> None:
        self._closed = True
        self._socket.close()


def _descriptors(ancillary: list[tuple[int, int, bytes]]) -> tuple[int, ...]:
    found = array.array("i")
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS:
            found.frombytes(data[: len(data) - len(data) % found.itemsize])
    return tuple(found)


def socket_links(buffer_bytes: int = 131072) -> tuple[SocketLink, SocketLink]:
    """Both ends of a new SEQPACKET pair; `buffer_bytes` is what may wait unread in each direction."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, buffer_bytes)
    return SocketLink(ends[0]), SocketLink(ends[1])


class VirtualLink:
    """One direction between two parts of a simulation; sender and reader hold the same object."""

    def __init__(self, sender_clock: Clock, reader_clock: Clock, capacity: int = 256) -> None:
        self._sender_clock = sender_clock
        self._reader_clock = reader_clock
        self._capacity = capacity
        self._packets: deque[tuple[int, Packet]] = deque()
        self._closed = False

    @property
    def closed(self) -> bool:
        return self._closed

    def put(self, data: bytes, descriptors: Sequence[int] = ()) -> bool:
        if self._closed:
            raise LinkClosed("The part at the other end of the link has gone.")
        if len(self._packets) >= self._capacity:
            return False
        copies = tuple(os.dup(descriptor) for descriptor in descriptors)
        self._packets.append((self._sender_clock.now_ns(), Packet(data, copies)))
        return True

    def take(self) -> Packet | None:
        if not self._packets or self._packets[0][0] > self._reader_clock.now_ns():
            return None
        return self._packets.popleft()[1]

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self._packets[0][0] if self._packets else None

    def close(self) -> None:
        self._closed = True
