"""Checked transactions with protocol 1.0 motors (RX-28, MX-28), over dynamixel-sdk's packet handler.

The SDK packs, sends, receives and checks the checksum; around it, this file closes (dynamixel reference 6.1):

* an adapter that echoes: the request itself, which reads like a status, is recognised by its bytes and passed over;
* a status whose id or length is not the expected one never yields a value;
* the error byte: alarms of the motor (voltage, overheating, overload) come with a value, as `Status.alarms`; anything
  about the request (range, checksum, instruction, angle limit) is a refusal;
* GroupBulkRead, which ends in a TypeError and which an RX-28 does not have: two motors are read one after the other;
* `ping`, whose request equals the status of a motor with a voltage alarm, is a read of model number and firmware.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from dynamixel_sdk.protocol1_packet_handler import Protocol1PacketHandler

from drivers.dynamixel.bus import (
    BROADCAST,
    COMM_SUCCESS,
    READ,
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
from drivers.dynamixel.control_tables import PROTOCOL_1_ALARMS
from drivers.dynamixel.port import WaitingPort
from drivers.errors import BusError, DeviceError, ProtocolError

ERROR_NAMES = {0x02: "angle limit", 0x08: "range", 0x10: "checksum", 0x40: "instruction"}
"""Bits of the error byte that refuse a request."""

_STATUS_OVERHEAD = 6  # FF FF id length error … checksum


class PacketHandler(PacketSender, Protocol):
    """What is used of the SDK's packet handler; a packet is a list of byte values."""

    def rxPacket(self, port: WaitingPort) -> tuple[list[int], int]:
        """The next packet, and 0 or a negative SDK code."""
        ...


class Protocol1Bus:
    """`MotorBus` of protocol 1.0."""

    protocol = 1
    maximum_id = 253

    def __init__(self, port: WaitingPort) -> None:
        self._port = port
        self._requests = PackedRequests()
        self._handler: PacketHandler = Protocol1PacketHandler()
        self._sent: list[int] = []

    def ping(self, motor_id: int) -> PingAnswer:
        status = self.read(motor_id, 0, 3)
        return PingAnswer(int.from_bytes(status.parameters[:2], "little"), status.parameters[2], status.alert)

    def read(self, motor_id: int, address: int, length: int) -> Status:
        self._send(motor_id, READ, bytes((address, length)), reply_bytes=_STATUS_OVERHEAD + length)
        return self._receive(motor_id, length, f"read of {length} bytes at {address}")

    def write(self, motor_id: int, address: int, data: bytes) -> Status:
        self._send(motor_id, WRITE, bytes((address,)) + data, reply_bytes=_STATUS_OVERHEAD)
        return self._receive(motor_id, 0, f"write of {data.hex(' ')} at {address}")

    def reboot(self, motor_id: int) -> Status:
        raise DeviceError(
            motor_name(motor_id),
            "cannot be rebooted: protocol 1.0 has no such instruction.",
            help="Switch its power off and on; after an overload it is enough to set its Torque Limit again.",
        )

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        length, contents = sync_write_parameters(data)
        self._send(BROADCAST, SYNC_WRITE, bytes((address, length)) + contents, reply_bytes=0)

    def read_group(self, address: int, length: int, motor_ids: Sequence[int]) -> tuple[Status | DeviceError, ...]:
        """One read a motor: one that keeps silent does not keep the others from answering."""
        results: list[Status | DeviceError] = []
        for motor_id in motor_ids:
            try:
                results.append(self.read(motor_id, address, length))
            except BusError:
                raise
            except DeviceError as failure:
                results.append(failure)
        return tuple(results)

    def try_fast_read(self, address: int, length: int, motor_ids: Sequence[int]) -> bool:
        """Never: each motor is asked alone."""
        return False

    def surplus(self) -> bytes:
        return self._port.surplus()

    def _send(self, motor_id: int, instruction: int, parameters: bytes, *, reply_bytes: int) -> None:
        packet = self._requests.get(motor_id, instruction, parameters)
        if packet is not None:
            self._port.clearPort()
            self._port.writePort(packet)
        else:
            packet = [0, 0, motor_id, len(parameters) + 2, instruction, *parameters, 0]
            transmit(self._handler, self._port, packet, instruction)
            self._requests.keep(motor_id, instruction, parameters, packet)
        self._sent = packet
        self._port.setPacketTimeout(reply_bytes)

    def _receive(self, motor_id: int, length: int, request: str) -> Status:
        packet, result = self._handler.rxPacket(self._port)
        if result == COMM_SUCCESS and packet == self._sent:  # an echo
            packet, result = self._handler.rxPacket(self._port)
        refused = 0
        if result == COMM_SUCCESS and packet[2] == motor_id and len(packet) == packet[3] + 4 >= _STATUS_OVERHEAD:
            refused = packet[4] & ~PROTOCOL_1_ALARMS
            if not refused and len(packet) == _STATUS_OVERHEAD + length:
                return Status(motor_id, bool(packet[4]), bytes(packet[5:-1]), alarms=packet[4])
        self._port.distrust()
        if refused:
            reasons = ", ".join(name for bit, name in ERROR_NAMES.items() if refused & bit) or "unknown error"
            raise ProtocolError(motor_name(motor_id), f"{request} was refused: {reasons} (error byte {refused}).")
        expected = f"motor {motor_id} and {_STATUS_OVERHEAD + length} bytes"
        raise failed_reply(motor_id, request, packet, result, expected)
