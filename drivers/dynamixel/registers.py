"""What one item of a control table is, and the tables of both protocols as rows. Data, no behaviour of motors.

Names are those of the protocol 2.0 manuals wherever the quantity is the same, so that one driver serves both protocols
(protocol 1.0 calls `present_velocity` Present Speed, and `present_input_voltage` Present Voltage). Numbers are those on
the wire, little endian: two's complement where `minimum` is negative, or sign and magnitude where the row says so.

Source: dynamixel reference 2.2 (protocol 1.0), 2.3 (protocol 2.0), 2.4 (signs); ranges from the ROBOTIS e-manual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from drivers.errors import InputError

SIGN_BIT = 1 << 10
"""Protocol 1.0, Present Speed and Present Load: set = clockwise; the ten bits below are the magnitude."""

INDIRECT_BLOCKS = ((168, 224, 28), (578, 634, 28))
"""Indirect addresses of protocol 2.0: first address register (2 bytes each), first data byte, number."""


def signed(raw: int) -> int:
    """A sign-magnitude reading as a number; bits above the sign have no meaning."""
    magnitude = raw & (SIGN_BIT - 1)
    return -magnitude if raw & SIGN_BIT else magnitude


@dataclass(frozen=True, slots=True)
class Register:
    """One item of a control table."""

    name: str
    address: int
    size: int
    writable: bool
    default: int
    minimum: int
    maximum: int
    sign_magnitude: bool = False
    """Bit 10 is the sign, not two's complement (protocol 1.0)."""

    def encode(self, value: int) -> bytes:
        """The `size` bytes of `value`; InputError outside minimum…maximum."""
        if not self.minimum <= value <= self.maximum:
            raise InputError(
                f"{self.name} = {value} is outside {self.minimum}…{self.maximum}.",
                help="Give a value inside this range.",
            )
        if self.sign_magnitude:
            value = SIGN_BIT - value if value < 0 else value
        return value.to_bytes(self.size, "little", signed=value < 0)

    def decode(self, data: bytes) -> int:
        """The value of exactly `size` bytes, signed where the register is."""
        if len(data) != self.size:
            raise InputError(f"{self.name} has {self.size} bytes, got {len(data)}.")
        if self.sign_magnitude:
            return signed(int.from_bytes(data, "little"))
        return int.from_bytes(data, "little", signed=self.minimum < 0)


Row = tuple[str, int, int, str, int, int, int]
"""Name, address, size, access, default, minimum, maximum. Access: R, RW, or RS for a sign-magnitude reading."""


def table(*rows: Row) -> Mapping[str, Register]:
    """Rows as registers by name; a later row replaces an earlier one of the same name."""
    return MappingProxyType(
        {row[0]: Register(row[0], row[1], row[2], "W" in row[3], *row[4:], "S" in row[3]) for row in rows}
    )


def _indirect_rows() -> tuple[Row, ...]:
    rows: list[Row] = []
    number = 1
    for first_address, first_data, count in INDIRECT_BLOCKS:
        for index in range(count):
            data = first_data + index
            rows.append((f"indirect_address_{number}", first_address + 2 * index, 2, "RW", data, 64, 661))
            rows.append((f"indirect_data_{number}", data, 1, "RW", 0, 0, 255))
            number += 1
    return tuple(rows)


PROTOCOL_2_ROWS: tuple[Row, ...] = (
    ("model_number", 0, 2, "R", 0, 0, 65535),
    ("model_information", 2, 4, "R", 0, 0, 2**32 - 1),
    ("firmware", 6, 1, "R", 45, 0, 255),
    ("id", 7, 1, "RW", 1, 0, 252),
    ("baud_rate", 8, 1, "RW", 1, 0, 7),
    ("return_delay_time", 9, 1, "RW", 250, 0, 254),
    ("drive_mode", 10, 1, "RW", 0, 0, 13),
    ("operating_mode", 11, 1, "RW", 3, 0, 16),
    ("secondary_id", 12, 1, "RW", 255, 0, 255),
    ("protocol_type", 13, 1, "RW", 2, 1, 2),
    ("homing_offset", 20, 4, "RW", 0, -1044479, 1044479),
    ("moving_threshold", 24, 4, "RW", 10, 0, 1023),
    ("temperature_limit", 31, 1, "RW", 80, 0, 100),
    ("max_voltage_limit", 32, 2, "RW", 160, 95, 160),
    ("min_voltage_limit", 34, 2, "RW", 95, 95, 160),
    ("pwm_limit", 36, 2, "RW", 885, 0, 885),
    ("velocity_limit", 44, 4, "RW", 350, 0, 1023),
    ("max_position_limit", 48, 4, "RW", 4095, 0, 4095),
    ("min_position_limit", 52, 4, "RW", 0, 0, 4095),
    ("startup_configuration", 60, 1, "RW", 0, 0, 3),
    ("shutdown", 63, 1, "RW", 52, 0, 63),
    ("torque_enable", 64, 1, "RW", 0, 0, 1),
    ("led", 65, 1, "RW", 0, 0, 1),
    ("status_return_level", 68, 1, "RW", 2, 0, 2),
    ("registered_instruction", 69, 1, "R", 0, 0, 1),
    ("hardware_error_status", 70, 1, "R", 0, 0, 255),
    ("velocity_i_gain", 76, 2, "RW", 1920, 0, 16383),
    ("velocity_p_gain", 78, 2, "RW", 100, 0, 16383),
    ("position_d_gain", 80, 2, "RW", 0, 0, 16383),
    ("position_i_gain", 82, 2, "RW", 0, 0, 16383),
    ("position_p_gain", 84, 2, "RW", 800, 0, 16383),
    ("feedforward_2nd_gain", 88, 2, "RW", 0, 0, 16383),
    ("feedforward_1st_gain", 90, 2, "RW", 0, 0, 16383),
    ("bus_watchdog", 98, 1, "RW", 0, -1, 127),
    ("goal_pwm", 100, 2, "RW", 885, -885, 885),
    ("goal_velocity", 104, 4, "RW", 0, -1023, 1023),
    ("profile_acceleration", 108, 4, "RW", 0, 0, 32767),
    ("profile_velocity", 112, 4, "RW", 0, 0, 32767),
    ("goal_position", 116, 4, "RW", 0, -1048575, 1048575),
    ("realtime_tick", 120, 2, "R", 0, 0, 32767),
    ("moving", 122, 1, "R", 0, 0, 1),
    ("moving_status", 123, 1, "R", 0, 0, 255),
    ("present_pwm", 124, 2, "R", 0, -885, 885),
    ("present_velocity", 128, 4, "R", 0, -(2**31), 2**31 - 1),
    ("present_position", 132, 4, "R", 0, -(2**31), 2**31 - 1),
    ("velocity_trajectory", 136, 4, "R", 0, -(2**31), 2**31 - 1),
    ("position_trajectory", 140, 4, "R", 0, -(2**31), 2**31 - 1),
    ("present_input_voltage", 144, 2, "R", 120, 0, 65535),
    ("present_temperature", 146, 1, "R", 30, 0, 255),
    ("backup_ready", 147, 1, "R", 0, 0, 1),
    *_indirect_rows(),
)
"""What every protocol 2.0 model has, with the XM430's defaults."""

CURRENT_ROWS: tuple[Row, ...] = (
    ("current_limit", 38, 2, "RW", 1193, 0, 1193),
    ("goal_current", 102, 2, "RW", 1193, -1193, 1193),
    ("present_current", 126, 2, "R", 0, -32768, 32767),
)
"""Models that measure their current."""

LOAD_ROWS: tuple[Row, ...] = (("present_load", 126, 2, "R", 0, -1000, 1000),)
"""Models that do not: what stands at the same address is their own output."""

PROTOCOL_1_ROWS: tuple[Row, ...] = (
    ("model_number", 0, 2, "R", 0, 0, 65535),
    ("firmware", 2, 1, "R", 40, 0, 255),
    ("id", 3, 1, "RW", 1, 0, 253),
    ("baud_rate", 4, 1, "RW", 34, 0, 254),
    ("return_delay_time", 5, 1, "RW", 250, 0, 254),
    ("temperature_limit", 11, 1, "RW", 80, 0, 150),
    ("min_voltage_limit", 12, 1, "RW", 60, 50, 250),
    ("max_voltage_limit", 13, 1, "RW", 160, 50, 250),
    ("max_torque", 14, 2, "RW", 1023, 0, 1023),
    ("status_return_level", 16, 1, "RW", 2, 0, 2),
    ("alarm_led", 17, 1, "RW", 36, 0, 127),
    ("shutdown", 18, 1, "RW", 36, 0, 127),
    ("torque_enable", 24, 1, "RW", 0, 0, 1),
    ("led", 25, 1, "RW", 0, 0, 1),
    ("moving_speed", 32, 2, "RW", 0, 0, 2047),
    ("torque_limit", 34, 2, "RW", 1023, 0, 1023),
    ("present_velocity", 38, 2, "RS", 0, -1023, 1023),
    ("present_load", 40, 2, "RS", 0, -1023, 1023),
    ("present_input_voltage", 42, 1, "R", 120, 0, 255),
    ("present_temperature", 43, 1, "R", 30, 0, 255),
    ("registered_instruction", 44, 1, "R", 0, 0, 1),
    ("moving", 46, 1, "R", 0, 0, 1),
    ("lock", 47, 1, "RW", 0, 0, 1),
)
"""What RX-28 and MX-28 have in common with protocol 1.0."""

RX_ROWS: tuple[Row, ...] = (
    ("model_number", 0, 2, "R", 28, 0, 65535),
    ("cw_angle_limit", 6, 2, "RW", 0, 0, 1023),
    ("ccw_angle_limit", 8, 2, "RW", 1023, 0, 1023),
    ("max_voltage_limit", 13, 1, "RW", 190, 50, 250),
    ("cw_compliance_margin", 26, 1, "RW", 1, 0, 255),
    ("ccw_compliance_margin", 27, 1, "RW", 1, 0, 255),
    ("cw_compliance_slope", 28, 1, "RW", 32, 1, 254),
    ("ccw_compliance_slope", 29, 1, "RW", 32, 1, 254),
    ("goal_position", 30, 2, "RW", 0, 0, 1023),
    ("present_position", 36, 2, "R", 0, 0, 1023),
    ("punch", 48, 2, "RW", 32, 0, 1023),
)

MX_ROWS: tuple[Row, ...] = (
    ("model_number", 0, 2, "R", 29, 0, 65535),
    ("cw_angle_limit", 6, 2, "RW", 0, 0, 4095),
    ("ccw_angle_limit", 8, 2, "RW", 4095, 0, 4095),
    ("multi_turn_offset", 20, 2, "RW", 0, -24576, 24576),
    ("resolution_divider", 22, 1, "RW", 1, 1, 4),
    ("position_d_gain", 26, 1, "RW", 0, 0, 254),
    ("position_i_gain", 27, 1, "RW", 0, 0, 254),
    ("position_p_gain", 28, 1, "RW", 32, 0, 254),
    ("goal_position", 30, 2, "RW", 0, -28672, 28672),
    ("present_position", 36, 2, "R", 0, -28672, 28672),
    ("punch", 48, 2, "RW", 0, 0, 1023),
    ("realtime_tick", 50, 2, "R", 0, 0, 32767),
    ("goal_acceleration", 73, 1, "RW", 0, 0, 254),
)
