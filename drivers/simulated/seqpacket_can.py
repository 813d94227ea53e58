"""SocketCAN's 16-byte frames over an AF_UNIX SOCK_SEQPACKET socket: a CAN bus for machines whose kernel has none.

`SeqpacketBus` is the python-can interface "seqpacket"; its channel is the path of the socket that a `SeqpacketHub`
holds. The hub carries frames in arbitration order with the delays of a 1 Mbit/s wire, to every client but the sender,
and lets simulated devices answer. It never blocks: a loop selects over `filenos` until `next_due_ns` and calls `step`.
A fault script's error frames carry CAN_ERR_FLAG as SocketCAN's; while it refuses frames, the hub says so in packets of
two bytes, an errno or zero. Times in ns; message timestamps are seconds of the monotonic clock.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
from collections.abc import Sequence
from pathlib import Path

import can

from drivers.clock import Clock, MonotonicClock, nanoseconds, seconds
from drivers.errors import BusError
from drivers.simulated.can_faults import CanFaults, SendRefusedError
from drivers.simulated.can_segment import CanDevice, CanSegment
from drivers.simulated.can_wire import ERROR_FLAG, Frame, TimedFrame, is_classic_frame

_FRAME = struct.Struct("=IB3x8s")
"""struct can_frame of linux/can.h: identifier with flags, length, data."""
_REFUSAL = struct.Struct("=H")
_LARGEST_QUEUE = 64
"""Frames that may wait for the wire before the hub stops reading; then a sender's own socket fills, as a real one."""


def pack_frame(frame: Frame) -> bytes:
    """The 16 bytes of a frame."""
    return _FRAME.pack(frame.identifier, len(frame.data), frame.data)


def unpack_frame(packet: bytes) -> Frame | None:
    """The standard data frame or error frame in a packet; None if it is neither."""
    if len(packet) != _FRAME.size:
        return None
    identifier, length, data = _FRAME.unpack(packet)
    if length > 8 or not (identifier <= 0x7FF or ERROR_FLAG < identifier < 2 * ERROR_FLAG):
        return None
    return Frame(identifier, data[:length])


class SeqpacketBus(can.BusABC):
    """A client of a `SeqpacketHub`, as python-can sees any bus: `can.Bus(interface="seqpacket", channel="/path")`.

    Carries standard data frames only. A client's own frames do not come back to it.
    """

    def __init__(self, channel: str, can_filters: can.typechecking.CanFilters | None = None, **kwargs: object) -> None:
        if kwargs.get("receive_own_messages") or kwargs.get("fd"):
            raise can.CanInitializationError("seqpacket does not return own messages and carries no CAN FD frames")
        self._clock = MonotonicClock()
        self._refusal = 0
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
        if self._refusal:
            raise can.CanOperationError(os.strerror(self._refusal), self._refusal)
        packet = pack_frame(Frame.of(msg))
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
            if len(packet) == _REFUSAL.size:
                (self._refusal,) = _REFUSAL.unpack(packet)
            frame = unpack_frame(packet)
            message = None if frame is None else frame.message()
            # Filtered here: recv(0) of the base class would answer None for a filtered frame though others wait.
            if message is not None and (message.is_error_frame or self._matches_filters(message)):
                message.timestamp = seconds(self._clock.now_ns())
                message.channel = self.channel_info
                return message, True

    def _apply_filters(self, filters: can.typechecking.CanFilters | None) -> None:
        """Nothing to hand on: `_recv_internal` filters."""

    @property
    def frame_socket(self) -> socket.socket:
        """What carries the packets."""
        return self._socket

    def fileno(self) -> int:
        """File descriptor to select on."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        super().shutdown()
        self._socket.close()


class SeqpacketHub:
    """The bus itself, in the process of the simulated devices. Raises BusError if the socket cannot be had."""

    def __init__(
        self, path: Path | str, devices: Sequence[CanDevice], clock: Clock, faults: CanFaults | None = None
    ) -> None:
        self._path = Path(path)
        self._clock = clock
        self._segment = CanSegment(devices, self._deliver, faults)
        self._clients: list[socket.socket] = []
        self._closed = False
        self._refusal = 0
        self.malformed_packets = 0
        """Packets that were no standard data frame."""
        self.dropped_frames = 0
        """Frames that a client did not get because it does not read."""
        self._listener: socket.socket | None = self._listen()

    def filenos(self) -> list[int]:
        """File descriptors to select on for reading: the listener's and the clients'."""
        if self._listener is None:
            return []
        blocked = self._segment.waiting() >= _LARGEST_QUEUE
        return [self._listener.fileno(), *([] if blocked else [client.fileno() for client in self._clients])]

    def next_due_ns(self) -> int | None:
        """When something happens next on the bus, so that `step` should be called; None if it is idle."""
        return self._segment.next_ns()

    def step(self, now_ns: int | None = None) -> None:
        """Accept clients, read what they send, deliver all that has ended on the wire by `now_ns` (default: now)."""
        now_ns = self._clock.now_ns() if now_ns is None else now_ns
        self._follow_faults(now_ns)
        if self._listener is not None:
            self._accept(self._listener)
        for client in tuple(self._clients):
            self._read(client, now_ns)
        self._segment.step(now_ns)

    def transmit(self, frames: Sequence[TimedFrame], device: CanDevice) -> None:
        """Put frames of a device on the wire, such as the pendant's."""
        self._segment.transmit(frames, device)

    def close(self) -> None:
        """Disconnect all clients and remove the socket."""
        if not self._closed:
            self._closed = True
            self._disappear()

    def _disappear(self) -> None:
        for client in self._clients:
            client.close()
        self._clients.clear()
        if self._listener is not None:
            self._listener.close()
            self._listener = None
            self._path.unlink(missing_ok=True)

    def _listen(self) -> socket.socket:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        try:
            self._remove_stale_socket()
            listener.bind(str(self._path))
            listener.listen()
        except OSError as error:
            listener.close()
            raise BusError(
                f"seqpacket {self._path}",
                f"the socket cannot be made ({error}).",
                help="Name a path in a writable directory, of at most 107 bytes, that nobody else uses.",
            ) from error
        return listener

    @property
    def faults(self) -> CanFaults | None:
        """What goes wrong on this bus; None while nothing can, which costs the least."""
        return self._segment.faults

    @faults.setter
    def faults(self, faults: CanFaults) -> None:
        self._segment.faults = faults

    def _follow_faults(self, now_ns: int) -> None:
        """Be there or not, and refuse or not, as the fault script says."""
        faults = self._segment.faults
        if faults is None or self._closed:
            return
        self._segment.carry_until(now_ns)
        if faults.unplugged:
            self._disappear()
        elif self._listener is None:
            self._listener = self._listen()
        if faults.refusal != self._refusal:
            self._refusal = faults.refusal
            for client in tuple(self._clients):
                self._write(client, _REFUSAL.pack(self._refusal))

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                client, _ = listener.accept()
            except BlockingIOError:
                return
            client.setblocking(False)
            self._clients.append(client)
            if self._refusal:
                self._write(client, _REFUSAL.pack(self._refusal))

    def _read(self, client: socket.socket, now_ns: int) -> None:
        while self._segment.waiting() < _LARGEST_QUEUE:
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
            frame = unpack_frame(packet)
            if frame is None or frame.identifier & ERROR_FLAG:
                self.malformed_packets += 1
                continue
            with contextlib.suppress(SendRefusedError):  # it was told
                self._segment.send(frame, client, now_ns)

    def _deliver(self, _: int, frame: Frame, sender: object) -> None:
        packet = pack_frame(frame)
        for client in tuple(self._clients):
            if client is not sender:
                self._write(client, packet)

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
