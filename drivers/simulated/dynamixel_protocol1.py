"""What simulated motors do with the instructions of protocol 1.0.

Ping, read, write, reg write, action, factory reset, sync write, and bulk read of all but the RX-28, which does not
have it. Broadcasts are not answered, except a bulk read, in which each motor waits for the one before it. Alarms of the
motor and errors of the request share the status's error byte. Which bit answers a write to a read-only address is not
documented: range here, as for all that is outside of what can be written. Source: dynamixel reference 4.1, 6.2.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.dynamixel.control_tables import RX_28
from drivers.simulated import dynamixel_packets1 as packets
from drivers.simulated.dynamixel_answer import Answer, delay_ns
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.dynamixel_packets import BROADCAST, Packet
from drivers.simulated.dynamixel_packets1 import PacketReader
from drivers.simulated.dynamixel_table import Refusal

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, SYNC_WRITE, BULK_READ = 1, 2, 3, 4, 5, 6, 0x83, 0x92
ANGLE_LIMIT, RANGE, CHECKSUM, INSTRUCTION = 0x02, 0x08, 0x10, 0x40
"""Bits of the error byte that concern the request."""
_BIT_OF = {
    Refusal.NONE: 0,
    Refusal.DATA_LIMIT: ANGLE_LIMIT,
    Refusal.DATA_RANGE: RANGE,
    Refusal.DATA_LENGTH: RANGE,
    Refusal.ACCESS: RANGE,
}


class Protocol1:
    """The instructions of one bus."""

    def __init__(self) -> None:
        self.reader = PacketReader()
        self._registered: dict[int, tuple[int, bytes]] = {}

    def execute(self, packet: Packet, hearing: Sequence[SimulatedMotor], now_ns: int) -> list[Answer]:
        """Have the motors that hear it do what it asks; their answers in order. Those with one id answer at once."""
        if packet.instruction in (SYNC_WRITE, BULK_READ):
            if packet.packet_id != BROADCAST or not packet.intact:
                return []
            if packet.instruction == BULK_READ:
                return _bulk_read(packet.parameters, hearing)
            _sync_write(packet.parameters, hearing)
            return []
        answers = []
        for motor in hearing:
            if packet.packet_id in (motor.motor_id, BROADCAST):
                answer = self._execute_one(motor, packet, now_ns)
                if answer is not None and packet.packet_id != BROADCAST and not motor.mute:
                    answers.append(answer)
        return answers

    def _execute_one(self, motor: SimulatedMotor, packet: Packet, now_ns: int) -> Answer | None:
        level = motor.value("status_return_level")
        parameters, instruction = packet.parameters, packet.instruction
        if not packet.intact:
            return _status(motor, CHECKSUM) if level == 2 else None
        if instruction == PING:
            return _status(motor, 0)
        if instruction == READ:
            if len(parameters) != 2:
                return _status(motor, INSTRUCTION) if level else None
            error, data = motor.read(parameters[0], parameters[1])
            return _status(motor, _BIT_OF[Refusal(error)], data) if level else None
        if instruction == FACTORY_RESET:
            answer = _status(motor, 0)
            motor.put("torque_enable", 0)
            motor.factory_reset(now_ns)
            return answer if level == 2 else None
        error_bits = self._obey(motor, instruction, parameters)
        return _status(motor, error_bits) if motor.value("status_return_level") == 2 else None

    def _obey(self, motor: SimulatedMotor, instruction: int, parameters: bytes) -> int:
        if instruction in (WRITE, REG_WRITE) and len(parameters) >= 2:
            if instruction == WRITE:
                return _BIT_OF[Refusal(motor.write(parameters[0], parameters[1:]))]
            self._registered[motor.motor_id] = (parameters[0], parameters[1:])
            motor.put("registered_instruction", 1)
            return 0
        if instruction == ACTION and motor.motor_id in self._registered:
            motor.put("registered_instruction", 0)
            return _BIT_OF[Refusal(motor.write(*self._registered.pop(motor.motor_id)))]
        return INSTRUCTION


def _status(motor: SimulatedMotor, error_bits: int, data: bytes = b"") -> Answer:
    return Answer(delay_ns(motor), packets.pack(motor.motor_id, motor.alarms | error_bits, data), motor.motor_id)


def _sync_write(parameters: bytes, hearing: Sequence[SimulatedMotor]) -> None:
    if len(parameters) < 2 or not parameters[1] or (len(parameters) - 2) % (1 + parameters[1]):
        return
    address, length = parameters[:2]
    for start in range(2, len(parameters), 1 + length):
        for motor in hearing:
            if motor.motor_id == parameters[start]:
                motor.write(address, parameters[start + 1 : start + 1 + length])  # a refusal is silent


def _bulk_read(parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
    if not parameters or parameters[0] != 0 or len(parameters) % 3 != 1:
        return []
    able = {motor.motor_id: motor for motor in hearing if motor.model is not RX_28 and not motor.mute}
    answers = []
    for start in range(1, len(parameters), 3):
        length, motor_id, address = parameters[start : start + 3]
        motor = able.get(motor_id)
        if motor is None or motor.value("status_return_level") == 0:
            break
        error, data = motor.read(address, length)
        answers.append(_status(motor, _BIT_OF[Refusal(error)], data))
    return answers
