"""A simulated CAN wire at 1 Mbit/s: frames, their true lengths, and who talks when.

`CanWire` orders frames as arbitration does (of those that wait when the wire falls free, the lowest identifier wins)
and gives each its true length, stuff bits counted from the real bit pattern with its CRC. Times in ns. Source: WAM
reference 1.1, 5.1; the CAN 2.0 specification; error frames as in linux/can/error.h.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import can

BIT_NS = 1000
"""One bit at 1 Mbit/s."""
ERROR_FLAG = 0x20000000
"""Set in the identifier of an error frame: the adapter's word to its host, never on the wire."""
_CRC_POLYNOMIAL = 0x4599


class Frame(NamedTuple):
    """A standard data frame, or with `ERROR_FLAG` in its identifier an adapter's error frame."""

    identifier: int
    data: bytes

    @classmethod
    def of(cls, message: can.Message) -> Frame:
        """The frame in a python-can message that `is_classic_frame`."""
        return cls(message.arbitration_id, bytes(message.data))

    def message(self) -> can.Message:
        """As python-can passes it on."""
        if self.identifier & ERROR_FLAG:
            error = self.identifier & ~ERROR_FLAG
            return can.Message(arbitration_id=error, is_error_frame=True, is_extended_id=False, data=self.data)
        return can.Message(arbitration_id=self.identifier, is_extended_id=False, data=self.data)


TimedFrame = tuple[int, Frame]
"""Time in ns from which a frame is ready to go on the wire, and the frame."""


def is_classic_frame(message: can.Message) -> bool:
    """Whether this is a standard 11-bit data frame of at most eight bytes."""
    special = message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd
    return not special and 0 <= message.arbitration_id <= 0x7FF and len(message.data) <= 8


# --- length


def _stuffed(state: int, bits: int, count: int) -> tuple[int, int]:
    """State (last bit × 5 + run length − 1) after `count` more bits, and the stuff bits inserted among them."""
    last, run, inserted = state // 5, state % 5 + 1, 0
    for place in range(count - 1, -1, -1):
        bit = bits >> place & 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            last, run, inserted = 1 - bit, 1, inserted + 1
    return last * 5 + run - 1, inserted


def _stuffing_table(count: int) -> list[int]:
    """At state << 8 | bits: stuff bits inserted << 20 | next state << 8, so that a sum keeps its count apart."""
    table = []
    for state in range(10):
        for bits in range(256):
            following, inserted = _stuffed(state, bits & ((1 << count) - 1), count)
            table.append(inserted << 20 | following << 8)
    return table


def _crc(register: int, bits: int, count: int) -> int:
    for place in range(count - 1, -1, -1):
        feedback = register >> 14 ^ bits >> place & 1
        register = register << 1 & 0x7FFF ^ (_CRC_POLYNOMIAL if feedback else 0)
    return register


_BYTE = _stuffing_table(8)
_SEVEN_BITS = _stuffing_table(7)
_CRC = [_crc(byte << 7, 0, 8) for byte in range(256)]


@lru_cache(maxsize=1024)
def _header(identifier: int, length: int) -> tuple[int, int]:
    """CRC register and stuffing sum behind the first 19 bits: start, identifier, RTR, IDE, reserved, length."""
    bits = identifier << 7 | length
    state, inserted = _stuffed(0, bits, 18)  # behind the start bit: last bit 0, run 1
    return _crc(0, bits, 19), inserted << 20 | state << 8


@lru_cache(maxsize=8192)
def frame_bits(identifier: int, data: bytes) -> int:
    """Bits that a standard data frame occupies: 47 + 8 n, interframe gap included, plus its stuff bits."""
    register, total = _header(identifier, len(data))
    state = total & 0xF00
    for byte in data:
        register = (register << 8 & 0x7FFF) ^ _CRC[register >> 7 ^ byte]
        entry = _BYTE[state | byte]
        total += entry
        state = entry & 0xF00
    entry = _SEVEN_BITS[state | register >> 8]
    total += entry + _BYTE[entry & 0xF00 | register & 0xFF]
    return 47 + 8 * len(data) + (total >> 20)


# --- arbitration


class WireFrame(NamedTuple):
    """A frame on the wire, from its start bit to the end of the gap behind it."""

    start_ns: int
    end_ns: int
    frame: Frame
    sender: object


class CanWire:
    """Frames that wait, in the order in which arbitration lets them through."""

    def __init__(self) -> None:
        self._free_ns = 0
        self._waiting: list[tuple[int, int, int, Frame, object]] = []  # in order of identifier, then of offer
        self._offers = 0
        self._next: WireFrame | None = None
        self._next_index = 0

    def offer(self, ready_ns: int, frame: Frame, sender: object) -> None:
        """Let a standard data frame compete for the wire from `ready_ns` on."""
        self._offers += 1
        insort(self._waiting, (frame.identifier, self._offers, ready_ns, frame, sender))
        self._next = None

    def waiting(self) -> int:
        """Number of frames that have not started."""
        return len(self._waiting)

    def waiting_from(self, sender: object) -> int:
        """Number of frames of one sender that have not started."""
        return sum(entry[4] is sender for entry in self._waiting)

    def withdraw(self, unwanted: Callable[[object], bool]) -> None:
        """Forget the frames of such senders that have not started."""
        self._waiting, self._next = [entry for entry in self._waiting if not unwanted(entry[4])], None

    def next(self) -> WireFrame | None:
        """The frame that goes next as things stand; a frame offered meanwhile may overtake it."""
        if self._next is None and self._waiting:
            index, start_ns = 0, self._free_ns
            if self._waiting[0][2] > start_ns:
                start_ns = max(start_ns, min(entry[2] for entry in self._waiting))
                while self._waiting[index][2] > start_ns:
                    index += 1
            frame, sender = self._waiting[index][3:]
            self._next = WireFrame(start_ns, start_ns + frame_bits(*frame) * BIT_NS, frame, sender)
            self._next_index = index
        return self._next

    def take(self) -> WireFrame:
        """Put the next frame on the wire. Only after `next` has named one."""
        frame = self.next()
        assert frame is not None
        del self._waiting[self._next_index]
        self._free_ns = frame.end_ns
        self._next = None
        return frame
