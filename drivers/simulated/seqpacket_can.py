"""SocketCAN's 16-byte frames over an AF_UNIX SOCK_SEQPACKET socket: a CAN bus for machines whose kernel has none.

`SeqpacketBus` is the python-can interface "seqpacket"; its channel is the path of the socket that a `SeqpacketHub`
holds. The hub carries frames in arbitration order with the delays of a 1 Mbit/s wire, to every client but the sender,
and lets simulated devices answer. It never blocks: a loop selects over `filenos` until `next_due_ns` and calls `step`.
Times in ns; message timestamps are seconds of the monotonic clock.
"""

from __future__ import annotations

import select
import socket
import struct
from collections.abc import Sequence
from pathlib import Path

import can

from drivers.clock import Clock, MonotonicClock, nanoseconds, seconds
from drivers.errors import BusError
from drivers.simulated.can_hub import CanDevice, CanWire, TimedFrame, is_classic_frame

_FRAME = struct.Struct("=IB3x8s")
"""struct can_frame of linux/can.h: identifier with flags, length, data."""
_LARGEST_QUEUE = 64
"""Frames that may wait for the wire before the hub stops reading; then a sender's own socket fills, as a real one."""


def pack_frame(message: can.Message) -> bytes:
    """The 16 bytes of a standard data frame."""
    return _FRAME.pack(message.arbitration_id, len(message.data), bytes(message.data))


def unpack_frame(packet: bytes) -> can.Message | None:
    """The standard data frame in a packet; None if it is not exactly that."""
    if len(packet) != _FRAME.size:
        return None
    identifier, length, data = _FRAME.unpack(packet)
    if identifier > 0x7FF or length > 8:
        return None
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytearray(data[:length]))


class SeqpacketBus(can.BusABC):
    """A client of a `SeqpacketHub`, as python-can sees any bus: `can.Bus(interface="seqpacket", channel="/path")`.

    Carries standard data frames only. A client's own frames do not come back to it.
    """

    def __init__(self, channel: str, can_filters: can.typechecking.CanFilters | None = None, **kwargs: object) -> None:
        if kwargs.get("receive_own_messages") or kwargs.get("fd"):
            raise can.CanInitializationError("seqpacket does not return own messages and carries no CAN FD frames")
        self._clock = MonotonicClock()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        try:
            self._socket.connect(str(channel))
        except OSError as error:
            self._socket.close()
            raise can.CanInitializationError(f"no simulated CAN bus at {channel}: {error}") from error
        self.channel_info = f"seqpacket {channel}"
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; a full socket is waited for `timeout` seconds, and not at all without one."""
        if not is_classic_frame(msg):
            raise can.CanOperationError(f"seqpacket carries standard data frames only, not {msg}")
        packet = pack_frame(msg)
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout or 0.0)
        while True:
            try:
                self._socket.send(packet)
                return
            except BlockingIOError as error:
                remaining_s = seconds(deadline_ns - self._clock.now_ns())
                if remaining_s <= 0.0 or not select.select([], [self._socket], [], remaining_s)[1]:
                    raise can.CanOperationError("Transmit buffer full", error.errno) from error
            except OSError as error:
                raise can.CanOperationError(f"sending failed: {error}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout) if timeout else 0
        while True:
            try:
                packet = self._socket.recv(2 * _FRAME.size)
            except BlockingIOError:
                if timeout is not None and (not timeout or self._clock.now_ns() >= deadline_ns):
                    return None, True
                remaining_s = None if timeout is None else seconds(deadline_ns - self._clock.now_ns())
                select.select([self._socket], [], [], remaining_s and max(0.0, remaining_s))
                continue
            except OSError as error:
                raise can.CanOperationError(f"receiving failed: {error}", error.errno) from error
            if not packet:
                raise can.CanOperationError("the simulated CAN bus has been closed")
            message = unpack_frame(packet)
            # Filtered here: recv(0) of the base class would answer None for a filtered frame though others wait.
            if message is not None and self._matches_filters(message):
                message.timestamp = seconds(self._clock.now_ns())
                message.channel = self.channel_info
                return message, True

    def _apply_filters(self, filters: can.typechecking.CanFilters | None) -> None:
        """Nothing to hand on: `_recv_internal` filters."""

    def fileno(self) -> int:
        """File descriptor to select on."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        super().shutdown()
        self._socket.close()


class SeqpacketHub:
    """The bus itself, in the process of the simulated devices. Raises BusError if the socket cannot be had."""

    def __init__(self, path: Path | str, devices: Sequence[CanDevice], clock: Clock) -> None:
        self._path = Path(path)
        self._devices = tuple(devices)
        self._clock = clock
        self._wire = CanWire()
        self._clients: list[socket.socket] = []
        self._closed = False
        self.malformed_packets = 0
        """Packets that were no standard data frame."""
        self.dropped_frames = 0
        """Frames that a client did not get because it does not read."""
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        try:
            self._remove_stale_socket()
            self._listener.bind(str(self._path))
            self._listener.listen()
        except OSError as error:
            self._listener.close()
            raise BusError(
                f"seqpacket {self._path}",
                f"the socket cannot be made ({error}).",
                help="Name a path in a writable directory, of at most 107 bytes, that nobody else uses.",
            ) from error

    def filenos(self) -> list[int]:
        """File descriptors to select on for reading: the listener's and the clients'."""
        blocked = self._wire.waiting() >= _LARGEST_QUEUE
        return [self._listener.fileno(), *([] if blocked else [client.fileno() for client in self._clients])]

    def next_due_ns(self) -> int | None:
        """When the next frame ends on the wire, so that `step` should be called; None if the wire is idle."""
        frame = self._wire.next()
        return None if frame is None else frame.end_ns

    def step(self, now_ns: int | None = None) -> None:
        """Accept clients, read what they send, deliver all that has ended on the wire by `now_ns` (default: now)."""
        now_ns = self._clock.now_ns() if now_ns is None else now_ns
        self._accept()
        for client in tuple(self._clients):
            self._read(client, now_ns)
        while (frame := self._wire.next()) is not None and frame.end_ns <= now_ns:
            self._wire.take()
            packet = pack_frame(frame.message)
            for client in tuple(self._clients):
                if client is not frame.sender:
                    self._write(client, packet)
            for device in self._devices:
                if device is not frame.sender:
                    self.transmit(device.receive(frame.message, frame.end_ns), device)
        for device in self._devices:
            self.transmit(device.tick(now_ns), device)

    def transmit(self, frames: Sequence[TimedFrame], device: CanDevice) -> None:
        """Put frames of a device on the wire, such as the pendant's."""
        for ready_ns, message in frames:
            self._wire.offer(ready_ns, message, device)

    def close(self) -> None:
        """Disconnect all clients and remove the socket."""
        if self._closed:
            return
        self._closed = True
        for client in self._clients:
            client.close()
        self._clients.clear()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except BlockingIOError:
                return
            client.setblocking(False)
            self._clients.append(client)

    def _read(self, client: socket.socket, now_ns: int) -> None:
        while self._wire.waiting() < _LARGEST_QUEUE:
            try:
                packet = client.recv(2 * _FRAME.size)
            except BlockingIOError:
                return
            except OSError:
                self._disconnect(client)
                return
            if not packet and _has_hung_up(client):
                self._disconnect(client)
                return
            message = unpack_frame(packet)
            if message is None:
                self.malformed_packets += 1
            else:
                self._wire.offer(now_ns, message, client)

    def _write(self, client: socket.socket, packet: bytes) -> None:
        try:
            client.send(packet)
        except BlockingIOError:
            self.dropped_frames += 1
        except OSError:
            self._disconnect(client)

    def _disconnect(self, client: socket.socket) -> None:
        self._clients.remove(client)
        client.close()

    def _remove_stale_socket(self) -> None:
        """Remove what a hub that died has left; one that lives is left alone, and so is anything but a socket."""
        if not self._path.is_socket():
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as probe:
            try:
                probe.connect(str(self._path))
            except ConnectionRefusedError:
                self._path.unlink()


def _has_hung_up(client: socket.socket) -> bool:
    """Whether an empty read was the end; otherwise it was an empty packet."""
    poll = select.poll()
    poll.register(client, select.POLLHUP | select.POLLRDHUP)
    return bool(poll.poll(0))
