"""The control table of one simulated motor as bytes: reads, writes, and the indirect addresses of protocol 2.0.

Indirect data bytes stand for the bytes that their indirect addresses name; as delivered each names itself and is plain
storage. Source: dynamixel reference 2.2, 2.3, 4.2.
"""

from __future__ import annotations

import enum

from drivers.dynamixel.control_tables import MotorModel, Register
from drivers.dynamixel.registers import INDIRECT_BLOCKS


class Refusal(enum.IntEnum):
    """Why an instruction is not carried out: the error numbers of protocol 2.0."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class ControlTable:
    """Register values by name, and by address as the bus sees them."""

    def __init__(self, model: MotorModel) -> None:
        registers = model.registers
        self._registers = registers
        self.values = {name: register.default for name, register in registers.items()}
        self._places = {
            register.address + offset: (register, offset)
            for register in registers.values()
            for offset in range(register.size)
        }
        self._end = max(self._places) + 1
        self._addresses: dict[int, str] = {}
        number = 1
        for _, first_data, count in INDIRECT_BLOCKS if model.protocol == 2 else ():
            for data in range(first_data, first_data + count):
                self._addresses[data] = f"indirect_address_{number}"
                number += 1

    def read(self, address: int, length: int) -> tuple[Refusal, bytes]:
        """The bytes from `address`; addresses between registers read 0."""
        if length == 0 or address + length > self._end:
            return Refusal.ACCESS, b""
        image = bytearray(length)
        found = False
        for index in range(length):
            place = self._places.get(self._target(address + index))
            if place is not None:
                register, offset = place
                image[index] = raw_value(register, self.values[register.name]) >> 8 * offset & 0xFF
                found = True
        return (Refusal.NONE, bytes(image)) if found else (Refusal.ACCESS, b"")

    def changes(self, address: int, data: bytes) -> tuple[Refusal, list[tuple[Register, int]]]:
        """What a write means, in order of the registers; only whole writable registers can be written."""
        contents: dict[str, dict[int, int]] = {}
        for index, byte in enumerate(data):
            place = self._places.get(self._target(address + index))
            if place is None or not place[0].writable:
                return Refusal.ACCESS, []
            register, offset = place
            contents.setdefault(register.name, {})[offset] = byte
        written = []
        for name, content in contents.items():
            register = self._registers[name]
            if len(content) < register.size:
                return Refusal.DATA_LENGTH, []
            written.append((register, register.decode(bytes(content[offset] for offset in range(register.size)))))
        return (Refusal.NONE, written) if written else (Refusal.DATA_LENGTH, [])

    def _target(self, address: int) -> int:
        name = self._addresses.get(address)
        return address if name is None else self.values[name]


def raw_value(register: Register, value: int) -> int:
    """The register's bytes as one unsigned number: two's complement, or bit 10 as sign (protocol 1.0)."""
    if register.sign_magnitude and value < 0:
        return 0x400 - value
    return value & ((1 << 8 * register.size) - 1)
