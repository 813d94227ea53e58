"""Simulated tendon motors: protocol 2.0, byte for byte, in front of a plant that turns their shafts.

`SimulatedMotors` is a device on a line (`drivers.simulated.serial_lines`): bytes in, timed answers out. Its packer
shares no code with dynamixel-sdk or the driver. Instructions: ping, read, write, reg write, action, reboot, sync and
fast sync read, sync write, bulk read; others get an instruction error. Where documents are silent it does what they
make likeliest: a request with a wrong CRC is answered with a CRC error by the motor it names; in a sync read each motor
waits for the one before it, so that one silent motor silences those behind it.

What agrees with the protocol's documents here was not seen on a motor. Source: dynamixel reference 4.2, 6.2, 6.3.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from drivers.dynamixel.control_tables import XM430_W350, MotorModel
from drivers.errors import InputError
from drivers.simulated import dynamixel_packets as packets
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.dynamixel_packets import BROADCAST, Packet, PacketReader

FIRMWARE_ANSWER_NS = 50_000
"""From the end of a request to the answer with Return Delay Time 0 (dynamixel reference 5.1)."""
PARTIAL_PACKET_NS = 10_000_000
"""A packet that stops for longer than this in its middle is forgotten."""

PING, READ, WRITE, REG_WRITE, ACTION, REBOOT = 0x01, 0x02, 0x03, 0x04, 0x05, 0x08
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ, BULK_READ = 0x82, 0x83, 0x8A, 0x92
ERROR_INSTRUCTION, ERROR_CRC, ERROR_DATA_LENGTH = 2, 3, 5


class TendonPlant(Protocol):
    """What the motors' gears turn; motor 0 is the first of the settings."""

    def shaft_angle_rad(self, motor: int) -> float:
        """Angle of the output shaft, all turns counted."""
        ...

    def shaft_velocity_rad_s(self, motor: int) -> float:
        """Speed of the output shaft."""
        ...

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        """Torque on the output shaft until it is set anew; the gear's friction is the plant's."""
        ...


@dataclass(frozen=True, slots=True)
class SimulatedMotorSettings:
    """One motor on the simulated bus."""

    motor_id: int
    ticks_at_zero_angle: int = 0
    """Position register at shaft angle 0: a spool is never clamped exactly at 0."""
    direction: int = 1
    """+1: ticks grow with the shaft's angle; −1: mounted the other way round."""
    model: MotorModel = XM430_W350

    def __post_init__(self) -> None:
        if not 0 <= self.motor_id <= 252 or self.direction not in (1, -1) or abs(self.ticks_at_zero_angle) > 1_000_000:
            raise InputError(
                f"{self} is not possible; expected an id in 0…252, direction 1 or -1, ticks within 1 000 000."
            )


@dataclass(frozen=True, slots=True)
class Answer:
    """One packet of answer: it starts `delay_ns` after the bytes before it have left the wire."""

    delay_ns: int
    data: bytes


class SimulatedMotors:
    """All motors of one bus. `heard` keeps the newest intact requests, as they were on the wire."""

    def __init__(self, plant: TendonPlant, settings: Sequence[SimulatedMotorSettings]) -> None:
        if not settings or len({s.motor_id for s in settings}) != len(settings):
            raise InputError("simulated motors need at least one motor, each with its own id.")
        self.heard: deque[bytes] = deque(maxlen=256)
        self.motors = [SimulatedMotor(s.motor_id, s.model) for s in settings]
        self._settings = tuple(settings)
        self._plant = plant
        self._reader = PacketReader()
        self._registered: dict[int, tuple[int, bytes]] = {}
        self._last_byte_ns = 0
        self._last_instruction_ns = 0
        self._answers_to_drop = 0
        self._handlers: dict[int, Callable[[Packet, int], list[Answer]]] = {
            SYNC_READ: self._sync_read,
            FAST_SYNC_READ: self._fast_sync_read,
            BULK_READ: self._bulk_read,
            SYNC_WRITE: self._sync_write,
        }
        for index in range(len(self.motors)):
            self._control(index, 0, drive=False)

    def drop_answers(self, count: int) -> None:
        """Swallow the answers to the next `count` requests that would be answered."""
        self._answers_to_drop = count

    def trip(self, motor: int, error_bits: int) -> None:
        """Let a motor (by index) have a hardware error, such as 0x20 overload."""
        self.motors[motor].trip(error_bits)

    # the plant's side

    def control(self, now_ns: int, period_s: float) -> None:
        """One step of every motor's inner loop; the world calls it before each physics step of `period_s`."""
        silence_ns = now_ns - self._last_instruction_ns
        for index, motor in enumerate(self.motors):
            watchdog_ns = motor.watchdog_ns
            if watchdog_ns and silence_ns > watchdog_ns:
                motor.trip_watchdog()
            self._control(index, now_ns, drive=True)

    def _control(self, index: int, now_ns: int, drive: bool) -> None:
        settings, motor = self._settings[index], self.motors[index]
        sign = settings.direction
        angle_rad = sign * self._plant.shaft_angle_rad(index) + settings.ticks_at_zero_angle * motor.model.tick_rad
        torque_Nm = motor.control(now_ns, angle_rad, sign * self._plant.shaft_velocity_rad_s(index))
        if drive:
            self._plant.set_shaft_torque_Nm(index, sign * torque_Nm)

    # the host's side

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """All bytes that these bytes are answered with."""
        return b"".join(answer.data for answer in self.answers(data, now_ns))

    def answers(self, data: bytes, now_ns: int) -> list[Answer]:
        """The packets that these bytes are answered with, with their delays."""
        if now_ns - self._last_byte_ns > PARTIAL_PACKET_NS:
            self._reader.clear()
        self._last_byte_ns = now_ns
        answers: list[Answer] = []
        for packet in self._reader.feed(data):
            if packet.intact:
                self.heard.append(packet.wire)
                self._last_instruction_ns = now_ns
            reply = self._execute(packet, now_ns)
            if reply and self._answers_to_drop > 0:
                self._answers_to_drop -= 1
                continue
            answers += reply
        return answers

    def _execute(self, packet: Packet, now_ns: int) -> list[Answer]:
        if packet.instruction in self._handlers:
            broadcast = packet.packet_id == BROADCAST and packet.intact
            return self._handlers[packet.instruction](packet, now_ns) if broadcast else []
        replies = []
        for motor in self.motors:
            if packet.packet_id in (motor.motor_id, BROADCAST) and now_ns >= motor.silent_until_ns:
                reply = self._execute_one(motor, packet, now_ns)
                if reply is not None and (packet.packet_id != BROADCAST or packet.instruction == PING):
                    replies.append(reply)
        return replies

    def _execute_one(self, motor: SimulatedMotor, packet: Packet, now_ns: int) -> Answer | None:
        level, motor_id = motor.value("status_return_level"), motor.motor_id
        parameters, instruction = packet.parameters, packet.instruction
        if not packet.intact:
            return self._status(motor, ERROR_CRC) if level == 2 else None
        if instruction == PING:
            _, model_number = motor.read(0, 2)
            return self._status(motor, 0, model_number + motor.read(6, 1)[1])
        if instruction == READ:
            if len(parameters) != 4:
                return self._status(motor, ERROR_DATA_LENGTH) if level else None
            error, data = motor.read(*_address_and_length(parameters))
            return self._status(motor, error, data) if level else None
        error = 0
        if instruction in (WRITE, REG_WRITE):
            if len(parameters) < 3:
                error = ERROR_DATA_LENGTH
            elif instruction == WRITE:
                error = motor.write(int.from_bytes(parameters[:2], "little"), parameters[2:])
            else:
                self._registered[motor_id] = (int.from_bytes(parameters[:2], "little"), parameters[2:])
        elif instruction == ACTION:
            if motor_id in self._registered:
                error = motor.write(*self._registered.pop(motor_id))
        elif instruction == REBOOT:
            self._registered.pop(motor_id, None)
            answer = self._status(motor, 0)  # sent before it goes down, alert and all
            motor.reboot(now_ns)
            return answer if level == 2 else None
        else:
            error = ERROR_INSTRUCTION
        return self._status(motor, error) if motor.value("status_return_level") == 2 else None

    def _status(self, motor: SimulatedMotor, error: int, data: bytes = b"") -> Answer:
        return Answer(_delay_ns(motor), packets.pack_status(motor.motor_id, motor.alert | error, data))

    def _chain(self, requests: list[tuple[int, int, int]], now_ns: int) -> list[tuple[SimulatedMotor, int, bytes]]:
        """Motors that answer a group read of (id, address, length), in order, up to the first silent one."""
        by_id = {motor.motor_id: motor for motor in self.motors if now_ns >= motor.silent_until_ns}
        chain = []
        for motor_id, address, length in requests:
            motor = by_id.get(motor_id)
            if motor is None or motor.value("status_return_level") == 0:
                break
            chain.append((motor, *motor.read(address, length)))
        return chain

    def _sync_read(self, packet: Packet, now_ns: int) -> list[Answer]:
        if len(packet.parameters) < 5:
            return []
        address, length = _address_and_length(packet.parameters[:4])
        chain = self._chain([(motor_id, address, length) for motor_id in packet.parameters[4:]], now_ns)
        return [self._status(motor, error, data) for motor, error, data in chain]

    def _fast_sync_read(self, packet: Packet, now_ns: int) -> list[Answer]:
        if len(packet.parameters) < 5:
            return []
        address, length = _address_and_length(packet.parameters[:4])
        motor_ids = packet.parameters[4:]
        chain = self._chain([(motor_id, address, length) for motor_id in motor_ids], now_ns)
        if not chain or len(chain) < len(motor_ids):
            return []  # the packet could not be completed
        parts = [(motor.alert | error, motor.motor_id, data.ljust(length, b"\0")) for motor, error, data in chain]
        return [Answer(sum(_delay_ns(motor) for motor, _, _ in chain), packets.pack_fast_status(parts))]

    def _bulk_read(self, packet: Packet, now_ns: int) -> list[Answer]:
        parameters = packet.parameters
        if len(parameters) % 5:
            return []
        requests = [
            (parameters[i], *_address_and_length(parameters[i + 1 : i + 5])) for i in range(0, len(parameters), 5)
        ]
        return [self._status(motor, error, data) for motor, error, data in self._chain(requests, now_ns)]

    def _sync_write(self, packet: Packet, now_ns: int) -> list[Answer]:
        if len(packet.parameters) >= 4:
            address, length = _address_and_length(packet.parameters[:4])
            body = packet.parameters[4:]
            if length and len(body) % (1 + length) == 0:
                content = {body[i]: body[i + 1 : i + 1 + length] for i in range(0, len(body), 1 + length)}
                for motor in self.motors:
                    if motor.motor_id in content and now_ns >= motor.silent_until_ns:
                        motor.write(address, content[motor.motor_id])  # a refusal is silent
        return []


def _address_and_length(parameters: bytes) -> tuple[int, int]:
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")


def _delay_ns(motor: SimulatedMotor) -> int:
    return FIRMWARE_ANSWER_NS + round(motor.value("return_delay_time") * motor.model.return_delay_unit_s * 1e9)
