"""The tendon motors' models: registers, units and plain facts of each. Data; the driver and the simulated motors take
addresses, sizes, ranges and units from here only.

Units are at the output shaft, positive counter-clockwise. *Effort* is what a motor tells of its torque: measured
current, A (XM430), or load, its own output as a fraction of all it could give (the others). The two are never mixed up:
`MotorModel.effort` says which it is, and `ceiling` names the register that limits the same quantity.

Source: dynamixel reference 2.1 (models), 2.2 and 2.3 (tables), 2.4 (load is not current), 3.1 (stall points); position
gain divisor from the ROBOTIS e-manual.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from drivers.dynamixel.registers import (
    CURRENT_ROWS,
    LOAD_ROWS,
    MX_ROWS,
    PROTOCOL_1_ROWS,
    PROTOCOL_2_ROWS,
    RX_ROWS,
    table,
)
from drivers.dynamixel.registers import Register as Register  # part of a model's data, so it is named here too
from drivers.errors import InputError

REVOLUTION_RAD = 2.0 * math.pi
RPM_RAD_S = REVOLUTION_RAD / 60.0

EEPROM_END = 64
"""Protocol 2.0: registers below are EEPROM: locked while torque is on, and worn by writing."""
EEPROM_END_PROTOCOL_1 = 24

CURRENT_BASED_POSITION_MODE = 5
EXTENDED_POSITION_MODE = 4
POSITION_MODE = 3

HARDWARE_ERROR_NAMES = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "motor encoder",
    0x10: "electrical shock",
    0x20: "overload",
}
"""Bits of Hardware Error Status; the alarms of protocol 1.0's error byte have the same places (reference 6.2)."""

PROTOCOL_1_ALARMS = 0x25
"""Bits of protocol 1.0's error byte that tell of the motor's state; the others refuse the instruction."""


@dataclass(frozen=True, slots=True)
class MotorModel:
    """A model: its registers and the units of its numbers."""

    number: int
    name: str
    protocol: Literal[1, 2]
    registers: Mapping[str, Register]
    effort: Literal["current", "load"]
    effort_unit: float
    """A, or fraction of all output, per count of `effort_register`."""
    effort_register: str
    ceiling: str
    """Register that limits the effort while the motor goes to a position; in RAM, written at any time."""
    ceiling_unit: float
    """A, or fraction of all output, per count of `ceiling`."""
    tick_rad: float
    """Shaft angle of one count of position."""
    velocity_unit_rad_s: float
    bauds: Mapping[int, int]
    """Register value → bit/s, as one writes it (57 142 is called 57 600)."""
    stall_points: tuple[tuple[float, float, float], ...]
    """Supply V, stall torque N·m, stall current A, in order of the voltage."""
    nominal_voltage_V: float
    voltage_range_V: tuple[float, float]
    no_load_speed_rad_s: float
    """At 12 V; an RX-28 at 18.5 V."""
    gear_ratio: float
    full_pwm: int
    """Counts of output at the whole supply voltage."""
    position_gain: str
    """Register of the position loop's stiffness."""
    default_position_gain: int
    position_gain_divisor: int
    """Gain / divisor = counts of output per tick of position error; 0: the gain is a compliance slope, the number of
    ticks over which the output grows from nothing to full (RX-28)."""
    position_modes: tuple[int, ...] = ()
    """Operating modes in which the motor holds a position under its ceiling, the wanted one first. Protocol 1.0 has no
    mode register: empty."""
    watchdog_firmware: int | None = None
    """First firmware that has the bus watchdog; None = none has."""
    voltage_unit_V: float = 0.1
    watchdog_unit_s: float = 0.020
    return_delay_unit_s: float = 2e-6

    @property
    def model_number(self) -> int:
        """What the motor answers at address 0."""
        return self.number

    @property
    def has_current_modes(self) -> bool:
        """Whether modes 0 and 5 exist."""
        return self.effort == "current"

    @property
    def current_unit_A(self) -> float:
        """A per count; InputError for a model without current measurement."""
        if self.effort != "current":
            raise InputError(f"a {self.name} does not measure its current; it tells its load.")
        return self.effort_unit

    @property
    def eeprom_end(self) -> int:
        """Registers below this address are EEPROM."""
        return EEPROM_END if self.protocol == 2 else EEPROM_END_PROTOCOL_1

    @property
    def ticks_per_revolution(self) -> int:
        """Counts of a whole turn, rounded; an RX-28 measures only 300° of it."""
        return round(REVOLUTION_RAD / self.tick_rad)

    @property
    def stall_current_A(self) -> float:
        """Of the stall point nearest to 12 V."""
        return min(self.stall_points, key=lambda point: abs(point[0] - 12.0))[2]

    def stall_torque_Nm(self, voltage_V: float) -> float:
        """Stall torque at a supply voltage: between the manual's points linear, outside in proportion. InputError."""
        if not (math.isfinite(voltage_V) and voltage_V > 0.0):
            raise InputError(f"supply voltage {voltage_V} V; expected a finite number above 0.")
        points = self.stall_points
        if voltage_V <= points[0][0]:
            return points[0][1] * voltage_V / points[0][0]
        for (low_V, low_Nm, _), (high_V, high_Nm, _) in itertools.pairwise(points):
            if voltage_V <= high_V:
                return low_Nm + (high_Nm - low_Nm) * (voltage_V - low_V) / (high_V - low_V)
        return points[-1][1] * voltage_V / points[-1][0]

    def holding_effort_per_tick(self, gain: int) -> float:
        """Effort at standstill per tick of position error, A or fraction.

        XM430: gain × supply voltage / winding resistance; the others tell their output itself. The scale of an MX-28's
        gain with protocol 1.0 is inferred.
        """
        output = self.output_per_tick(gain)
        return output * self.stall_current_A if self.effort == "current" else output

    def output_per_tick(self, gain: int) -> float:
        """Part of full output that the position loop asks for per tick of position error."""
        return 1.0 / gain if self.position_gain_divisor == 0 else gain / self.position_gain_divisor / self.full_pwm


_PROTOCOL_2_BAUDS = MappingProxyType(
    {0: 9600, 1: 57600, 2: 115200, 3: 1_000_000, 4: 2_000_000, 5: 3_000_000, 6: 4_000_000, 7: 4_500_000}
)
_RX_BAUDS = {1: 1_000_000, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000, 16: 115200, 34: 57600, 103: 19200, 207: 9600}
_MX_BAUDS = MappingProxyType({**_RX_BAUDS, 250: 2_250_000, 251: 2_500_000, 252: 3_000_000})
_MX_28_STALL = ((11.1, 2.3, 1.3), (12.0, 2.5, 1.4), (14.8, 3.1, 1.7))

RX_28 = MotorModel(
    number=28,
    name="RX-28",
    protocol=1,
    registers=table(*PROTOCOL_1_ROWS, *RX_ROWS),
    effort="load",
    effort_unit=1 / 1023,
    effort_register="present_load",
    ceiling="torque_limit",
    ceiling_unit=1 / 1023,
    tick_rad=math.radians(300.0) / 1023,
    velocity_unit_rad_s=0.111 * RPM_RAD_S,
    bauds=MappingProxyType(_RX_BAUDS),
    stall_points=((18.5, 3.7, 1.9),),
    nominal_voltage_V=14.8,
    voltage_range_V=(12.0, 18.5),
    no_load_speed_rad_s=85.0 * RPM_RAD_S,
    gear_ratio=193.0,
    full_pwm=1023,
    position_gain="cw_compliance_slope",
    default_position_gain=32,
    position_gain_divisor=0,
)

MX_28 = MotorModel(
    number=29,
    name="MX-28",
    protocol=1,
    registers=table(*PROTOCOL_1_ROWS, *MX_ROWS),
    effort="load",
    effort_unit=1 / 1023,
    effort_register="present_load",
    ceiling="torque_limit",
    ceiling_unit=1 / 1023,
    tick_rad=REVOLUTION_RAD / 4096,
    velocity_unit_rad_s=0.114 * RPM_RAD_S,
    bauds=_MX_BAUDS,
    stall_points=_MX_28_STALL,
    nominal_voltage_V=12.0,
    voltage_range_V=(10.0, 14.8),
    no_load_speed_rad_s=55.0 * RPM_RAD_S,
    gear_ratio=193.0,
    full_pwm=1023,
    position_gain="position_p_gain",
    default_position_gain=32,
    position_gain_divisor=8,
)

MX_28_2 = MotorModel(
    number=30,
    name="MX-28(2.0)",
    protocol=2,
    registers=table(
        *PROTOCOL_2_ROWS,
        *LOAD_ROWS,
        ("model_number", 0, 2, "R", 30, 0, 65535),
        ("velocity_limit", 44, 4, "RW", 380, 0, 1023),
        ("position_p_gain", 84, 2, "RW", 850, 0, 16383),
    ),
    effort="load",
    effort_unit=1e-3,
    effort_register="present_load",
    ceiling="goal_pwm",
    ceiling_unit=1 / 885,
    tick_rad=REVOLUTION_RAD / 4096,
    velocity_unit_rad_s=0.229 * RPM_RAD_S,
    bauds=_PROTOCOL_2_BAUDS,
    stall_points=_MX_28_STALL,
    nominal_voltage_V=12.0,
    voltage_range_V=(10.0, 14.8),
    no_load_speed_rad_s=55.0 * RPM_RAD_S,
    gear_ratio=193.0,
    full_pwm=885,
    position_gain="position_p_gain",
    default_position_gain=850,
    position_gain_divisor=128,
    position_modes=(EXTENDED_POSITION_MODE, POSITION_MODE),
    watchdog_firmware=38,
)

XM430_W350 = MotorModel(
    number=1020,
    name="XM430-W350",
    protocol=2,
    registers=table(*PROTOCOL_2_ROWS, *CURRENT_ROWS, ("model_number", 0, 2, "R", 1020, 0, 65535)),
    effort="current",
    effort_unit=2.69e-3,
    effort_register="present_current",
    ceiling="goal_current",
    ceiling_unit=2.69e-3,
    tick_rad=REVOLUTION_RAD / 4096,
    velocity_unit_rad_s=0.229 * RPM_RAD_S,
    bauds=_PROTOCOL_2_BAUDS,
    stall_points=((11.1, 3.8, 2.1), (12.0, 4.1, 2.3), (14.8, 4.8, 2.7)),
    nominal_voltage_V=12.0,
    voltage_range_V=(10.0, 14.8),
    no_load_speed_rad_s=46.0 * RPM_RAD_S,
    gear_ratio=353.5,
    full_pwm=885,
    position_gain="position_p_gain",
    default_position_gain=800,
    position_gain_divisor=128,
    position_modes=(CURRENT_BASED_POSITION_MODE,),
    watchdog_firmware=38,
)

XM430_W210 = MotorModel(
    number=1030,
    name="XM430-W210",
    protocol=2,
    registers=table(
        *PROTOCOL_2_ROWS,
        *CURRENT_ROWS,
        ("model_number", 0, 2, "R", 1030, 0, 65535),
        ("velocity_limit", 44, 4, "RW", 330, 0, 1023),
    ),
    effort="current",
    effort_unit=2.69e-3,
    effort_register="present_current",
    ceiling="goal_current",
    ceiling_unit=2.69e-3,
    tick_rad=REVOLUTION_RAD / 4096,
    velocity_unit_rad_s=0.229 * RPM_RAD_S,
    bauds=_PROTOCOL_2_BAUDS,
    stall_points=((11.1, 2.7, 2.1), (12.0, 3.0, 2.3), (14.8, 3.7, 2.7)),
    nominal_voltage_V=12.0,
    voltage_range_V=(10.0, 14.8),
    no_load_speed_rad_s=77.0 * RPM_RAD_S,
    gear_ratio=212.6,
    full_pwm=885,
    position_gain="position_p_gain",
    default_position_gain=800,
    position_gain_divisor=128,
    position_modes=(CURRENT_BASED_POSITION_MODE,),
    watchdog_firmware=38,
)

XL430_W250 = MotorModel(
    number=1060,
    name="XL430-W250",
    protocol=2,
    registers=table(
        *PROTOCOL_2_ROWS,
        *LOAD_ROWS,
        ("model_number", 0, 2, "R", 1060, 0, 65535),
        ("temperature_limit", 31, 1, "RW", 72, 0, 100),
        ("max_voltage_limit", 32, 2, "RW", 140, 60, 140),
        ("min_voltage_limit", 34, 2, "RW", 60, 60, 140),
        ("velocity_limit", 44, 4, "RW", 265, 0, 1023),
        ("position_d_gain", 80, 2, "RW", 4000, 0, 16383),
        ("position_p_gain", 84, 2, "RW", 640, 0, 16383),
        ("present_input_voltage", 144, 2, "R", 111, 0, 65535),
    ),
    effort="load",
    effort_unit=1e-3,
    effort_register="present_load",
    ceiling="goal_pwm",
    ceiling_unit=1 / 885,
    tick_rad=REVOLUTION_RAD / 4096,
    velocity_unit_rad_s=0.229 * RPM_RAD_S,
    bauds=_PROTOCOL_2_BAUDS,
    stall_points=((9.0, 1.0, 1.0), (11.1, 1.4, 1.3), (12.0, 1.5, 1.4)),
    nominal_voltage_V=11.1,
    voltage_range_V=(6.5, 12.0),
    no_load_speed_rad_s=61.0 * RPM_RAD_S,
    gear_ratio=258.5,
    full_pwm=885,
    position_gain="position_p_gain",
    default_position_gain=640,
    position_gain_divisor=128,
    position_modes=(EXTENDED_POSITION_MODE, POSITION_MODE),
    watchdog_firmware=38,
)

MODELS: Mapping[int, MotorModel] = MappingProxyType(
    {model.number: model for model in (RX_28, MX_28, MX_28_2, XM430_W350, XM430_W210, XL430_W250)}
)
"""Models that the driver can run, by model number."""


def model_by_number(number: int) -> MotorModel:
    """The model that answers `number` at address 0. InputError for one that cannot wind a tendon here."""
    if number not in MODELS:
        known = ", ".join(f"{model.name} ({model.number})" for model in MODELS.values())
        raise InputError(f"motor model number {number} is not known; expected {known}.", help="Fit one of these.")
    return MODELS[number]


def model_by_name(name: str) -> MotorModel:
    """The model called `name`, however it is hyphenated and capitalised. InputError."""
    for model in MODELS.values():
        if _plain(model.name) == _plain(name):
            return model
    known = ", ".join(model.name for model in MODELS.values())
    raise InputError(f"motor model {name!r} is not known; expected one of {known}.")


def _plain(name: str) -> str:
    return "".join(character for character in name.upper() if character.isalnum())
