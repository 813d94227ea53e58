"""Serial lines to a simulated device: in memory on virtual time, or a pty that any program can open.

Both put the wire in between: a byte takes 10 bit times, an answer starts after the request has left the wire and its
own delay has passed. A transaction is atomic at its start: the device sees the request, and samples what it answers,
when it is written; the answer becomes readable packet by packet, when its last byte would have arrived.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import tty
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from drivers.clock import NANOSECONDS, Clock, VirtualClock
from drivers.dynamixel.port import BITS_PER_BYTE
from drivers.errors import BusError


class TimedAnswer(Protocol):
    """One packet of a device's answer."""

    @property
    def delay_ns(self) -> int:
        """From the end of the bytes before it to its first byte."""
        ...

    @property
    def data(self) -> bytes:
        """Its bytes."""
        ...


class LineDevice(Protocol):
    """A device at the end of a serial line."""

    def answers(self, data: bytes, now_ns: int) -> Sequence[TimedAnswer]:
        """Take what arrived, whole packets or pieces; say what is answered."""
        ...


class Wire:
    """When bytes of both directions leave one half-duplex wire."""

    def __init__(self, device: LineDevice, baud: int) -> None:
        self._device = device
        self._byte_ns = BITS_PER_BYTE * NANOSECONDS / baud
        self._request_end_ns = 0
        self.arriving: deque[tuple[int, bytes]] = deque()
        """Answers under way or not yet fetched: (time of the last byte, bytes)."""

    def send(self, data: bytes, now_ns: int) -> None:
        """A request enters the wire now, or when the one before has left it."""
        self._request_end_ns = max(self._request_end_ns, now_ns) + round(len(data) * self._byte_ns)
        time_ns = self._request_end_ns
        for answer in self._device.answers(data, now_ns):
            time_ns += answer.delay_ns + round(len(answer.data) * self._byte_ns)
            self.arriving.append((time_ns, answer.data))

    def next_ns(self) -> int | None:
        """Arrival of the next packet, possibly past; None if none."""
        return self.arriving[0][0] if self.arriving else None


class MemoryLine:
    """A `ByteLine` to `device` on virtual time, no descriptor, no thread."""

    def __init__(self, device: LineDevice, clock: VirtualClock, baud: int = 1_000_000) -> None:
        self._clock = clock
        self._wire = Wire(device, baud)
        self._closed = False

    def write(self, data: bytes) -> None:
        if self._closed:
            raise BusError("memory line", "was closed.", help="Open a new one.")
        self._wire.send(data, self._clock.now_ns())

    def read(self, max_bytes: int) -> bytes:
        arriving, now_ns = self._wire.arriving, self._clock.now_ns()
        data = bytearray()
        while arriving and arriving[0][0] <= now_ns and len(data) < max_bytes:
            time_ns, packet = arriving.popleft()
            room = max_bytes - len(data)
            data += packet[:room]
            if len(packet) > room:
                arriving.appendleft((time_ns, packet[room:]))
        return bytes(data)

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self._wire.next_ns()

    def discard_input(self) -> None:
        arriving, now_ns = self._wire.arriving, self._clock.now_ns()
        while arriving and arriving[0][0] <= now_ns:
            arriving.popleft()

    def close(self) -> None:
        self._closed = True


class PtyServer:
    """`device` behind a pseudo terminal: open `port` with any serial client, at any baud rate.

    The owner calls `step` when `fileno()` is readable and at `next_due_ns()`. `baud` is what the wire's delays are
    reckoned with, whatever the client asks for.
    """

    READS_PER_STEP = 16
    """A client that never stops writing does not keep `step` from answering."""

    def __init__(self, device: LineDevice, clock: Clock, baud: int = 1_000_000) -> None:
        self._clock = clock
        self._wire = Wire(device, baud)
        self._master, self._slave = pty.openpty()
        # our own slave descriptor stays open: clients close and reopen, and the master must not see an end in between
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)

    def fileno(self) -> int:
        """Becomes readable when a client has written."""
        return self._master

    def next_due_ns(self) -> int | None:
        """When the next answer has to leave; None if none is due."""
        return self._wire.next_ns()

    def step(self, now_ns: int | None = None) -> None:
        """Take what clients wrote, send what is due; never waits."""
        now_ns = self._clock.now_ns() if now_ns is None else now_ns
        for _ in range(self.READS_PER_STEP):
            if not select.select([self._master], [], [], 0)[0]:
                break
            data = os.read(self._master, 4096)
            self._wire.send(data, now_ns)
        arriving = self._wire.arriving
        while arriving and arriving[0][0] <= now_ns:
            _, packet = arriving.popleft()
            # nobody reads: what does not fit is lost, as on a wire
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, packet)

    def close(self) -> None:
        """Give the pty back; may be called twice."""
        for name in ("_master", "_slave"):
            descriptor = getattr(self, name)
            if descriptor >= 0:
                os.close(descriptor)
                setattr(self, name, -1)
