"""Motors made of literal bytes on a virtual line: they share neither packing nor register tables with the driver.

Both protocols are packed here byte by byte from dynamixel reference 4.1 and 4.2; what a motor keeps is a plain memory
image, and where its torque, position and so on lie is written out again in `PLACES`. Such a motor does not move; the
tests write into it what it shall say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.port import WaitingPort

PLACES = {  # reference 2.2, 2.3: address and size
    1: {"model": (0, 2), "firmware": (2, 1), "delay": (5, 1), "lower": (6, 2), "upper": (8, 2), "max_torque": (14, 2)}
    | {"shutdown": (18, 1), "hottest": (11, 1)}
    | {"level": (16, 1), "torque": (24, 1), "gain": (28, 1), "goal": (30, 2), "limit": (34, 2), "position": (36, 2)}
    | {"velocity": (38, 2), "effort": (40, 2), "voltage": (42, 1), "temperature": (43, 1)},
    2: {"drive": (10, 1), "shutdown": (63, 1), "second_id": (12, 1), "hottest": (31, 1)}
    | {"model": (0, 2), "firmware": (6, 1), "delay": (9, 1), "mode": (11, 1), "offset": (20, 4), "pwm_limit": (36, 2)}
    | {"current_limit": (38, 2), "torque": (64, 1), "level": (68, 1), "hardware": (70, 1), "gain": (84, 2)}
    | {"watchdog": (98, 1), "goal_pwm": (100, 2), "goal_current": (102, 2), "goal": (116, 4), "effort": (126, 2)}
    | {"velocity": (128, 4), "position": (132, 4), "voltage": (144, 2), "temperature": (146, 1)}
    | {"max_position": (48, 4), "min_position": (52, 4)},
}
DEFAULTS = {
    1: {"firmware": 40, "delay": 250, "lower": 0, "max_torque": 1023, "level": 2, "limit": 1023, "voltage": 120}
    | {"temperature": 30, "gain": 32, "shutdown": 36, "hottest": 80},
    2: {"firmware": 45, "delay": 250, "mode": 3, "pwm_limit": 885, "current_limit": 1193, "level": 2, "goal_pwm": 885}
    | {"goal_current": 1193, "voltage": 120, "temperature": 30, "max_position": 4095, "gain": 800}
    | {"shutdown": 52, "second_id": 255, "hottest": 72},
}


def crc16(data: bytes) -> int:
    """Bit by bit: polynomial 0x8005, most significant bit first."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def status2(motor_id: int, error: int, data: bytes) -> bytes:
    """A protocol 2.0 status packet."""
    body = (bytes((0x55, error)) + data).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = b"\xff\xff\xfd\x00" + bytes((motor_id,)) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + crc16(packet).to_bytes(2, "little")


def status1(motor_id: int, error: int, data: bytes) -> bytes:
    """A protocol 1.0 status packet."""
    body = bytes((motor_id, len(data) + 2, error)) + data
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))


@dataclass
class LiteralMotor:
    """One motor's memory and manners."""

    motor_id: int
    model: int
    protocol: int = 2
    silent: bool = False
    maps: bool = True
    """It has indirect addresses."""
    fast: bool = True
    """It knows fast sync read."""
    alarms: int = 0
    """Protocol 1.0: bits of the error byte."""
    memory: bytearray = field(default_factory=lambda: bytearray(1024))
    writes: list[tuple[int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name, value in {**DEFAULTS[self.protocol], "model": self.model}.items():
            self[name] = value
        if self.protocol == 1:
            self["upper"] = 1023 if self.model == 28 else 4095
        self.forget_map()

    def __setitem__(self, name: str, value: int) -> None:
        address, size = PLACES[self.protocol][name]
        self.memory[address : address + size] = (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")

    def __getitem__(self, name: str) -> int:
        address, size = PLACES[self.protocol][name]
        return int.from_bytes(self.memory[address : address + size], "little")

    def forget_map(self) -> None:
        for index in range(28):
            self.memory[168 + 2 * index : 170 + 2 * index] = (224 + index).to_bytes(2, "little")

    def read(self, address: int, length: int) -> bytes:
        places = list(range(address, address + length))
        if self.maps and self.protocol == 2:
            for at, place in enumerate(places):
                if 224 <= place < 252:
                    pointer = 168 + 2 * (place - 224)
                    places[at] = int.from_bytes(self.memory[pointer : pointer + 2], "little")
        return bytes(self.memory[place] for place in places)

    def write(self, address: int, data: bytes) -> int:
        """The error number or bits."""
        eeprom_end = 64 if self.protocol == 2 else 24
        if address < eeprom_end and self["torque"]:
            return 7 if self.protocol == 2 else 0x08
        self.writes.append((address, data))
        self.memory[address : address + len(data)] = data
        return 0

    @property
    def error(self) -> int:
        """The error byte of its answers while nothing is wrong with the request."""
        return self.alarms if self.protocol == 1 else 0x80 if self["hardware"] else 0


class LiteralLine:
    """A half-duplex wire of 10 µs a byte; motors answer after 50 µs. `sent` keeps the host's packets."""

    def __init__(self, clock: VirtualClock, motors: list[LiteralMotor], *, echo: bool = False) -> None:
        self.clock = clock
        self.motors = motors
        self.echo = echo
        self.sent: list[bytes] = []
        self.spoil: Callable[[bytes], bytes] = lambda answer: answer
        self._arriving: list[tuple[int, bytes]] = []
        self._free_ns = 0

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self._free_ns = max(self._free_ns, self.clock.now_ns()) + 10_000 * len(data)
        if self.echo:
            self._arriving.append((self._free_ns, data))
        two = data[:4] == b"\xff\xff\xfd\x00"
        for answers in self._answers2(data) if two else self._answers1(data):
            answer = self.spoil(_collided(answers))
            self._free_ns += 50_000 + 10_000 * len(answer)
            if answer:
                self._arriving.append((self._free_ns, answer))

    def read(self, max_bytes: int) -> bytes:
        time_ns, data = self._arriving.pop(0)
        assert time_ns <= self.clock.now_ns(), "read ahead of time"
        if data[max_bytes:]:
            self._arriving.insert(0, (time_ns, data[max_bytes:]))
        return data[:max_bytes]

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self._arriving[0][0] if self._arriving else None

    def discard_input(self) -> None:
        self._arriving = [item for item in self._arriving if item[0] > self.clock.now_ns()]

    def close(self) -> None:
        self._arriving = []

    def _named(self, motor_id: int, protocol: int) -> list[LiteralMotor]:
        return [m for m in self.motors if m.motor_id == motor_id and m.protocol == protocol and not m.silent]

    def _answers1(self, packet: bytes) -> list[list[bytes]]:
        assert packet[:2] == b"\xff\xff", packet.hex(" ")
        assert packet[-1] == 255 - sum(packet[2:-1]) % 256, packet.hex(" ")
        motor_id, instruction, parameters = packet[2], packet[4], packet[5:-1]
        if instruction == 0x83:
            address, length, body = parameters[0], parameters[1], parameters[2:]
            for at in range(0, len(body), 1 + length):
                for motor in self._named(body[at], 1):
                    motor.write(address, body[at + 1 : at + 1 + length])
            return []
        answers = []
        for motor in self._named(motor_id, 1):
            error, data = motor.error, b""
            if instruction == 0x02:
                data = motor.read(*parameters)
            elif instruction == 0x03:
                error |= motor.write(parameters[0], parameters[1:])
            answers.append(status1(motor_id, error, data))
        return [answers] if answers else []

    def _answers2(self, packet: bytes) -> list[list[bytes]]:
        assert crc16(packet[:-2]) == int.from_bytes(packet[-2:], "little"), packet.hex(" ")
        body = packet[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        motor_id, instruction, parameters = packet[4], body[0], body[1:]
        address, length = (int.from_bytes(parameters[at : at + 2], "little") for at in (0, 2))
        if instruction == 0x82:
            chain = []
            for wanted in parameters[4:]:
                if not (motors := self._named(wanted, 2)):
                    break  # those behind wait for ever
                chain.append([status2(wanted, m.error, m.read(address, length)) for m in motors])
            return chain
        if instruction == 0x8A:
            return self._fast(address, length, parameters[4:])
        if instruction == 0x83:
            for at in range(4, len(parameters), 1 + length):
                for motor in self._named(parameters[at], 2):
                    motor.write(address, parameters[at + 1 : at + 1 + length])
            return []
        answers = []
        for motor in self._named(motor_id, 2):
            error, data = motor.error, b""
            if instruction == 0x01:
                data = motor.read(0, 2) + motor.read(6, 1)
            elif instruction == 0x02:
                data = motor.read(address, length)
            elif instruction == 0x03:
                error |= motor.write(address, parameters[2:])
            answers.append(status2(motor_id, error, data))
        return [answers] if answers else []

    def _fast(self, address: int, length: int, motor_ids: bytes) -> list[list[bytes]]:
        motors = [motor for wanted in motor_ids for motor in self._named(wanted, 2)]
        if len(motors) != len(motor_ids) or not all(motor.fast for motor in motors):
            return []
        packet = b"\xff\xff\xfd\x00\xfe" + (1 + len(motors) * (length + 4)).to_bytes(2, "little") + b"\x55"
        for motor in motors:
            packet += bytes((motor.error, motor.motor_id)) + motor.read(address, length)
            packet += crc16(packet).to_bytes(2, "little")
        return [[packet]]


def _collided(answers: list[bytes]) -> bytes:
    """What a wire shows when several drive it at once: a bit is 1 only if all say so."""
    whole = bytearray(max(answers, key=len))
    for answer in answers:
        for at, byte in enumerate(answer):
            whole[at] &= byte
    return bytes(whole)


@dataclass
class LiteralRig:
    """Clock, line and port with literal motors behind them."""

    motors: list[LiteralMotor]
    echo: bool = False
    baud: int = 1_000_000

    def __post_init__(self) -> None:
        self.clock = VirtualClock()
        self.line = LiteralLine(self.clock, self.motors, echo=self.echo)
        self.port = WaitingPort(self.line, self.clock, baud=self.baud)


@pytest.fixture
def rig_of() -> Callable[..., LiteralRig]:
    """Makes a rig: `rig_of((id, model, protocol), …, echo=False)`."""

    def make(*motors: tuple[int, int, int], echo: bool = False) -> LiteralRig:
        return LiteralRig([LiteralMotor(*motor) for motor in motors], echo)

    return make
