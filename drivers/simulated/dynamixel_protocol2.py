"""What simulated motors do with the instructions of protocol 2.0.

All of the reference's: ping, read, write, reg write, action, factory reset, reboot, clear, sync read and write, fast
sync read, bulk read and write, fast bulk read; others get an instruction error. Where documents are silent it is what
they make likeliest: a request with a wrong CRC is answered with a CRC error by the motor it names; in a group read each
motor waits for the one before it, so that a silent motor silences those behind it; a factory reset with torque on, or
of all registers by broadcast, fails. Source: dynamixel reference 4.2, 6.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.simulated import dynamixel_packets as packets
from drivers.simulated.dynamixel_answer import Answer, delay_ns
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.dynamixel_packets import BROADCAST, Packet, PacketReader
from drivers.simulated.dynamixel_table import Refusal

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x10
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A
MULTI_TURN = bytes.fromhex("01 44 58 4C 22")
"""What Clear wants to see for the multi-turn position."""
_RESETS: dict[bytes, tuple[str, ...]] = {b"\xff": (), b"\x01": ("id",), b"\x02": ("id", "baud_rate")}
_NO_SHADOW = 253

_Request = tuple[int, int, int]
"""Motor id, address, length."""


class Protocol2:
    """The instructions of one bus; `fast_reads` False is firmware that does not know them."""

    def __init__(self, fast_reads: bool = True) -> None:
        self.reader = PacketReader()
        self._registered: dict[int, tuple[int, bytes]] = {}
        self._groups: dict[int, Callable[[bytes, Sequence[SimulatedMotor]], list[Answer]]] = {
            SYNC_READ: self._sync_read,
            BULK_READ: self._bulk_read,
            SYNC_WRITE: self._sync_write,
            BULK_WRITE: self._bulk_write,
        }
        if fast_reads:
            self._groups |= {FAST_SYNC_READ: self._fast_sync_read, FAST_BULK_READ: self._fast_bulk_read}

    def execute(self, packet: Packet, hearing: Sequence[SimulatedMotor], now_ns: int) -> list[Answer]:
        """Have the motors that hear it do what it asks; their answers in order. Those with one id answer at once."""
        if packet.instruction in (FAST_SYNC_READ, FAST_BULK_READ, *self._groups):
            group = self._groups.get(packet.instruction)
            if group is None or packet.packet_id != BROADCAST or not packet.intact:
                return []
            return group(packet.parameters, hearing)
        answers = []
        for motor in hearing:
            shadowed = packet.packet_id < _NO_SHADOW and packet.packet_id == motor.value("secondary_id")
            if packet.packet_id in (motor.motor_id, BROADCAST) or shadowed:
                answer = self._execute_one(motor, packet, now_ns)
                told = packet.packet_id == motor.motor_id or packet.instruction == PING
                if answer is not None and told and not shadowed and not motor.mute:
                    answers.append(answer)
        return answers

    def _execute_one(self, motor: SimulatedMotor, packet: Packet, now_ns: int) -> Answer | None:
        level = motor.value("status_return_level")
        parameters, instruction = packet.parameters, packet.instruction
        if not packet.intact:
            return _status(motor, Refusal.CRC) if level == 2 else None
        if instruction == PING:
            return _status(motor, 0, motor.read(0, 2)[1] + motor.read(6, 1)[1])
        if instruction == READ:
            if len(parameters) != 4:
                return _status(motor, Refusal.DATA_LENGTH) if level else None
            error, data = motor.read(*_address_and_length(parameters))
            return _status(motor, error, data) if level else None
        if instruction in (FACTORY_RESET, REBOOT):
            self._registered.pop(motor.motor_id, None)
            answer = self._start_anew(motor, packet, now_ns)
            return answer if level == 2 else None
        error = self._obey(motor, instruction, parameters)
        return _status(motor, error) if motor.value("status_return_level") == 2 else None

    def _obey(self, motor: SimulatedMotor, instruction: int, parameters: bytes) -> int:
        if instruction in (WRITE, REG_WRITE):
            if len(parameters) < 3:
                return Refusal.DATA_LENGTH
            address, data = int.from_bytes(parameters[:2], "little"), parameters[2:]
            if instruction == WRITE:
                return motor.write(address, data)
            self._registered[motor.motor_id] = (address, data)
            motor.put("registered_instruction", 1)
            return Refusal.NONE
        if instruction == ACTION:
            waiting = self._registered.pop(motor.motor_id, None)
            motor.put("registered_instruction", 0)
            return Refusal.NONE if waiting is None else motor.write(*waiting)
        if instruction == CLEAR:
            if parameters != MULTI_TURN:
                return Refusal.DATA_RANGE
            return Refusal.NONE if motor.clear_turns() else Refusal.RESULT_FAIL
        return Refusal.INSTRUCTION

    @staticmethod
    def _start_anew(motor: SimulatedMotor, packet: Packet, now_ns: int) -> Answer:
        answer = _status(motor, 0)  # sent before it goes down, alert and all
        if packet.instruction == REBOOT:
            motor.reboot(now_ns)
            return answer
        keep = _RESETS.get(packet.parameters)
        if keep is None:
            return _status(motor, Refusal.DATA_RANGE)
        refused = (packet.packet_id == BROADCAST and not keep) or not motor.factory_reset(now_ns, keep)
        return _status(motor, Refusal.RESULT_FAIL) if refused else answer

    # groups

    def _sync_read(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        return [_status(motor, error, data) for motor, error, data in _chain(_sync_requests(parameters), hearing)]

    def _bulk_read(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        return [_status(motor, error, data) for motor, error, data in _chain(_bulk_requests(parameters), hearing)]

    def _fast_sync_read(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        return _fast_answer(_sync_requests(parameters), hearing)

    def _fast_bulk_read(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        return _fast_answer(_bulk_requests(parameters), hearing)

    def _sync_write(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        if len(parameters) >= 4:
            address, length = _address_and_length(parameters[:4])
            body = parameters[4:]
            if length and len(body) % (1 + length) == 0:
                for start in range(0, len(body), 1 + length):
                    _write_silently(hearing, body[start], address, body[start + 1 : start + 1 + length])
        return []

    def _bulk_write(self, parameters: bytes, hearing: Sequence[SimulatedMotor]) -> list[Answer]:
        start = 0
        while start + 5 < len(parameters):
            address, length = _address_and_length(parameters[start + 1 : start + 5])
            end = start + 5 + length
            if end > len(parameters):
                break
            _write_silently(hearing, parameters[start], address, parameters[start + 5 : end])
            start = end
        return []


def _status(motor: SimulatedMotor, error: int, data: bytes = b"") -> Answer:
    wire = packets.pack_status(motor.motor_id, motor.alert | error, data)
    return Answer(delay_ns(motor), wire, motor.motor_id)


def _write_silently(hearing: Sequence[SimulatedMotor], motor_id: int, address: int, data: bytes) -> None:
    for motor in hearing:
        if motor_id == motor.motor_id or (motor_id < _NO_SHADOW and motor_id == motor.value("secondary_id")):
            motor.write(address, data)  # a refusal is silent


def _chain(requests: list[_Request], hearing: Sequence[SimulatedMotor]) -> list[tuple[SimulatedMotor, int, bytes]]:
    """Motors that answer a group read, in order, up to the first silent one."""
    by_id = {motor.motor_id: motor for motor in hearing if not motor.mute}
    chain = []
    for motor_id, address, length in requests:
        motor = by_id.get(motor_id)
        if motor is None or motor.value("status_return_level") == 0:
            break
        chain.append((motor, *motor.read(address, length)))
    return chain


def _fast_answer(requests: list[_Request], hearing: Sequence[SimulatedMotor]) -> list[Answer]:
    chain = _chain(requests, hearing)
    if not chain or len(chain) < len(requests):
        return []  # the packet could not be completed
    parts = [
        (motor.alert | error, motor.motor_id, data.ljust(length, b"\0"))
        for (motor, error, data), (_, _, length) in zip(chain, requests, strict=True)
    ]
    return [Answer(sum(delay_ns(motor) for motor, _, _ in chain), packets.pack_fast_status(parts), BROADCAST)]


def group_requests(packet: Packet) -> list[_Request]:
    """What a group read asks, motor by motor."""
    bulk = packet.instruction in (BULK_READ, FAST_BULK_READ)
    return _bulk_requests(packet.parameters) if bulk else _sync_requests(packet.parameters)


def _sync_requests(parameters: bytes) -> list[_Request]:
    if len(parameters) < 5:
        return []
    address, length = _address_and_length(parameters[:4])
    return [(motor_id, address, length) for motor_id in parameters[4:]]


def _bulk_requests(parameters: bytes) -> list[_Request]:
    if len(parameters) % 5:
        return []
    return [(parameters[i], *_address_and_length(parameters[i + 1 : i + 5])) for i in range(0, len(parameters), 5)]


def _address_and_length(parameters: bytes) -> tuple[int, int]:
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")
