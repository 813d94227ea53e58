"""The control table as data: addresses, signs, ranges."""

import pytest

from drivers.dynamixel.control_tables import XM430_W350
from drivers.errors import InputError


def test_registers_do_not_overlap() -> None:
    """A slip in an address or size would let one register's write damage another."""
    end = 0
    for register in sorted(XM430_W350.registers.values(), key=lambda register: register.address):
        assert register.address >= end, register.name
        end = register.address + register.size


def test_motion_block_is_the_one_of_the_reference() -> None:
    """The block read of 126, length 10 (reference 2.3) is current, velocity, position."""
    names = ("present_current", "present_velocity", "present_position")
    layout = [(XM430_W350.registers[name].address, XM430_W350.registers[name].size) for name in names]
    assert layout == [(126, 2), (128, 4), (132, 4)]


@pytest.mark.parametrize(
    ("name", "data", "value"), [("present_current", "dbff", -37), ("goal_position", "00080000", 2048)]
)
def test_numbers_are_little_endian_and_signed(name: str, data: str, value: int) -> None:
    """Unsigned reading of signed registers is the most frequent fault of users (reference 2.4)."""
    assert XM430_W350.registers[name].decode(bytes.fromhex(data)) == value


def test_register_refuses_what_it_cannot_hold() -> None:
    """A value outside the range, or the neighbour's bytes, must never reach a motor or a goal."""
    register = XM430_W350.registers["goal_current"]
    with pytest.raises(InputError, match=r"goal_current = 1194 .*-1193…1193"):
        register.encode(1194)
    with pytest.raises(InputError, match="has 2 bytes, got 4"):
        register.decode(b"\0\0\0\0")
