"""Control tables of the tendon motors: what each model keeps at which address, in which unit. Data, no code.

A further model (XM430-W210, MX-28 with protocol 2.0, XL430, RX-28 …) is a further `MotorModel` in `MODELS`; the driver
and the simulated motors take addresses, sizes, ranges and units from here only. Numbers are those on the wire: little
endian, two's complement where `minimum` is negative.

Source: dynamixel reference 2.1 (models), 2.3 (protocol 2.0 table), 3.1 (stall point); position gain divisor and
register ranges from the ROBOTIS e-manual page of the XM430-W350.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from drivers.errors import InputError

REVOLUTION_RAD = 2.0 * math.pi
RPM_RAD_S = REVOLUTION_RAD / 60.0

EEPROM_END = 64
"""Registers below this address are EEPROM: locked while torque is on, and worn by writing."""

TORQUE_ENABLE_ADDRESS = 64

CURRENT_BASED_POSITION_MODE = 5

HARDWARE_ERROR_NAMES = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "motor encoder",
    0x10: "electrical shock",
    0x20: "overload",
}


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

    def encode(self, value: int) -> bytes:
        """The `size` bytes of `value`; InputError outside minimum…maximum."""
        if not self.minimum <= value <= self.maximum:
            raise InputError(
                f"{self.name} = {value} is outside {self.minimum}…{self.maximum}.",
                help="Give a value inside this range.",
            )
        return value.to_bytes(self.size, "little", signed=value < 0)

    def decode(self, data: bytes) -> int:
        """The value of exactly `size` bytes, signed where the register is."""
        if len(data) != self.size:
            raise InputError(f"{self.name} has {self.size} bytes, got {len(data)}.")
        return int.from_bytes(data, "little", signed=self.minimum < 0)


@dataclass(frozen=True, slots=True)
class MotorModel:
    """A model: its registers and the units of its numbers, at the output shaft, positive counter-clockwise."""

    number: int
    name: str
    registers: Mapping[str, Register]
    ticks_per_revolution: int
    current_unit_A: float
    velocity_unit_rad_s: float
    voltage_unit_V: float
    watchdog_unit_s: float
    return_delay_unit_s: float
    full_pwm: int
    """PWM counts of the whole supply voltage."""
    position_gain_divisor: int
    """Position P gain / divisor = PWM counts per tick of position error."""
    nominal_voltage_V: float
    stall_current_A: float
    no_load_speed_rad_s: float
    watchdog_firmware: int
    """First firmware that has the bus watchdog."""

    @property
    def tick_rad(self) -> float:
        """Shaft angle of one tick, rad."""
        return REVOLUTION_RAD / self.ticks_per_revolution

    def holding_current_A_per_tick(self, position_p_gain: int) -> float:
        """Current at standstill per tick of position error, A: gain × supply voltage / winding resistance."""
        return position_p_gain / self.position_gain_divisor / self.full_pwm * self.stall_current_A


def _registers(rows: tuple[tuple[str, int, int, str, int, int, int], ...]) -> Mapping[str, Register]:
    return MappingProxyType({row[0]: Register(row[0], row[1], row[2], "W" in row[3], *row[4:]) for row in rows})


XM430_REGISTERS = _registers(
    (  # name, address, size, access, default, minimum, maximum
        ("model_number", 0, 2, "R", 1020, 0, 65535),
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
        ("current_limit", 38, 2, "RW", 1193, 0, 1193),
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
        ("goal_current", 102, 2, "RW", 1193, -1193, 1193),
        ("goal_velocity", 104, 4, "RW", 0, -1023, 1023),
        ("profile_acceleration", 108, 4, "RW", 0, 0, 32767),
        ("profile_velocity", 112, 4, "RW", 0, 0, 32767),
        ("goal_position", 116, 4, "RW", 0, -1048575, 1048575),
        ("realtime_tick", 120, 2, "R", 0, 0, 32767),
        ("moving", 122, 1, "R", 0, 0, 1),
        ("moving_status", 123, 1, "R", 0, 0, 255),
        ("present_pwm", 124, 2, "R", 0, -885, 885),
        ("present_current", 126, 2, "R", 0, -32768, 32767),
        ("present_velocity", 128, 4, "R", 0, -(2**31), 2**31 - 1),
        ("present_position", 132, 4, "R", 0, -(2**31), 2**31 - 1),
        ("velocity_trajectory", 136, 4, "R", 0, -(2**31), 2**31 - 1),
        ("position_trajectory", 140, 4, "R", 0, -(2**31), 2**31 - 1),
        ("present_input_voltage", 144, 2, "R", 120, 0, 65535),
        ("present_temperature", 146, 1, "R", 30, 0, 255),
        ("backup_ready", 147, 1, "R", 0, 0, 1),
    )
)

XM430_W350 = MotorModel(
    number=1020,
    name="XM430-W350",
    registers=XM430_REGISTERS,
    ticks_per_revolution=4096,
    current_unit_A=2.69e-3,
    velocity_unit_rad_s=0.229 * RPM_RAD_S,
    voltage_unit_V=0.1,
    watchdog_unit_s=0.020,
    return_delay_unit_s=2e-6,
    full_pwm=885,
    position_gain_divisor=128,
    nominal_voltage_V=12.0,
    stall_current_A=2.3,
    no_load_speed_rad_s=46.0 * RPM_RAD_S,
    watchdog_firmware=38,
)

MODELS: Mapping[int, MotorModel] = MappingProxyType({XM430_W350.number: XM430_W350})
"""Models that the driver can run, by model number."""

OTHER_MODEL_NAMES: Mapping[int, str] = MappingProxyType(
    {28: "RX-28", 29: "MX-28", 30: "MX-28(2.0)", 1030: "XM430-W210", 1060: "XL430-W250"}
)
"""Models that are met in T42 hands but have no table here yet: named in the refusal."""
