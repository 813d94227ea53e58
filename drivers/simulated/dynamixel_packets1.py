"""Dynamixel protocol 1.0 on the device's side: bytes ↔ packets, independent of dynamixel-sdk and of the driver.

Instruction and status packets have one form here: FF FF id length code parameters checksum, and only the direction
tells them apart. Source: dynamixel reference 4.1.
"""

from __future__ import annotations

from drivers.simulated.dynamixel_packets import Packet
from drivers.simulated.packet_stream import PacketStream

HEADER = b"\xff\xff"
NO_ID = 0xFF
SHORTEST_LENGTH = 2
_PREFIX_BYTES = 4
"""Header, id and length."""


def checksum(body: bytes) -> int:
    """Of all bytes from the id on."""
    return ~sum(body) & 0xFF


def pack(packet_id: int, code: int, parameters: bytes = b"") -> bytes:
    """A whole packet on the wire: `code` is the instruction or, in a status, the error byte."""
    body = bytes((packet_id, len(parameters) + 2, code)) + parameters
    return HEADER + body + bytes((checksum(body),))


class PacketReader(PacketStream[Packet]):
    """Finds instruction packets in bytes that come in pieces, among garbage."""

    def __init__(self) -> None:
        super().__init__(HEADER, _PREFIX_BYTES)

    def _whole_bytes(self, prefix: bytes) -> int | None:
        packet_id, length = prefix[2], prefix[3]
        return None if packet_id == NO_ID or length < SHORTEST_LENGTH else _PREFIX_BYTES + length

    def _packet(self, wire: bytes) -> tuple[Packet | None, bool]:
        intact = checksum(wire[2:-1]) == wire[-1]
        return Packet(wire[2], wire[4], wire[5:-1], intact, wire), intact
