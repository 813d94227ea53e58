"""The CAN bus as the arm needs it: send now, receive until a deadline on the project's clock.

`PythonCanBus` puts any python-can interface behind `CanBus`; the simulation has its own on virtual time. Only standard
data frames pass; error, remote and extended frames are counted and dropped. A frame that could not be sent is never
sent later: it would be an old torque. Source: WAM reference 1.5 and 7.
"""

from __future__ import annotations

from typing import Protocol

import can

from drivers.clock import Clock
from drivers.errors import BusError, ProtocolError
from drivers.wam.frames import GROUP_BIT, SAFETY_NODE, UNASKED_SAFETY_ID, get_property, parse_property

ARM_FILTERS: tuple[tuple[int, int], ...] = ((0x403, 0x41F), (0x406, 0x41F), (UNASKED_SAFETY_ID, 0x7FF))
"""Identifier and mask of all that the arm's driver wants to hear: positions, properties, the safety puck's own."""
SAFETY_FILTERS: tuple[tuple[int, int], ...] = ((GROUP_BIT | SAFETY_NODE << 5 | 6, 0x7FF),)
"""Only the safety puck's property replies: for a second, otherwise silent socket."""

_BIT_RATE = 1_000_000
_LARGEST_BACKLOG = 10_000


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


class PythonCanBus:
    """`CanBus` over a python-can interface with a file descriptor (socketcan, seqpacket)."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self._closed = False
        self.dropped_frames = 0
        """Error, remote, extended and FD frames that were not passed on."""

    def send(self, message: can.Message) -> None:
        try:
            self._bus.send(message)
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(
                str(self._bus.channel_info),
                f"frame {message.arbitration_id:#05x} could not be sent ({error}).",
                help="Check that the arm is on, the bus terminated and its rate 1 Mbit/s; then start again.",
            ) from error

    def receive(self, deadline_ns: int) -> can.Message | None:
        while True:
            try:
                # Never recv() with a time-out: python-can measures it on the wall clock.
                message = self._bus.recv(0)
                if message is None:
                    if self._clock.now_ns() >= deadline_ns or not self._clock.wait_readable(self, deadline_ns):
                        return None
                    continue
            except (can.CanError, OSError, ValueError) as error:
                raise BusError(
                    str(self._bus.channel_info),
                    f"nothing can be received any more ({error}).",
                    help="Check the CAN interface and its cable; then start again.",
                ) from error
            if not (message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd):
                return message
            self.dropped_frames += 1

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


def open_can(
    interface: str, channel: str, clock: Clock, *, filters: tuple[tuple[int, int], ...] = ARM_FILTERS
) -> PythonCanBus:
    """Open a python-can interface, such as ("socketcan", "can0"), that hears only `filters` (identifier, mask).

    Raises BusError if there is no such interface or channel, or if it cannot be waited on.
    """
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
    return PythonCanBus(bus, clock)


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
