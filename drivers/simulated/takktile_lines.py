"""What carries a simulated TakkTile bridge: memory on any clock, or a socket that any process can connect to.

The socket is AF_UNIX SOCK_SEQPACKET, a packet a transfer. To the bridge: `C` and the eight bytes of a USB set-up
packet, or `I`, an IN token for the bulk endpoint. From it: `D` and a request's data, `S` for a stall, `F` and one bulk
transfer. A frame leaves only against a token, so that the bridge's two buffers fill as on USB when nobody reads.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from pathlib import Path

from drivers.clock import Clock, nanoseconds
from drivers.errors import BusError, InputError, NoReplyError, ProtocolError
from drivers.simulated.takktile import RequestStalled, SimulatedTakktile
from drivers.takktile.frames import DEVICE, REQUEST_TYPE

REQUEST_TIMEOUT_S = 1.0
_SETUP = struct.Struct("<BBHHH")
_LARGEST_PACKET = 1024


class MemoryTransport:
    """A `BridgeTransport` to `device` in the same process; it waits in `clock`, virtual or not. Raises BusError."""

    def __init__(self, device: SimulatedTakktile, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._plug = device.plug
        self._check()

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        self._check()
        try:
            return self._device.request(request, value, index, length, self._clock.now_ns())
        except RequestStalled as error:
            raise ProtocolError(DEVICE, f"refused {error}.") from error

    def read_frame(self, deadline_ns: int) -> bytes | None:
        while True:
            self._check()
            ready_ns = self._device.next_frame_ns()
            self._clock.sleep_until_ns(deadline_ns if ready_ns is None else min(ready_ns, deadline_ns))
            frame = self._device.take_frame(self._clock.now_ns())
            if frame is not None or self._clock.now_ns() >= deadline_ns:
                return frame

    def close(self) -> None:
        pass

    def _check(self) -> None:
        self._device.advance_to(self._clock.now_ns())
        if self._device.unplugged or self._device.plug != self._plug:
            raise BusError(DEVICE, "was unplugged.", help="Check its plug.")


class SocketTransport:
    """A `BridgeTransport` to a `TakktileServer` at `path`. Raises BusError if there is none."""

    def __init__(self, path: str, clock: Clock) -> None:
        self._clock = clock
        self._asked = False
        self._frame: bytes | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise BusError(
                DEVICE,
                f"no simulated one answers at {path} ({error.strerror}).",
                help="Start one with: stillgrasp simulate takktile",
            ) from error

    def fileno(self) -> int:
        """Readable when a packet has come."""
        return self._socket.fileno()

    def next_arrival_ns(self) -> int | None:
        """Not known of a socket."""
        return None

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        self._send(b"C" + _SETUP.pack(REQUEST_TYPE, request, value, index, length))
        deadline_ns = self._clock.now_ns() + nanoseconds(REQUEST_TIMEOUT_S)
        while (packet := self._receive(deadline_ns)) is not None:
            if packet[:1] == b"D":
                return packet[1:]
            if packet[:1] == b"S":
                raise ProtocolError(DEVICE, f"refused request 0x{request:02X}.")
            self._keep(packet)
        raise NoReplyError(DEVICE, f"kept silent for {REQUEST_TIMEOUT_S:g} s.", help="Is its process alive?")

    def read_frame(self, deadline_ns: int) -> bytes | None:
        if not self._asked and self._frame is None:
            self._send(b"I")
            self._asked = True
        while self._frame is None:
            packet = self._receive(deadline_ns)
            if packet is None:
                return None
            self._keep(packet)
        frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        self._socket.close()

    def _keep(self, packet: bytes) -> None:
        if packet[:1] == b"F":
            self._frame, self._asked = packet[1:], False

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except OSError as error:
            raise BusError(DEVICE, f"the simulated one has gone ({error.strerror}).") from error

    def _receive(self, deadline_ns: int) -> bytes | None:
        if not self._clock.wait_readable(self, deadline_ns):
            return None
        try:
            packet = self._socket.recv(_LARGEST_PACKET)
        except BlockingIOError:
            return None
        except OSError as error:
            raise BusError(DEVICE, f"the simulated one has gone ({error.strerror}).") from error
        if not packet:
            raise BusError(DEVICE, "the simulated one has gone.", help="Start it again.")
        return packet


class TakktileServer:
    """`device` behind a socket at `path`, for one client at a time, as a USB device has one host.

    A loop selects over `filenos()` until `next_due_ns()` and calls `step`. Raises InputError if the socket cannot be
    had.
    """

    def __init__(self, path: Path | str, device: SimulatedTakktile, clock: Clock) -> None:
        self.path = Path(path)
        self._device = device
        self._clock = clock
        self._client: socket.socket | None = None
        self._plug = device.plug
        self._tokens = 0
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        try:
            self._listener.bind(str(self.path))
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise InputError(
                f"no socket can be made at {self.path} ({error.strerror}).",
                help="Name a path that does not exist yet, in a directory of yours.",
            ) from error

    def filenos(self) -> list[int]:
        """Descriptors to select on for reading; who waits for a second client lets it wait."""
        return [self._listener.fileno() if self._client is None else self._client.fileno()]

    def next_due_ns(self) -> int | None:
        """When the next frame that somebody waits for is ready."""
        return self._device.next_frame_ns() if self._tokens else None

    def step(self, now_ns: int | None = None) -> None:
        """Answer what was asked, send what is ready; never waits."""
        now_ns = self._clock.now_ns() if now_ns is None else now_ns
        self._device.advance_to(now_ns)
        if self._client is None:
            with contextlib.suppress(BlockingIOError):
                self._client = self._listener.accept()[0]
                self._client.setblocking(False)
                self._plug = self._device.plug
        if self._device.unplugged or self._device.plug != self._plug:
            self._drop()
        while self._client is not None and (packet := self._next_packet()) is not None:
            if packet == b"I":
                self._tokens = 1
            elif len(packet) == 1 + _SETUP.size and packet[:1] == b"C":
                self._answer(packet, now_ns)
        if self._tokens and (frame := self._device.take_frame(now_ns)) is not None:
            self._tokens = 0
            self._send(b"F" + frame)

    def close(self) -> None:
        """Give the socket back; may be called twice."""
        self._drop()
        self._listener.close()
        with contextlib.suppress(OSError):
            os.unlink(self.path)

    def _answer(self, packet: bytes, now_ns: int) -> None:
        kind, request, value, index, length = _SETUP.unpack(packet[1:])
        try:
            if kind != REQUEST_TYPE:
                raise RequestStalled
            self._send(b"D" + self._device.request(request, value, index, length, now_ns))
        except RequestStalled:
            self._send(b"S")

    def _next_packet(self) -> bytes | None:
        assert self._client is not None
        try:
            packet = self._client.recv(_LARGEST_PACKET)
        except BlockingIOError:
            return None
        except OSError:
            packet = b""
        if not packet:
            self._drop()
            return None
        return packet

    def _send(self, packet: bytes) -> None:
        if self._client is not None:
            try:
                self._client.send(packet)
            except BlockingIOError:
                return  # a client that never reads loses it
            except OSError:
                self._drop()

    def _drop(self) -> None:
        self._tokens = 0
        if self._client is not None:
            self._client.close()
            self._client = None
