"""What is looked at before a tendon motor is driven, and what follows from each finding.

    warned      told to the operator; nothing else
    refused     not started with. A motor that holds already is adopted all the same, and the operator is told: what is
                in the hand stays there
    undriven    not started with. A motor that holds already is left exactly as it is and takes no set-points, because
                the driver does not know which way they would turn it

Pure functions of register values and settings. Source: dynamixel reference 1.3, 2.2, 2.3 (Drive Mode, Shutdown), 2.4, 3
(what a load law depends on), 6.2 (overheating has to shut a motor down, overload is a choice); design 5.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from drivers.dynamixel.control_tables import HARDWARE_ERROR_NAMES, PROTOCOL_1_ALARMS, MotorModel
from drivers.dynamixel.settings import MotorSettings

REVERSE, TORQUE_BY_GOAL = 0x01, 0x08
"""Bits of Drive Mode; bit 2, time-based profiles, means nothing to a motor without profile."""
OVERHEATING, SHOCK = 0x04, 0x10
NO_SECONDARY_ID = 253
"""From here on a Secondary Id means none; 255 as delivered."""
ZERO_SLACK_M = 0.005
"""How far beyond its travel a spool may stand when it is found."""
CURRENT_SUPPLY_TOLERANCE = 0.1
LOAD_SUPPLY_TOLERANCE = 0.2
"""Of a load law's supply: a load is scaled by the supply, so that it bears more than a current does."""
SUPPLY_NOISE = 0.03
"""Of a model's range: a 12 V supply may give 12.3."""


class Consequence(enum.Enum):
    """What follows from a finding."""

    WARNED = "warned"
    REFUSED = "refused"
    UNDRIVEN = "undriven"


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be; `text` reads after the motor's name."""

    consequence: Consequence
    text: str
    help: str

    @property
    def sentence(self) -> str:
        """For the operator."""
        return f"{self.text} {self.help}"


def check_drive_mode(value: int, holds: bool) -> list[Finding]:
    """Drive Mode of protocol 2.0, before it is set to 0 in a motor that does not hold."""
    if value & REVERSE:
        return [
            Finding(
                Consequence.UNDRIVEN,
                f"has Drive Mode {value}, reverse: its positions run the other way than they were calibrated.",
                "Write 0 to Drive Mode (address 10) with torque off; then check sign and zero: `stillgrasp calibrate "
                "motors`.",
            )
        ]
    if value & TORQUE_BY_GOAL and holds:
        return [
            Finding(
                Consequence.WARNED,
                f"has Drive Mode {value}: a goal would switch its torque on.",
                "It is sent none while it is silent; started without torque the next time, it gets Drive Mode 0.",
            )
        ]
    return []


def check_return_delay(model: MotorModel, value: int, holds: bool) -> list[Finding]:
    """Return Delay Time, before it is set to 0 in a motor that does not hold."""
    if not holds or not value:
        return []
    delay_us = 1e6 * value * model.return_delay_unit_s
    text = f"answers {delay_us:.0f} µs later than it could (Return Delay Time {value})."
    return [Finding(Consequence.WARNED, text, "Started without torque the next time, it gets 0.")]


def check_secondary_id(value: int, holds: bool) -> list[Finding]:
    """Secondary Id of protocol 2.0, before it is switched off in a motor that does not hold."""
    if value >= NO_SECONDARY_ID or not holds:
        return []
    text = f"also obeys what is written to id {value} (Secondary Id), and never says so."
    return [Finding(Consequence.WARNED, text, "Started without torque the next time, it gets none.")]


def check_temperature_limit(settings: MotorSettings, model: MotorModel, limit_C: int) -> list[Finding]:
    """Where it lets go for heat: not beyond what it is made for, and not before its load cap is lowered."""
    default_C = model.registers["temperature_limit"].default
    if limit_C > default_C:
        text = f"lets go for heat only at {limit_C} °C; it is made for {default_C} °C."
        return [Finding(Consequence.WARNED, text, f"Write {default_C} to its Temperature Limit.")]
    if limit_C <= settings.derating_start_C:
        text = f"lets go for heat at {limit_C} °C, before its load cap is lowered at {settings.derating_start_C:g} °C."
        return [Finding(Consequence.WARNED, text, "Lower tendons.derating_start_C, or raise its Temperature Limit.")]
    return []


def shutdown_to_be(model: MotorModel, value: int) -> int:
    """The Shutdown mask with what has to be in it: overheating, and electrical shock where there is such a bit."""
    return value | OVERHEATING | (SHOCK if model.protocol == 2 else 0)


def check_shutdown(model: MotorModel, value: int, holds: bool) -> list[Finding]:
    """The Shutdown mask; in a motor that does not hold it is then written as it has to be."""
    missing = shutdown_to_be(model, value) & ~value
    if not missing:
        return []
    text = f"does not shut down on {error_names(missing)} (Shutdown {value})."
    if holds:
        help = "It is locked while the motor holds: started without torque the next time, it is switched on."
    else:
        help = f"This is switched on now (Shutdown {value | missing})."
    return [Finding(Consequence.WARNED, text, help)]


def shuts_down_on(model: MotorModel, value: int) -> str:
    """What a Shutdown mask lets a motor let go for, in words."""
    bits = value & (PROTOCOL_1_ALARMS if model.protocol == 1 else 0xFF)
    return error_names(bits) or "nothing"


def error_names(bits: int) -> str:
    """Names of the hardware error's bits."""
    return ", ".join(name for bit, name in HARDWARE_ERROR_NAMES.items() if bits & bit)


def check_zero(settings: MotorSettings, model: MotorModel, ticks: int) -> list[Finding]:
    """Whether the spool can stand at this position with its calibrated zero."""
    excursion_m = settings.excursion_m(ticks, model)
    lower_m, upper_m = settings.travel_m
    if lower_m - ZERO_SLACK_M <= excursion_m <= upper_m + ZERO_SLACK_M:
        return []
    return [
        Finding(
            Consequence.UNDRIVEN,
            f"stands at {excursion_m * 1e3:.1f} mm of excursion; expected {lower_m * 1e3:.1f}…{upper_m * 1e3:.1f}.",
            "It lost its turn or its zero is wrong: calibrate zero_ticks again, `stillgrasp calibrate motors`.",
        )
    ]


def check_travel(settings: MotorSettings, model: MotorModel, goal_range: tuple[int, int]) -> list[Finding]:
    """Whether all of the travel is positions that the motor takes: one turn, for most of protocol 1.0."""
    lowest, highest = goal_range
    ends = sorted(settings.ticks(end_m, model) for end_m in settings.travel_m)
    if lowest <= ends[0] and ends[1] <= highest:
        return []
    first, last = lowest + settings.zero_ticks - ends[0], highest + settings.zero_ticks - ends[1]
    if first <= last:
        help = f"Clamp the spool so that the motor stands at {first}…{last} with the tendon just taut, and calibrate "
        help += "zero_ticks; or narrow travel_m."
    else:
        length_m = (highest - lowest) * model.tick_rad * settings.spool_radius_m
        help = f"Narrow travel_m: there are {1e3 * length_m:.1f} mm in all."
    lower_mm, upper_mm = (1e3 * end_m for end_m in settings.travel_m)
    return [
        Finding(
            Consequence.REFUSED,
            f"has its travel of {lower_mm:.1f}…{upper_mm:.1f} mm at the positions {ends[0]}…{ends[1]}; it takes "
            f"{lowest}…{highest}.",
            help,
        )
    ]


def check_calibration(settings: MotorSettings, model: MotorModel, firmware: int, supply_V: float) -> list[Finding]:
    """Whether the load law was measured on such a motor, at such a supply."""
    calibrated = settings.calibrated
    again = "Calibrate its load law again, `stillgrasp calibrate motor-load`, or delete it from the motors' own file."
    findings = []
    if calibrated is not None and calibrated.model != model.name:
        text = f"is a {model.name}; its load law was measured on a {calibrated.model}."
        findings.append(Finding(Consequence.UNDRIVEN, text, again))
    elif calibrated is not None and calibrated.firmware != firmware:
        text = f"has firmware {firmware}; its load law was measured with firmware {calibrated.firmware}."
        findings.append(Finding(Consequence.REFUSED, text, again))
    measured_V = None if calibrated is None else calibrated.voltage_V
    tolerance = CURRENT_SUPPLY_TOLERANCE if model.effort == "current" else LOAD_SUPPLY_TOLERANCE
    if measured_V is not None and not math.isclose(supply_V, measured_V, rel_tol=0.0, abs_tol=tolerance * measured_V):
        text = f"has {supply_V:.1f} V; its load law was measured at {measured_V:.1f} V."
        findings.append(Finding(Consequence.WARNED, text, f"Tensions may be wrong. {again}"))
    lowest_V, highest_V = model.voltage_range_V
    if not (1.0 - SUPPLY_NOISE) * lowest_V <= supply_V <= (1.0 + SUPPLY_NOISE) * highest_V:
        text = f"has {supply_V:.1f} V; a {model.name} is made for {lowest_V:g} to {highest_V:g} V."
        findings.append(Finding(Consequence.WARNED, text, "Check its supply."))
    return findings
