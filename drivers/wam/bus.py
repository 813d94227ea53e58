"""The CAN bus as the arm needs it: send now, receive until a deadline on the project's clock.

Two ways over the same seam. `CanBus` carries `can.Message`, for start-up and supervision; `FrameBus` carries identifier
and bytes, for the cycle, in which message objects would cost more than all else. `SocketCanBus` reads and writes
`struct can_frame` on the socket that python-can has opened and set up; `PythonCanBus` puts any other python-can
interface behind both, and `frames_of` whatever only has `CanBus`. Only standard data frames pass; remote and extended
frames are counted and dropped, error frames, the adapter's word to its host, reach the cycle alone. A frame that could
not be sent is never sent later: it would be an old torque. Source: WAM reference 1.5 and 7; linux/can.h.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import can

from drivers.clock import Clock
from drivers.errors import BusError, ProtocolError
from drivers.wam.frames import (
    ERROR_FRAME,
    GROUP_BIT,
    SAFETY_NODE,
    UNASKED_SAFETY_ID,
    RawFrame,
    get_property,
    parse_property,
)

ARM_FILTERS: tuple[tuple[int, int], ...] = (
    (0x403, 0x41F),
    (0x406, 0x41F),
    (UNASKED_SAFETY_ID, 0x7FF),
    (GROUP_BIT, 0x7F8),
)
"""Identifier and mask of all that the arm's driver wants to hear: positions, properties, the safety puck's own, and
what another host tells groups 0 to 7."""
SAFETY_FILTERS: tuple[tuple[int, int], ...] = ((GROUP_BIT | SAFETY_NODE << 5 | 6, 0x7FF),)
"""Only the safety puck's property replies: for a second, otherwise silent socket."""

_BIT_RATE = 1_000_000
_LARGEST_BACKLOG = 10_000
_CAN_FRAME = struct.Struct("=IB3x8s")
"""struct can_frame: identifier with flags, length, data."""
_REFUSAL_BYTES = 2
_SPECIAL = 0xC0000000
"""Flags of extended and remote frames."""


class CanBus(Protocol):
    """A CAN bus on the project's clock."""

    def send(self, message: can.Message) -> None:
        """Hand a frame to the bus at once. Raises BusError if it is not taken."""
        ...

    def receive(self, deadline_ns: int) -> can.Message | None:
        """Next frame, waiting until `deadline_ns` at most; a past deadline polls. BusError if the bus is gone."""
        ...

    def close(self) -> None:
        """Release the bus; more than once does no harm."""
        ...


@runtime_checkable
class FrameBus(Protocol):
    """The same without message objects. Identifiers of received error frames carry `ERROR_FRAME`."""

    def send_frame(self, identifier: int, data: bytes) -> None:
        """Hand a standard data frame to the bus at once. Raises BusError if it is not taken."""
        ...

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        """Next frame, as `CanBus.receive`, but error frames too."""
        ...


@runtime_checkable
class Reopenable(Protocol):
    """A bus that can be had anew after its adapter was gone."""

    def reopen(self) -> None:
        """Release it and open it again, empty. Raises BusError if it cannot be opened; it then stays closed."""
        ...


class PythonCanBus:
    """`CanBus` and `FrameBus` over a python-can interface with a file descriptor."""

    def __init__(self, bus: can.BusABC, clock: Clock, opener: Callable[[], can.BusABC] | None = None) -> None:
        """`opener` opens the same bus once more, for `reopen`."""
        self._bus = bus
        self._clock = clock
        self._opener = opener
        self._closed = False
        self.dropped_frames = 0
        """Remote, extended and FD frames that were not passed on; and error frames that `receive` passed over."""

    def send(self, message: can.Message) -> None:
        try:
            self._bus.send(message)
        except (can.CanError, OSError, ValueError) as error:
            raise self._unsent(message.arbitration_id, error) from error

    def receive(self, deadline_ns: int) -> can.Message | None:
        while (message := self._next(deadline_ns)) is not None:
            if not message.is_error_frame:
                return message
            self.dropped_frames += 1
        return None

    def send_frame(self, identifier: int, data: bytes) -> None:
        self.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data, check=False))

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        message = self._next(deadline_ns)
        return None if message is None else raw_frame(message)

    def fileno(self) -> int:
        """File descriptor of the interface."""
        return self._bus.fileno()

    def next_arrival_ns(self) -> int | None:
        """A real bus does not know: None."""
        return None

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._bus.shutdown()

    def reopen(self) -> None:
        with contextlib.suppress(can.CanError, OSError):  # what a vanished adapter says to being closed
            self.close()
        if self._opener is None:
            raise BusError(str(self._bus.channel_info), "the bus was opened by someone else.", help="Start again.")
        self._bus = self._opener()
        self._closed = False

    def _next(self, deadline_ns: int) -> can.Message | None:
        """Next data or error frame."""
        while True:
            try:
                # Never recv() with a time-out: python-can measures it on the wall clock.
                message = self._bus.recv(0)
                if message is None:
                    if self._clock.now_ns() >= deadline_ns or not self._clock.wait_readable(self, deadline_ns):
                        return None
                    continue
            except (can.CanError, OSError, ValueError) as error:
                raise self._deaf(error) from error
            if not (message.is_remote_frame or message.is_extended_id or message.is_fd):
                return message
            self.dropped_frames += 1

    def _unsent(self, identifier: int, error: Exception) -> BusError:
        # What still waits is old by the time it goes. SocketCAN cannot take it back; its queue should be short.
        with contextlib.suppress(NotImplementedError, can.CanError, OSError):
            self._bus.flush_tx_buffer()
        return BusError(
            str(self._bus.channel_info),
            f"frame {identifier:#05x} could not be sent ({error}).",
            help="Check that the arm is on, the bus terminated and its rate 1 Mbit/s; then start again.",
        )

    def _deaf(self, error: Exception | str) -> BusError:
        return BusError(
            str(self._bus.channel_info),
            f"nothing can be received any more ({error}).",
            help="Check the CAN interface and its cable; then start again.",
        )


class SocketCanBus(PythonCanBus):
    """`CanBus` and `FrameBus` on the socket of a python-can bus whose packets are `struct can_frame`.

    python-can opens, binds and filters it; nothing of it runs afterwards. A packet of two bytes is the simulated
    adapter's word: an errno with which it refuses frames from now on, or zero.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: Clock,
        opener: Callable[[], can.BusABC] | None = None,
        *,
        filters: tuple[tuple[int, int], ...] = ARM_FILTERS,
    ) -> None:
        """`filters` are applied here too: an interface may leave that to its python-can class."""
        super().__init__(bus, clock, opener)
        self._wanted = frozenset(
            number for number in range(0x800) if any(not (number ^ wanted) & mask for wanted, mask in filters)
        )
        self._take_socket()

    def send(self, message: can.Message) -> None:
        self.send_frame(message.arbitration_id, bytes(message.data))

    def receive(self, deadline_ns: int) -> can.Message | None:
        while (frame := self.receive_frame(deadline_ns)) is not None:
            identifier, data = frame
            if identifier < ERROR_FRAME:
                return can.Message(arbitration_id=identifier, is_extended_id=False, data=data, check=False)
            self.dropped_frames += 1
        return None

    def send_frame(self, identifier: int, data: bytes) -> None:
        try:
            if self._refusal:
                raise OSError(self._refusal, "the adapter refuses frames")
            self._send(_CAN_FRAME.pack(identifier, len(data), data), socket.MSG_DONTWAIT)
        except OSError as error:
            raise self._unsent(identifier, error) from error

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        while True:
            try:
                packet = self._recv(32, socket.MSG_DONTWAIT)
            except BlockingIOError:
                if self._clock.now_ns() >= deadline_ns or not self._clock.wait_readable(self, deadline_ns):
                    return None
                continue
            except OSError as error:
                raise self._deaf(error) from error
            if len(packet) != _CAN_FRAME.size:
                self._take_other(packet)
                continue
            identifier, length, data = _CAN_FRAME.unpack(packet)
            if identifier in self._wanted and length <= 8:
                return identifier, data[:length]
            if identifier & ERROR_FRAME and not identifier & _SPECIAL:
                return identifier, data
            self.dropped_frames += bool(identifier & _SPECIAL)

    def reopen(self) -> None:
        super().reopen()
        self._take_socket()

    def _take_socket(self) -> None:
        opened = socket_of(self._bus)
        assert opened is not None
        self._send, self._recv = opened.send, opened.recv
        self._refusal = 0

    def _take_other(self, packet: bytes) -> None:
        if not packet:
            raise self._deaf("the bus has been closed")
        if len(packet) == _REFUSAL_BYTES:
            self._refusal = int.from_bytes(packet, "little")
        else:
            self.dropped_frames += 1


def socket_of(bus: can.BusABC) -> socket.socket | None:
    """The socket of a python-can bus that carries `struct can_frame` (socketcan, seqpacket), None for any other."""
    found = getattr(bus, "frame_socket", None) or getattr(bus, "socket", None)
    return found if isinstance(found, socket.socket) else None


def raw_frame(message: can.Message) -> RawFrame:
    """Identifier and bytes of a data or error frame."""
    flag = ERROR_FRAME if message.is_error_frame else 0
    return message.arbitration_id | flag, bytes(message.data)


class _MessageFrames:
    """`FrameBus` over something that only has `CanBus`."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus

    def send_frame(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data, check=False))

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        message = self._bus.receive(deadline_ns)
        return None if message is None else raw_frame(message)


def frames_of(bus: CanBus) -> FrameBus:
    """The same bus without message objects."""
    return bus if isinstance(bus, FrameBus) else _MessageFrames(bus)


def bus_errno(error: BusError) -> int:
    """The operating system's number of what went wrong on a bus; 0 if there is none."""
    cause = error.__cause__
    number = cause.error_code if isinstance(cause, can.CanError) else getattr(cause, "errno", None)
    return number or 0


def open_can(
    interface: str, channel: str, clock: Clock, *, filters: tuple[tuple[int, int], ...] = ARM_FILTERS
) -> PythonCanBus:
    """Open a python-can interface, such as ("socketcan", "can0"), that hears only `filters` (identifier, mask).

    Raises BusError if there is no such interface or channel, or if it cannot be waited on.
    """

    def opened() -> can.BusABC:
        return _opened(interface, channel, filters)

    bus = opened()
    if socket_of(bus) is None:
        return PythonCanBus(bus, clock, opened)
    return SocketCanBus(bus, clock, opened, filters=filters)


def _opened(interface: str, channel: str, filters: tuple[tuple[int, int], ...]) -> can.BusABC:
    selected: list[can.typechecking.CanFilter] = [
        {"can_id": identifier, "can_mask": mask, "extended": False} for identifier, mask in filters
    ]
    try:
        bus = can.Bus(interface=interface, channel=channel, can_filters=selected, receive_own_messages=False)
    except (can.CanError, OSError, ValueError, TypeError, NotImplementedError, ImportError) as error:
        raise BusError(
            f"{interface} {channel}",
            f"the bus cannot be opened ({error}).",
            help=f"Name an interface that is up, at {_BIT_RATE} bit/s: 'ip -details link show type can' lists them.",
        ) from error
    try:
        bus.fileno()
    except NotImplementedError as error:
        bus.shutdown()
        raise BusError(
            f"{interface} {channel}",
            "this interface has no file descriptor to wait on.",
            help="Use socketcan, or seqpacket in simulation.",
        ) from error
    return bus


def ask_property(bus: CanBus, node: int, property_id: int, deadline_ns: int) -> int | None:
    """Get a property of `node`: its value, or None if it kept silent until `deadline_ns`.

    For start-up and supervision, not for the cycle: other frames are dropped, those that wait already first of all, so
    that an old reply is not taken for this one.
    """
    for _ in range(_LARGEST_BACKLOG):
        if bus.receive(0) is None:
            break
    bus.send(get_property(node, property_id))
    while (message := bus.receive(deadline_ns)) is not None:
        try:
            reply = parse_property(message)
        except ProtocolError:
            continue
        if reply.node == node and reply.property_id == property_id:
            return reply.value
    return None
