"""Where commands come in: a ZeroMQ ROUTER on an ipc path, and its twin on virtual time (design 6).

Both only carry bytes; `commands.py` says what they mean. A message of any length up to 16 MiB is taken in, so that a
client that sends noise gets an error reply; libzmq hangs up on longer ones. Commands over tcp are refused: they need
CURVE keys, and the path's mode 0660 is what keeps others out.
"""

from __future__ import annotations

from typing import Protocol

import zmq

from controller.config import COMMAND_ENDPOINTS
from controller.service.ipc_endpoint import bind_ipc
from controller.service.link_transport import VirtualLink
from drivers.clock import Clock
from drivers.errors import ConfigurationError

_LONGEST_MESSAGE_BYTES = 16 * 1024 * 1024
_LAST_WORDS_MS = 200
"""How long closing may take to hand over what was said just before, such as that the arm has stopped."""

Address = tuple[bytes, ...]
"""Who sent a message; opaque, and good as a key."""


class CommandPort(Protocol):
    """What the front needs of a command socket; also what a clock can wait for."""

    def receive(self) -> tuple[Address, bytes] | None:
        """The next message and its sender; None if none has arrived."""
        ...

    def send(self, address: Address, data: bytes) -> bool:
        """Send to one client; False if it has gone or does not read."""
        ...

    def fileno(self) -> int:
        """File descriptor to wait on; −1 for a virtual one."""
        ...

    def next_arrival_ns(self) -> int | None:
        """Virtual time of the next message; None if none is on its way, and on a real socket."""
        ...

    def close(self) -> None:
        """Leave nothing behind."""
        ...


class CommandSocket:
    """ROUTER socket at `endpoint`. Clients are DEALER sockets; REQ sockets work too.

    ZeroMQ's descriptor is edge-triggered: after a wait on `fileno`, and after sending, call `receive` until it gives
    None, else the next wait may miss a message that is already there. Raises ConfigurationError.
    """

    def __init__(self, endpoint: str) -> None:
        if not endpoint.startswith("ipc://"):
            raise ConfigurationError("[front]", "command_endpoint", endpoint, COMMAND_ENDPOINTS)
        self.undelivered = 0
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, _LONGEST_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # a client that has gone is told to us, not passed over
        try:
            self._path = bind_ipc(self._socket, "command_endpoint", endpoint)
        except ConfigurationError:
            self._context.destroy(linger=0)
            raise

    def receive(self) -> tuple[Address, bytes] | None:
        if not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:  # cheaper than an exception
            return None
        identity, *parts = self._socket.recv_multipart(zmq.NOBLOCK)
        if len(parts) > 1 and not parts[0]:
            return (identity, b""), b"".join(parts[1:])  # REQ puts an empty part in front and wants it back
        return (identity,), b"".join(parts)

    def send(self, address: Address, data: bytes) -> bool:
        try:
            self._socket.send_multipart([*address, data], zmq.NOBLOCK)
        except zmq.ZMQError as error:
            if error.errno not in (zmq.EAGAIN, zmq.EHOSTUNREACH):
                raise
            self.undelivered += 1
            return False
        return True

    def fileno(self) -> int:
        return int(self._socket.getsockopt(zmq.FD))

    def next_arrival_ns(self) -> int | None:
        return None

    def close(self) -> None:
        self._context.destroy(linger=_LAST_WORDS_MS)
        self._path.unlink(missing_ok=True)


class MemoryConnection:
    """A client's end of a `MemoryCommandSocket`; what it sends is seen once the daemon's clock has come to it."""

    def __init__(self, requests: VirtualLink, answers: VirtualLink) -> None:
        self._requests = requests
        self._answers = answers

    def send(self, data: bytes) -> None:
        """Send one request at the client's clock."""
        self._requests.put(data)

    def take(self) -> bytes | None:
        """The next answer or event that has arrived at the client's clock; None if none has."""
        packet = self._answers.take()
        return None if packet is None else packet.data

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self._answers.next_arrival_ns()


class MemoryCommandSocket:
    """Twin of `CommandSocket` on virtual time. Messages are received in order of their time, then of connection."""

    def __init__(self, clock: Clock) -> None:
        self.undelivered = 0
        self._clock = clock
        self._links: dict[Address, tuple[VirtualLink, VirtualLink]] = {}

    def connect(self, client_clock: Clock) -> MemoryConnection:
        """A new client whose time is `client_clock`."""
        requests = VirtualLink(client_clock, self._clock)
        answers = VirtualLink(self._clock, client_clock, capacity=1000)
        self._links[(b"memory %d" % len(self._links),)] = requests, answers
        return MemoryConnection(requests, answers)

    def receive(self) -> tuple[Address, bytes] | None:
        arrival_ns = self.next_arrival_ns()
        for address, (requests, _) in self._links.items():
            if requests.next_arrival_ns() == arrival_ns and (packet := requests.take()) is not None:
                return address, packet.data
        return None

    def send(self, address: Address, data: bytes) -> bool:
        delivered = self._links[address][1].put(data)
        self.undelivered += not delivered
        return delivered

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        arrivals_ns = [requests.next_arrival_ns() for requests, _ in self._links.values()]
        return min((arrival_ns for arrival_ns in arrivals_ns if arrival_ns is not None), default=None)

    def close(self) -> None:
        self._links.clear()
