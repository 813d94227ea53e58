"""Checked transactions with protocol 2.0 motors, over dynamixel-sdk's packet handler.

The SDK packs, sends, receives and checks the CRC; around it, this file closes what SDK 4.1.0 leaves open (dynamixel
reference 4.3 A18x, 6.1):

* its byte stuffing on transmit gets lost; and on receive, after one stuffed group, it also eats an FD out of plain
  `FF FD FD`: both replaced;
* a status whose id or length is not the expected one, or that carries an error number, never yields a value;
* the error byte of every reply to a group read is looked at, and the alert bit handed on;
* a fast sync read is taken apart here: its parts carry their own errors, which the SDK throws away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from drivers.dynamixel.bus import (
    BROADCAST,
    COMM_SUCCESS,
    FAST_SYNC_READ,
    PING,
    READ,
    REBOOT,
    SYNC_READ,
    SYNC_WRITE,
    WRITE,
    PackedRequests,
    PacketSender,
    PingAnswer,
    Status,
    failed_reply,
    motor_name,
    sync_write_parameters,
    transmit,
)
from drivers.dynamixel.port import WaitingPort
from drivers.errors import BusError, DeviceError, ProtocolError

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
_FAST_OVERHEAD = 8  # header, instruction; then error, id, data, CRC for each motor
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


class PacketHandler(PacketSender, Protocol):
    """What is used of the SDK's packet handler; a packet is a list of byte values."""

    def rxPacket(self, port: WaitingPort, fast_option: bool) -> tuple[list[int], int]:
        """The next status packet, unstuffed unless `fast_option`, and 0 or a negative SDK code."""
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


class Protocol2Bus:
    """`MotorBus` of protocol 2.0. `fast`: group reads are fast sync reads, which not every firmware has."""

    protocol = 2
    maximum_id = 252

    def __init__(self, port: WaitingPort) -> None:
        self.fast = False
        self._port = port
        self._requests = PackedRequests()
        self._handler: PacketHandler = StuffingPacketHandler()

    def ping(self, motor_id: int) -> PingAnswer:
        self._send(motor_id, PING, b"", reply_bytes=_STATUS_OVERHEAD + 3)
        status = self._receive(motor_id, 3, "ping")
        return PingAnswer(int.from_bytes(status.parameters[:2], "little"), status.parameters[2], status.alert)

    def read(self, motor_id: int, address: int, length: int) -> Status:
        self._send(motor_id, READ, _place(address, length), reply_bytes=_STATUS_OVERHEAD + length)
        return self._receive(motor_id, length, f"read of {length} bytes at {address}")

    def write(self, motor_id: int, address: int, data: bytes) -> Status:
        self._send(motor_id, WRITE, address.to_bytes(2, "little") + data, reply_bytes=_STATUS_OVERHEAD)
        return self._receive(motor_id, 0, f"write of {data.hex(' ')} at {address}")

    def reboot(self, motor_id: int) -> Status:
        """Restart a motor: the only way out of a hardware error. It lets go, and is silent for some 0.3 s."""
        self._send(motor_id, REBOOT, b"", reply_bytes=_STATUS_OVERHEAD)
        return self._receive(motor_id, 0, "reboot")

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        length, contents = sync_write_parameters(data)
        self._send(BROADCAST, SYNC_WRITE, _place(address, length) + contents, reply_bytes=0)

    def read_group(self, address: int, length: int, motor_ids: Sequence[int]) -> tuple[Status | DeviceError, ...]:
        """A sync read. The first failure is everybody's behind it: they wait for each other's answers."""
        if self.fast:
            return self._fast_sync_read(address, length, motor_ids)
        parameters = _place(address, length) + bytes(motor_ids)
        self._send(BROADCAST, SYNC_READ, parameters, reply_bytes=(_STATUS_OVERHEAD + length) * len(motor_ids))
        request = f"sync read of {length} bytes at {address}"
        results: list[Status | DeviceError] = []
        for motor_id in motor_ids:
            try:
                results.append(self._receive(motor_id, length, request))
            except BusError:
                raise
            except DeviceError as failure:
                results += [failure] * (len(motor_ids) - len(results))
                break
        return tuple(results)

    def try_fast_read(self, address: int, length: int, motor_ids: Sequence[int]) -> bool:
        """Tried once: firmware that does not know a fast sync read keeps silent."""
        results = self._fast_sync_read(address, length, motor_ids)
        self.fast = all(isinstance(result, Status) for result in results)
        return self.fast

    def surplus(self) -> bytes:
        return self._port.surplus()

    def _fast_sync_read(self, address: int, length: int, motor_ids: Sequence[int]) -> tuple[Status | DeviceError, ...]:
        reply_bytes = _FAST_OVERHEAD + (length + 4) * len(motor_ids)
        self._send(BROADCAST, FAST_SYNC_READ, _place(address, length) + bytes(motor_ids), reply_bytes=reply_bytes)
        packet, result = self._handler.rxPacket(self._port, True)
        request = f"fast sync read of {length} bytes at {address}"
        parts = _fast_parts(packet, length, len(motor_ids))
        if result != COMM_SUCCESS or packet[4] != BROADCAST or [part[1] for part in parts] != list(motor_ids):
            self._port.distrust()
            expected = f"{reply_bytes} bytes of motors {', '.join(map(str, motor_ids))}"
            return (failed_reply(motor_ids[0], request, packet, result, expected),) * len(motor_ids)
        return tuple(
            _refusal(motor_id, request, error & ~ALERT_BIT)
            if error & ~ALERT_BIT
            else Status(motor_id, bool(error & ALERT_BIT), data)
            for error, motor_id, data in parts
        )

    def _send(self, motor_id: int, instruction: int, parameters: bytes, *, reply_bytes: int) -> None:
        packet = self._requests.get(motor_id, instruction, parameters)
        if packet is not None:
            self._port.clearPort()
            self._port.writePort(packet)
        else:
            length = len(parameters) + 3
            packet = [0, 0, 0, 0, motor_id, length & 0xFF, length >> 8, instruction, *parameters, 0, 0]
            transmit(self._handler, self._port, packet, instruction)
            self._requests.keep(motor_id, instruction, parameters, packet)
        self._port.setPacketTimeout(reply_bytes)

    def _receive(self, motor_id: int, length: int, request: str) -> Status:
        packet, result = self._handler.rxPacket(self._port, False)
        refused = 0
        if result == COMM_SUCCESS and (
            packet[4] == motor_id
            and len(packet) == _HEADER_BYTES + int.from_bytes(packet[5:7], "little")
            and len(packet) >= _STATUS_OVERHEAD
        ):
            refused = packet[8] & ~ALERT_BIT
            if not refused and len(packet) == _STATUS_OVERHEAD + length:
                return Status(motor_id, bool(packet[8] & ALERT_BIT), bytes(packet[9:-2]))
        self._port.distrust()  # more may be on its way, from this motor or from the next of a sync read
        if refused:
            raise _refusal(motor_id, request, refused)
        expected = f"motor {motor_id} and {_STATUS_OVERHEAD + length} bytes"
        raise failed_reply(motor_id, request, packet, result, expected)


def _place(address: int, length: int) -> bytes:
    return address.to_bytes(2, "little") + length.to_bytes(2, "little")


def _refusal(motor_id: int, request: str, number: int) -> ProtocolError:
    reason = ERROR_NAMES.get(number, "unknown error")
    return ProtocolError(motor_name(motor_id), f"{request} was refused: {reason} ({number}).")


def _fast_parts(packet: Sequence[int], length: int, count: int) -> list[tuple[int, int, bytes]]:
    """Error, id and data of each part; empty if the packet has not the length of `count` parts."""
    size = length + 4
    if len(packet) != _FAST_OVERHEAD + size * count:
        return []
    starts = range(_FAST_OVERHEAD, len(packet), size)
    return [(packet[at], packet[at + 1], bytes(packet[at + 2 : at + 2 + length])) for at in starts]
