"""Checked transactions with protocol 2.0 motors, over dynamixel-sdk's packet handler.

The SDK packs, sends, receives and checks the CRC; around it, this file closes what SDK 4.1.0 leaves open (dynamixel
reference 4.3 A18x, 6.1):

* its byte stuffing on transmit gets lost; and on receive, after one stuffed group, it also eats an FD out of plain
  `FF FD FD`: both replaced;
* a status whose id or length is not the expected one, or that carries an error number, never yields a value;
* the error byte of every reply to a sync read is looked at, and the alert bit handed on.

Errors: NoReplyError (silence), ProtocolError (anything but the expected reply, or a refusal), BusError (line gone).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from drivers.dynamixel.port import WaitingPort
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x08, 0x82, 0x83

ALERT_BIT = 0x80
ERROR_NAMES = {
    1: "result fail",
    2: "instruction error",
    3: "CRC error",
    4: "data range error",
    5: "data length error",
    6: "data limit error",
    7: "access error",
}

_HEADER_BYTES = 7  # FF FF FD 00 id length_L length_H
_STATUS_OVERHEAD = 11  # header, instruction, error, CRC
_COMM_SUCCESS, _COMM_RX_TIMEOUT = 0, -3001
_HEADER, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


def _crc_table() -> tuple[int, ...]:
    table = []
    for index in range(256):
        value = index << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
        table.append(value & 0xFFFF)
    return tuple(table)


_CRC_TABLE = _crc_table()


class PacketHandler(Protocol):
    """What is used of the SDK's packet handler; a packet is a list of byte values."""

    def txPacket(self, port: WaitingPort, txpacket: list[int]) -> int:
        """Stuff, add header and CRC, send; 0 or a negative SDK code."""
        ...

    def rxPacket(self, port: WaitingPort, fast_option: bool) -> tuple[list[int], int]:
        """The next status packet, unstuffed, and 0 or a negative SDK code."""
        ...


class StuffingPacketHandler(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK is untyped, so its classes are Any
    """The SDK's handler with stuffing that works, and a CRC table that is not built anew for each packet."""

    def updateCRC(self, crc_accum: int, data_blk_ptr: Sequence[int], data_blk_size: int) -> int:
        """CRC-16, polynomial 0x8005, of the first `data_blk_size` bytes."""
        crc = crc_accum
        table = _CRC_TABLE
        for byte in data_blk_ptr[:data_blk_size]:
            crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ byte]
        return crc

    def addStuffing(self, packet: list[int]) -> list[int]:
        """Put FD behind every FF FF FD from the instruction to the last parameter, in place."""
        return _replace_body(packet, _HEADER, _STUFFED)

    def removeStuffing(self, packet: list[int]) -> list[int]:
        """The inverse of `addStuffing`, in place."""
        return _replace_body(packet, _STUFFED, _HEADER)


def _replace_body(packet: list[int], old: bytes, new: bytes) -> list[int]:
    body = bytes(packet[_HEADER_BYTES:-2])
    if old in body:
        body = body.replace(old, new)
        packet[_HEADER_BYTES:-2] = body
        packet[5:7] = (len(body) + 2).to_bytes(2, "little")
    return packet


@dataclass(frozen=True, slots=True)
class Status:
    """A good reply: from whom, whether its alert bit is set, and the parameters."""

    motor_id: int
    alert: bool
    parameters: bytes


class DynamixelBus:
    """Requests on one bus, each answered or failed before the next."""

    def __init__(self, port: WaitingPort) -> None:
        self._port = port
        self._handler: PacketHandler = StuffingPacketHandler()

    def ping(self, motor_id: int) -> tuple[int, int, bool]:
        """Model number, firmware version and alert of a motor."""
        self._send(motor_id, PING, b"", reply_bytes=_STATUS_OVERHEAD + 3)
        status = self._receive(motor_id, 3, "ping")
        return int.from_bytes(status.parameters[:2], "little"), status.parameters[2], status.alert

    def read(self, motor_id: int, address: int, length: int) -> Status:
        """`length` bytes from `address`."""
        parameters = address.to_bytes(2, "little") + length.to_bytes(2, "little")
        self._send(motor_id, READ, parameters, reply_bytes=_STATUS_OVERHEAD + length)
        return self._receive(motor_id, length, f"read of {length} bytes at {address}")

    def write(self, motor_id: int, address: int, data: bytes) -> Status:
        """Write `data` at `address` and wait for the acknowledgement."""
        self._send(motor_id, WRITE, address.to_bytes(2, "little") + data, reply_bytes=_STATUS_OVERHEAD)
        return self._receive(motor_id, 0, f"write of {data.hex(' ')} at {address}")

    def reboot(self, motor_id: int) -> Status:
        """Restart a motor: the only way out of a hardware error. It lets go, and is silent for some 0.3 s."""
        self._send(motor_id, REBOOT, b"", reply_bytes=_STATUS_OVERHEAD)
        return self._receive(motor_id, 0, "reboot")

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        """Write to several motors at once, the same length to each. No one acknowledges it."""
        length = len(next(iter(data.values())))
        parameters = bytearray(address.to_bytes(2, "little") + length.to_bytes(2, "little"))
        for motor_id, content in data.items():
            if len(content) != length:
                raise ValueError("a sync write has the same length for every motor")
            parameters.append(motor_id)
            parameters += content
        self._send(BROADCAST, SYNC_WRITE, bytes(parameters), reply_bytes=0)

    def sync_read(self, address: int, length: int, motor_ids: Sequence[int]) -> tuple[Status, ...]:
        """`length` bytes from `address` of each motor, in the order asked: all of them, or an error."""
        parameters = address.to_bytes(2, "little") + length.to_bytes(2, "little") + bytes(motor_ids)
        self._send(BROADCAST, SYNC_READ, parameters, reply_bytes=(_STATUS_OVERHEAD + length) * len(motor_ids))
        request = f"sync read of {length} bytes at {address}"
        return tuple(self._receive(motor_id, length, request) for motor_id in motor_ids)

    def _send(self, motor_id: int, instruction: int, parameters: bytes, *, reply_bytes: int) -> None:
        length = len(parameters) + 3
        packet = [0, 0, 0, 0, motor_id, length & 0xFF, length >> 8, instruction, *parameters, 0, 0]
        try:
            result = self._handler.txPacket(self._port, packet)
        finally:
            self._port.is_using = False  # the SDK leaves it set when the line throws
        if result != _COMM_SUCCESS:
            raise BusError("tendon motor bus", f"request 0x{instruction:02X} was not sent (SDK code {result}).")
        self._port.setPacketTimeout(reply_bytes)

    def _receive(self, motor_id: int, length: int, request: str) -> Status:
        packet, result = self._handler.rxPacket(self._port, False)
        refusal = ""
        if result == _COMM_SUCCESS and (
            packet[4] == motor_id
            and len(packet) == _HEADER_BYTES + int.from_bytes(packet[5:7], "little")
            and len(packet) >= _STATUS_OVERHEAD
        ):
            error_number = packet[8] & ~ALERT_BIT
            if not error_number and len(packet) == _STATUS_OVERHEAD + length:
                return Status(motor_id, bool(packet[8] & ALERT_BIT), bytes(packet[9:-2]))
            if error_number:
                refusal = f"{request} was refused: {ERROR_NAMES.get(error_number, 'unknown error')} ({error_number})."
        self._port.distrust()  # more may be on its way, from this motor or from the next of a sync read
        if refusal:
            raise ProtocolError(_name(motor_id), refusal)
        raise self._failure(motor_id, length, request, packet, result)

    @staticmethod
    def _failure(motor_id: int, length: int, request: str, packet: list[int], result: int) -> DeviceError:
        if result == _COMM_RX_TIMEOUT:
            return NoReplyError(
                _name(motor_id),
                f"no reply to {request}.",
                help="Check power, id, baud rate, and that the adapter's latency timer is 1 ms.",
            )
        if result != _COMM_SUCCESS:
            return ProtocolError(_name(motor_id), f"damaged reply to {request}: {bytes(packet).hex(' ') or 'nothing'}.")
        return ProtocolError(
            _name(motor_id),
            f"reply to {request} from motor {packet[4]} with {len(packet)} bytes; expected motor {motor_id} "
            f"and {_STATUS_OVERHEAD + length} bytes.",
        )


def _name(motor_id: int) -> str:
    return f"tendon motor {motor_id}"
