"""What a simulated motor's registers order: register values → `Order`, per protocol. Pure functions.

Source: dynamixel reference 2.2, 2.3, 6.3 (a tripped watchdog holds); acceleration of an MX-28, 8.583 °/s² a count, from
the ROBOTIS e-manual.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.dynamixel.control_tables import MotorModel
from drivers.simulated.dynamixel_drive import Drive, Order

CURRENT_MODE, VELOCITY_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_BASED_POSITION, PWM_MODE = 0, 1, 3, 4, 5, 16
REVERSE, TIME_BASED, TORQUE_BY_GOAL = 1, 4, 8
"""Bits of Drive Mode."""
_PROFILE_RAD_S2 = 214.577 * 2.0 * math.pi / 3600.0
_GOAL_ACCELERATION_RAD_S2 = math.radians(8.583)
_WHEEL_GAINS = (100 / 128, 1920 / 65536 * 1000.0)
"""Gains of an MX-28's wheel mode [assumed: those of protocol 2.0]."""


def velocity_gains(values: Mapping[str, int]) -> tuple[float, float]:
    """Counts of output per count of velocity, and per count and second."""
    return values["velocity_p_gain"] / 128, values["velocity_i_gain"] / 65536 * 1000.0


def order_of_protocol_2(
    model: MotorModel, values: Mapping[str, int], held_ticks: int | None, timed: tuple[float, float] | None
) -> Order:
    """With torque on. `held_ticks`: where a tripped watchdog holds; `timed`: speed and acceleration of a time-based
    profile, ticks/s."""
    mode, held = values["operating_mode"], held_ticks is not None
    cap = float(min(abs(values["goal_pwm"]), values["pwm_limit"]))
    if mode == CURRENT_MODE:
        limit = values["current_limit"]
        goal = 0 if held else max(-limit, min(limit, values["goal_current"]))
        return Order(Drive.CURRENT, goal * model.current_unit_A, cap)
    if mode == VELOCITY_MODE:
        goal = 0 if held else values["goal_velocity"]
        return Order(Drive.VELOCITY, goal, cap, velocity_gain=velocity_gains(values))
    if mode == PWM_MODE:
        return Order(Drive.OUTPUT, 0 if held else values["goal_pwm"], cap)
    gain = values["position_p_gain"] / model.position_gain_divisor
    speed, acceleration = timed or (
        values["profile_velocity"] * model.velocity_unit_rad_s / model.tick_rad,
        values["profile_acceleration"] * _PROFILE_RAD_S2 / model.tick_rad,
    )
    current_cap_A = math.inf
    if mode == CURRENT_BASED_POSITION:
        current_cap_A = min(abs(values["goal_current"]), values["current_limit"]) * model.current_unit_A
    return Order(
        Drive.POSITION,
        values["goal_position"] if held_ticks is None else held_ticks,
        cap,
        current_cap_A,
        gain=(gain, gain),
        profile_ticks_s=0.0 if held else speed,
        profile_ticks_s2=0.0 if held else acceleration,
    )


def is_wheel(values: Mapping[str, int]) -> bool:
    """Protocol 1.0: both angle limits 0."""
    return values["cw_angle_limit"] == values["ccw_angle_limit"] == 0


def is_multi_turn(model: MotorModel, values: Mapping[str, int]) -> bool:
    """Protocol 1.0, MX: both angle limits at the end."""
    full = model.ticks_per_revolution - 1
    return "multi_turn_offset" in values and values["cw_angle_limit"] == values["ccw_angle_limit"] == full


def order_of_protocol_1(model: MotorModel, values: Mapping[str, int]) -> Order:
    """With torque on and a Torque Limit above 0."""
    cap = values["torque_limit"] / 1023 * model.full_pwm
    speed = values["moving_speed"]
    if is_wheel(values):
        signed = -(speed & 0x3FF) if speed & 0x400 else speed
        if "multi_turn_offset" not in values:
            return Order(Drive.OUTPUT, signed / 1023 * model.full_pwm, cap)
        return Order(Drive.VELOCITY, signed, cap, velocity_gain=_WHEEL_GAINS)
    goal = values["goal_position"]
    if is_multi_turn(model, values):
        goal = (goal - values["multi_turn_offset"]) * values["resolution_divider"]
    if model.position_gain_divisor:
        gain = values["position_p_gain"] / model.position_gain_divisor
        gains, margins = (gain, gain), (0.0, 0.0)
    else:
        full = model.full_pwm
        gains = (full / values["cw_compliance_slope"], full / values["ccw_compliance_slope"])
        margins = (float(values["cw_compliance_margin"]), float(values["ccw_compliance_margin"]))
    return Order(
        Drive.POSITION,
        goal,
        cap,
        gain=gains,
        margin_ticks=margins,
        punch=values["punch"] / 1023 * model.full_pwm,
        profile_ticks_s=(speed & 0x3FF) * model.velocity_unit_rad_s / model.tick_rad,
        profile_ticks_s2=values.get("goal_acceleration", 0) * _GOAL_ACCELERATION_RAD_S2 / model.tick_rad,
    )


def time_based_profile(values: Mapping[str, int], distance_ticks: float) -> tuple[float, float]:
    """Speed and acceleration that take Profile Velocity ms for this distance, Profile Acceleration ms at each end."""
    span_s, ramp_s = values["profile_velocity"] * 1e-3, values["profile_acceleration"] * 1e-3
    if span_s <= 0.0 or distance_ticks == 0.0:
        return 0.0, 0.0
    ramp_s = min(ramp_s, 0.5 * span_s)
    speed = abs(distance_ticks) / (span_s - ramp_s)
    return speed, speed / ramp_s if ramp_s > 0.0 else 0.0
