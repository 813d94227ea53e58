"""Finding packets in bytes that come in pieces, among garbage: what both protocols of the simulated motors share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

P = TypeVar("P")


class PacketStream(ABC, Generic[P]):
    """A buffer in which packets begin with `header` and tell their length in their first `prefix_bytes`."""

    def __init__(self, header: bytes, prefix_bytes: int) -> None:
        self._header, self._prefix_bytes = header, prefix_bytes
        self._buffer = b""

    def clear(self) -> None:
        """Forget a packet that never became whole."""
        self._buffer = b""

    def feed(self, data: bytes) -> list[P]:
        """The packets that `data` completes, in order."""
        self._buffer += data
        packets: list[P] = []
        while (wire := self._next_wire()) is not None:
            packet, intact = self._packet(wire)
            # the length of a damaged packet may be what is damaged: look for the next header inside it
            self._buffer = self._buffer[len(wire) if intact else len(self._header) :]
            if packet is not None:
                packets.append(packet)
        return packets

    def _next_wire(self) -> bytes | None:
        """The bytes that the next header and length enclose, left in the buffer; None until they are there."""
        while (start := self._buffer.find(self._header)) >= 0:
            self._buffer = self._buffer[start:]
            if len(self._buffer) < self._prefix_bytes:
                return None
            whole = self._whole_bytes(self._buffer[: self._prefix_bytes])
            if whole is not None:
                return self._buffer[:whole] if len(self._buffer) >= whole else None
            self._buffer = self._buffer[1:]
        self._buffer = self._buffer[1 - len(self._header) :]  # may be the beginning of a header
        return None

    @abstractmethod
    def _whole_bytes(self, prefix: bytes) -> int | None:
        """How many bytes the packet has that begins so; None if no packet does."""

    @abstractmethod
    def _packet(self, wire: bytes) -> tuple[P | None, bool]:
        """The packet, or None for one that is passed over; and whether its checksum is right."""
