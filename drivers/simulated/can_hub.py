"""A simulated CAN wire at 1 Mbit/s, and the hub that joins clients and devices to it on virtual time.

`CanWire` orders frames as arbitration does (of those that wait when the wire falls free, the lowest identifier wins)
and gives each its true length, stuff bits counted from the real bit pattern with its CRC. `MemoryCanHub` lets devices
answer a frame as soon as it is sent, from the state their world has now; what they answer becomes visible when the wire
would have delivered it. Times in ns. Source: WAM reference 1.1, 5.1; the CAN 2.0 specification.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import can

from drivers.clock import VirtualClock
from drivers.errors import BusError

BIT_NS = 1000
"""One bit at 1 Mbit/s."""
_CRC_POLYNOMIAL = 0x4599

TimedFrame = tuple[int, can.Message]
"""Time in ns from which a frame is ready to go on the wire, and the frame."""


class CanDevice(Protocol):
    """A device on the simulated wire. What it sends must not be heard by itself."""

    def receive(self, message: can.Message, now_ns: int) -> list[TimedFrame]:
        """Hear a frame that ended on the wire at `now_ns`; the frames that answer it."""
        ...

    def tick(self, now_ns: int) -> list[TimedFrame]:
        """Do what is due by `now_ns` without being asked; the frames that follow from it."""
        ...


def _stuffing_table() -> list[list[tuple[int, int]]]:
    """For each state (last bit × 5 + run length − 1) and byte: the next state and the stuff bits inserted."""
    table = []
    for state in range(10):
        row = []
        for byte in range(256):
            last, run, stuffed = state // 5, state % 5 + 1, 0
            for place in range(7, -1, -1):
                bit = byte >> place & 1
                run = run + 1 if bit == last else 1
                last = bit
                if run == 5:
                    last, run, stuffed = 1 - bit, 1, stuffed + 1
            row.append((last * 5 + run - 1, stuffed))
        table.append(row)
    return table


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        register = byte << 7
        for _ in range(8):
            register = (register << 1 ^ (_CRC_POLYNOMIAL if register & 0x4000 else 0)) & 0x7FFF
        table.append(register)
    return table


_STUFFING = _stuffing_table()
_CRC = _crc_table()


def frame_bits(message: can.Message) -> int:
    """Bits that a standard data frame occupies: 47 + 8 n, interframe gap included, plus its stuff bits."""
    data = message.data
    header = message.arbitration_id << 7 | len(data)  # start of frame, identifier, RTR, IDE, reserved, length: 19 bits
    register = 0
    for byte in (header >> 16, header >> 8 & 0xFF, header & 0xFF, *data):  # leading zeros leave the register at zero
        register = (register << 8 & 0x7FFF) ^ _CRC[register >> 7 ^ byte]
    pattern = (header << 8 * len(data) | int.from_bytes(data, "big")) << 15 | register
    # 34 + 8 n bits: the start bit (0) and the identifier's first bit, then whole bytes.
    state, stuffed = (5, 0) if message.arbitration_id & 0x400 else (1, 0)
    for byte in (pattern & ((1 << 8 * (4 + len(data))) - 1)).to_bytes(4 + len(data), "big"):
        state, inserted = _STUFFING[state][byte]
        stuffed += inserted
    return 47 + 8 * len(data) + stuffed


@dataclass(frozen=True, slots=True)
class WireFrame:
    """A frame on the wire, from its start bit to the end of the gap behind it."""

    start_ns: int
    end_ns: int
    message: can.Message
    sender: object


class CanWire:
    """Who talks when: frames that wait, in the order in which arbitration lets them through."""

    def __init__(self) -> None:
        self._free_ns = 0
        self._waiting: list[tuple[int, can.Message, object]] = []
        self._next: WireFrame | None = None

    def offer(self, ready_ns: int, message: can.Message, sender: object) -> None:
        """Let a standard data frame compete for the wire from `ready_ns` on."""
        self._waiting.append((ready_ns, message, sender))
        self._next = None

    def waiting(self) -> int:
        """Number of frames that have not started."""
        return len(self._waiting)

    def next(self) -> WireFrame | None:
        """The frame that goes next as things stand; a frame offered meanwhile may overtake it."""
        if self._next is None and self._waiting:
            start_ns = max(self._free_ns, min(ready_ns for ready_ns, _, _ in self._waiting))
            competitors = (entry for entry in self._waiting if entry[0] <= start_ns)
            _, message, sender = min(competitors, key=lambda entry: entry[1].arbitration_id)
            self._next = WireFrame(start_ns, start_ns + frame_bits(message) * BIT_NS, message, sender)
        return self._next

    def take(self) -> WireFrame:
        """Put the next frame on the wire. Only after `next` has named one."""
        frame = self.next()
        assert frame is not None
        index = next(place for place, entry in enumerate(self._waiting) if entry[1] is frame.message)
        del self._waiting[index]
        self._free_ns = frame.end_ns
        self._next = None
        return frame


class MemoryCanHub:
    """Any number of `MemoryCanBus` clients and devices on one wire, on virtual time.

    A frame that a client sends is carried and answered within the call, so that devices answer from the state that
    their world has at the start of the transaction. The answers wait for the wire and can still be overtaken by a later
    frame of higher priority. Everybody hears every frame but its own.
    """

    def __init__(self, devices: Sequence[CanDevice]) -> None:
        self._devices = tuple(devices)
        self._clients: list[MemoryCanBus] = []
        self._wire = CanWire()

    def step(self, now_ns: int) -> None:
        """Carry what has ended on the wire by `now_ns` and let devices do what is due."""
        self._carry_until(now_ns)
        for device in self._devices:
            self.transmit(device.tick(now_ns), device)

    def transmit(self, frames: Sequence[TimedFrame], device: CanDevice) -> None:
        """Put frames of a device on the wire that nobody asked for, such as the pendant's."""
        for ready_ns, message in frames:
            self._wire.offer(ready_ns, message, device)

    def _join(self, client: MemoryCanBus) -> None:
        self._clients.append(client)

    def _leave(self, client: MemoryCanBus) -> None:
        if client in self._clients:
            self._clients.remove(client)

    def _send(self, message: can.Message, client: MemoryCanBus, now_ns: int) -> None:
        while (frame := self._wire.next()) is not None and frame.start_ns < now_ns:
            self._carry()
        self._wire.offer(now_ns, message, client)
        while self._carry() is not message:
            pass

    def _carry_until(self, end_ns: int) -> None:
        while (frame := self._wire.next()) is not None and frame.end_ns <= end_ns:
            self._carry()

    def _carry(self) -> can.Message:
        """Carry the next frame: clients find it in their inboxes, devices hear it and offer their answers."""
        frame = self._wire.take()
        for client in self._clients:
            if client is not frame.sender:
                client.inbox.append((frame.end_ns, frame.message))
        for device in self._devices:
            if device is not frame.sender:
                self.transmit(device.receive(frame.message, frame.end_ns), device)
        return frame.message


class MemoryCanBus:
    """A client of a `MemoryCanHub`, for a part with its own virtual clock; implements drivers.wam.bus.CanBus."""

    def __init__(self, hub: MemoryCanHub, clock: VirtualClock) -> None:
        self._hub = hub
        self._clock = clock
        self._closed = False
        self.inbox: deque[tuple[int, can.Message]] = deque()
        """Arrival time and frame, filled by the hub."""
        hub._join(self)

    def send(self, message: can.Message) -> None:
        """Put a standard data frame on the wire now. BusError if closed or if it is no such frame."""
        if self._closed:
            raise BusError("simulated CAN", "the bus is closed.", help="Open it again.")
        if not is_classic_frame(message):
            raise BusError(
                "simulated CAN", f"frame {message} is no standard data frame; expected an 11-bit identifier."
            )
        # A copy, so that neither the sender nor a reader can change what others hear.
        copy = can.Message(arbitration_id=message.arbitration_id, is_extended_id=False, data=bytearray(message.data))
        self._hub._send(copy, self, self._clock.now_ns())

    def receive(self, deadline_ns: int) -> can.Message | None:
        """Next frame that arrives by `deadline_ns`; the clock moves to its arrival, or else to the deadline."""
        if self._closed:
            raise BusError("simulated CAN", "the bus is closed.", help="Open it again.")
        deadline_ns = max(deadline_ns, self._clock.now_ns())
        if not self._clock.wait_readable(self, deadline_ns):
            return None
        # The frame that was waited for may still be on the wire.
        self._hub._carry_until(self._clock.now_ns())
        return self.inbox.popleft()[1]

    def fileno(self) -> int:
        """There is nothing to select on: −1."""
        return -1

    def next_arrival_ns(self) -> int | None:
        """When the next frame for this client ends on the wire, as things stand; None if there is none."""
        if self.inbox:
            return self.inbox[0][0]
        frame = self._hub._wire.next()  # all that waits there is devices' frames: clients' are carried when sent
        return None if frame is None else frame.end_ns

    def close(self) -> None:
        self._closed = True
        self._hub._leave(self)


def is_classic_frame(message: can.Message) -> bool:
    """Whether this is a standard 11-bit data frame of at most eight bytes."""
    special = message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd
    return not special and 0 <= message.arbitration_id <= 0x7FF and len(message.data) <= 8
