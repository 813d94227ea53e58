"""Dynamixel protocol 1.0 on the device's side: bytes ↔ packets, independent of dynamixel-sdk and of the driver.

Instruction and status packets have one form here: FF FF id length code parameters checksum, and only the direction
tells them apart. Source: dynamixel reference 4.1.
"""

from __future__ import annotations

from drivers.simulated.dynamixel_packets import Packet

HEADER = b"\xff\xff"
NO_ID = 0xFF
SHORTEST_LENGTH = 2


def checksum(body: bytes) -> int:
    """Of all bytes from the id on."""
    return ~sum(body) & 0xFF


def pack(packet_id: int, code: int, parameters: bytes = b"") -> bytes:
    """A whole packet on the wire: `code` is the instruction or, in a status, the error byte."""
    body = bytes((packet_id, len(parameters) + 2, code)) + parameters
    return HEADER + body + bytes((checksum(body),))


class PacketReader:
    """Finds instruction packets in bytes that come in pieces, among garbage."""

    def __init__(self) -> None:
        self._buffer = b""

    def clear(self) -> None:
        """Forget a packet that never became whole."""
        self._buffer = b""

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes, in order."""
        self._buffer += data
        packets: list[Packet] = []
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                self._buffer = self._buffer[-1:]  # may be the first half of a header
                return packets
            self._buffer = self._buffer[start:]
            if len(self._buffer) < 4:
                return packets
            packet_id, length = self._buffer[2], self._buffer[3]
            if packet_id == NO_ID or length < SHORTEST_LENGTH:
                self._buffer = self._buffer[1:]
                continue
            if len(self._buffer) < 4 + length:
                return packets
            wire = self._buffer[: 4 + length]
            intact = checksum(wire[2:-1]) == wire[-1]
            # the length of a damaged packet may be what is damaged: look for the next header inside it
            self._buffer = self._buffer[len(wire) if intact else len(HEADER) :]
            packets.append(Packet(packet_id, wire[4], wire[5:-1], intact, wire))
