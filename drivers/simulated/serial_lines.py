"""Serial lines to a simulated device: in memory on virtual time, or a pty that any program can open.

Both put the wire in between: a byte takes 10 bit times, an answer starts after the request has left the wire and its
own delay has passed. A transaction is atomic at its start: the device sees the request, and samples what it answers,
when it is written; the answer becomes readable packet by packet, when its last byte would have arrived.

The baud rate is the client's: a device that is set to another does not understand it. The device says whether its
adapter echoes or is unplugged; a line that was open when the plug came out stays dead.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import struct
import tty
from bisect import insort
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from drivers.clock import NANOSECONDS, Clock, VirtualClock
from drivers.dynamixel.port import BITS_PER_BYTE
from drivers.errors import BusError

_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_TERMIOS2 = struct.Struct("4I20s2I")
"""Linux' struct termios2: flags, characters, rates in and out; it holds any rate, where termios knows a few."""
_BOTHER, _CBAUD = 0o010000, 0o010017


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

    @property
    def held_ns(self) -> int:
        """How long the host's adapter keeps it back after its last byte."""
        ...


class HostAdapter(Protocol):
    """The host's end of the line, as it is now."""

    @property
    def echoes(self) -> bool:
        """Whether the host gets back what it sends."""
        ...

    @property
    def unplugged(self) -> bool:
        """Whether it is gone."""
        ...

    @property
    def times_unplugged(self) -> int:
        """How often it has been."""
        ...


class LineDevice(Protocol):
    """A device at the end of a serial line."""

    @property
    def adapter(self) -> HostAdapter:
        """The host's end of the line."""
        ...

    def answers(self, data: bytes, now_ns: int, baud: int) -> Sequence[TimedAnswer]:
        """Take what arrived at this rate, whole packets or pieces; say what is answered."""
        ...


class Wire:
    """When bytes of both directions leave one half-duplex wire."""

    def __init__(self, device: LineDevice) -> None:
        self._device = device
        self._request_end_ns = 0
        self.arriving: deque[tuple[int, bytes]] = deque()
        """Answers under way or not yet fetched: (time of the last byte, bytes)."""

    def send(self, data: bytes, now_ns: int, baud: int) -> None:
        """A request enters the wire now, or when the one before has left it."""
        byte_ns = BITS_PER_BYTE * NANOSECONDS / baud
        self._request_end_ns = max(self._request_end_ns, now_ns) + round(len(data) * byte_ns)
        time_ns = self._request_end_ns
        answers = self._device.answers(data, now_ns, baud)
        if self._device.adapter.echoes:
            self._arrives(time_ns, data)
        for answer in answers:
            time_ns += answer.delay_ns + round(len(answer.data) * byte_ns)
            self._arrives(time_ns + answer.held_ns, answer.data)

    def next_ns(self) -> int | None:
        """Arrival of the next packet, possibly past; None if none."""
        return self.arriving[0][0] if self.arriving else None

    def _arrives(self, time_ns: int, data: bytes) -> None:
        insort(self.arriving, (time_ns, data), key=lambda arriving: arriving[0])


class MemoryLine:
    """A `ByteLine` to `device` on virtual time, no descriptor, no thread. BusError while its adapter is unplugged."""

    def __init__(self, device: LineDevice, clock: VirtualClock, baud: int = 1_000_000) -> None:
        self._clock = clock
        self._adapter = device.adapter
        self._wire = Wire(device)
        self._baud = baud
        self._closed = False
        self._opened_as = self._adapter.times_unplugged
        self._check()

    def write(self, data: bytes) -> None:
        self._check()
        self._wire.send(data, self._clock.now_ns(), self._baud)

    def read(self, max_bytes: int) -> bytes:
        self._check()
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
        # a dead line is readable: the error is what there is to read
        return 0 if self._dead else self._wire.next_ns()

    def discard_input(self) -> None:
        self._check()
        arriving, now_ns = self._wire.arriving, self._clock.now_ns()
        while arriving and arriving[0][0] <= now_ns:
            arriving.popleft()

    def close(self) -> None:
        self._closed = True

    @property
    def _dead(self) -> bool:
        return self._adapter.unplugged or self._adapter.times_unplugged != self._opened_as

    def _check(self) -> None:
        if self._closed:
            raise BusError("memory line", "was closed.", help="Open a new one.")
        if self._dead:
            raise BusError("memory line", "is gone: its adapter was unplugged.", help="Plug it in and open a new one.")


class PtyServer:
    """`device` behind a pseudo terminal: open `port` with any serial client.

    The owner calls `step` when `filenos()` are readable and at `next_due_ns()`. `baud` is what the terminal is set to
    before a client sets it; what counts is the client's. An unplugged adapter ends the terminal; back in, it is another
    one. `link`, if there is one, is a symbolic link to the present one, missing while it is unplugged; it is the
    owner's to remove.
    """

    READS_PER_STEP = 16
    """A client that never stops writing does not keep `step` from answering."""

    def __init__(
        self,
        device: LineDevice,
        clock: Clock,
        baud: int = 1_000_000,
        link: Path | None = None,
    ) -> None:
        self._clock = clock
        self._adapter = device.adapter
        self._wire = Wire(device)
        self._baud = baud
        self.link = link
        self._open()

    def fileno(self) -> int:
        """Becomes readable when a client has written; −1 while unplugged."""
        return self._master

    def filenos(self) -> list[int]:
        """What to wait for; nothing while unplugged."""
        return [self._master] if self._master >= 0 else []

    def next_due_ns(self) -> int | None:
        """When the next answer has to leave; None if none is due."""
        return self._wire.next_ns()

    def step(self, now_ns: int | None = None) -> None:
        """Take what clients wrote, send what is due; never waits."""
        now_ns = self._clock.now_ns() if now_ns is None else now_ns
        self._follow_plug()
        if self._master < 0:
            return
        for _ in range(self.READS_PER_STEP):
            if not select.select([self._master], [], [], 0)[0]:
                break
            data = os.read(self._master, 4096)
            self._wire.send(data, now_ns, client_baud(self._slave) or self._baud)
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

    def _open(self) -> None:
        self._master, self._slave = pty.openpty()
        # our own slave descriptor stays open: clients close and reopen, and the master must not see an end in between
        tty.setraw(self._slave)
        _set_baud(self._slave, self._baud)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._opened_as = self._adapter.times_unplugged
        if self.link is not None:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.port)

    def _follow_plug(self) -> None:
        if self._adapter.times_unplugged != self._opened_as:
            self.close()
            self._wire.arriving.clear()
            if self.link is not None:  # the terminal's number is free for others now
                self.link.unlink(missing_ok=True)
            if not self._adapter.unplugged:
                self._open()


def client_baud(descriptor: int) -> int:
    """Output rate that a terminal is set to, bit/s; 0 if its line is hung up."""
    return int(_TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size)))[-1])


def _set_baud(descriptor: int, baud: int) -> None:
    flags = list(_TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))))
    flags[2] = flags[2] & ~_CBAUD | _BOTHER
    flags[-2:] = [baud, baud]
    fcntl.ioctl(descriptor, _TCSETS2, _TERMIOS2.pack(*flags))
