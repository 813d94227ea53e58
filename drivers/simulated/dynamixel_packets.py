"""Dynamixel protocol 2.0 on the device's side: bytes ↔ packets, independent of dynamixel-sdk and of the driver.

Pure functions, and `PacketReader` that finds packets in a stream. Source: dynamixel reference 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.simulated.packet_stream import PacketStream

HEADER = b"\xff\xff\xfd\x00"
MAXIMUM_LENGTH = 1024
"""Longest length field that is believed; more is garbage."""
BROADCAST = 0xFE
STATUS = 0x55
_PREFIX_BYTES = 7
"""Header, id and length."""


def crc16(data: bytes, start: int = 0) -> int:
    """CRC-16/UMTS: polynomial 0x8005, start 0, most significant bit first, no reflection, no final xor."""
    crc = start
    for byte in data:
        crc ^= byte << 8
        crc = ((crc << 8) & 0xFFFF) ^ _SHIFTED[crc >> 8]
    return crc


def _shifted(top: int) -> int:
    crc = top << 8
    for _ in range(8):
        crc = ((crc << 1) ^ (0x8005 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


_SHIFTED = [_shifted(top) for top in range(256)]


def stuff(body: bytes) -> bytes:
    """Instruction and parameters with an FD behind each FF FF FD."""
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuff(body: bytes) -> bytes:
    """The inverse of `stuff`."""
    return body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def pack_instruction(packet_id: int, instruction: int, parameters: bytes = b"") -> bytes:
    """A whole packet on the wire."""
    body = stuff(bytes((instruction,)) + parameters)
    packet = HEADER + bytes((packet_id,)) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + crc16(packet).to_bytes(2, "little")


def pack_status(packet_id: int, error: int, parameters: bytes = b"") -> bytes:
    """A status packet on the wire."""
    return pack_instruction(packet_id, STATUS, bytes((error,)) + parameters)


def pack_fast_status(parts: list[tuple[int, int, bytes]]) -> bytes:
    """All motors' one answer to a fast sync read: (error, id, data) each. Not stuffed; every CRC is from the start."""
    length = 1 + sum(len(data) + 4 for _, _, data in parts)
    packet = HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))
    for error, motor_id, data in parts:
        packet += bytes((error, motor_id)) + data
        packet += crc16(packet).to_bytes(2, "little")
    return packet


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet as received; `intact` tells whether its CRC was right."""

    packet_id: int
    instruction: int
    parameters: bytes
    intact: bool
    wire: bytes


class PacketReader(PacketStream[Packet]):
    """Finds packets in bytes that come in pieces, among garbage. Status packets (of other devices) are passed over."""

    def __init__(self) -> None:
        super().__init__(HEADER, _PREFIX_BYTES)

    def _whole_bytes(self, prefix: bytes) -> int | None:
        length = int.from_bytes(prefix[5:7], "little")
        return _PREFIX_BYTES + length if 3 <= length <= MAXIMUM_LENGTH else None

    def _packet(self, wire: bytes) -> tuple[Packet | None, bool]:
        intact = crc16(wire[:-2]) == int.from_bytes(wire[-2:], "little")
        body = unstuff(wire[_PREFIX_BYTES:-2])
        return None if body[0] == STATUS else Packet(wire[4], body[0], body[1:], intact, wire), intact
