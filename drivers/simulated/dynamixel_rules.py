"""Which values a simulated motor takes, and has after switching on, per protocol. Pure functions of its registers.

Source: dynamixel reference 2.2, 2.3, 6.2, 6.3. What a motor of protocol 1.0 answers to a write into its locked EEPROM
is not documented; it is refused here.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.dynamixel.control_tables import MotorModel, Register
from drivers.errors import InputError
from drivers.simulated.dynamixel_orders import (
    CURRENT_BASED_POSITION,
    CURRENT_MODE,
    EXTENDED_MODE,
    POSITION_MODE,
    PWM_MODE,
    VELOCITY_MODE,
    is_multi_turn,
    is_wheel,
)
from drivers.simulated.dynamixel_table import Refusal

GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
LIMIT_OF = {
    "goal_pwm": "pwm_limit",
    "goal_current": "current_limit",
    "goal_velocity": "velocity_limit",
}


def refusal(model: MotorModel, values: Mapping[str, int], register: Register, value: int) -> Refusal:
    """Whether the motor takes this value now, and if not, why."""
    if not register.minimum <= value <= register.maximum:
        return Refusal.DATA_RANGE
    return (_protocol_2 if model.protocol == 2 else _protocol_1)(model, values, register, value)


def ram_after_power_up(model: MotorModel, values: Mapping[str, int]) -> dict[str, int]:
    """All registers of the RAM after switching on: as delivered, or as the EEPROM says."""
    ram = {r.name: r.default for r in model.registers.values() if r.address >= model.eeprom_end}
    for goal in ("goal_pwm", "goal_current"):
        if goal in ram:
            ram[goal] = values[LIMIT_OF[goal]]
    if "max_torque" in values:
        ram["torque_limit"] = values["max_torque"]
    if "startup_configuration" in values:
        ram["torque_enable"] = values["startup_configuration"] & 1
    return ram


def baud_code(model: MotorModel, baud: int) -> int:
    """Register value of a baud rate. InputError for one that the model does not have."""
    for code, rate in model.bauds.items():
        if abs(rate - baud) <= 0.01 * rate:
            return code
    known = ", ".join(str(rate) for rate in sorted(model.bauds.values()))
    raise InputError(f"a {model.name} has no baud rate {baud}; expected one of {known}.")


def _protocol_2(model: MotorModel, values: Mapping[str, int], register: Register, value: int) -> Refusal:
    name = register.name
    if register.address < model.eeprom_end and values["torque_enable"]:
        return Refusal.ACCESS
    if name in GOALS and values["bus_watchdog"] < 0:
        return Refusal.DATA_RANGE
    if name == "bus_watchdog" and (value < 0 or (value > 0 and values["bus_watchdog"] < 0)):
        return Refusal.DATA_RANGE
    if name == "operating_mode" and value not in _modes(model):
        return Refusal.DATA_RANGE
    if name == "torque_enable" and value and values["hardware_error_status"] & values["shutdown"]:
        return Refusal.ACCESS
    if name in LIMIT_OF and abs(value) > values[LIMIT_OF[name]]:
        return Refusal.DATA_LIMIT
    if name == "goal_position" and values["operating_mode"] == POSITION_MODE:
        inside = values["min_position_limit"] <= value <= values["max_position_limit"]
        return Refusal.NONE if inside else Refusal.DATA_LIMIT
    return Refusal.NONE


def _protocol_1(model: MotorModel, values: Mapping[str, int], register: Register, value: int) -> Refusal:
    if values["lock"] and (register.address < model.eeprom_end or register.name == "lock"):
        return Refusal.ACCESS
    if register.name == "goal_position" and not is_wheel(values) and not is_multi_turn(model, values):
        inside = values["cw_angle_limit"] <= value <= values["ccw_angle_limit"]
        return Refusal.NONE if inside else Refusal.DATA_LIMIT
    return Refusal.NONE


def _modes(model: MotorModel) -> tuple[int, ...]:
    modes = (VELOCITY_MODE, POSITION_MODE, EXTENDED_MODE, PWM_MODE)
    return (*modes, CURRENT_MODE, CURRENT_BASED_POSITION) if model.has_current_modes else modes
