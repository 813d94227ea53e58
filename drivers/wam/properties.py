"""Property numbers of WAM pucks, as data per firmware version, and the values that have names.

A number means different things in the boot monitor, in a motor puck and in the safety puck, and moves between firmware
versions; so ask `property_id` with the version that the puck reported. Motor and safety firmware below 61 numbers its
properties differently and is refused. Source: WAM reference 3.1 (numbers) and 3.2 (meaning).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

from drivers.errors import InputError

PuckKind = Literal["motor", "safety", "monitor"]

OLDEST_FIRMWARE = 61

STATUS_MONITOR = 0
"""STAT of a puck in its boot monitor."""
STATUS_READY = 2
"""STAT of a puck that runs its main firmware; written, it starts that firmware."""
MOTOR_IDLE = 0
"""Motor puck MODE: no torque, resistive braking."""
MOTOR_TORQUE = 2
"""Motor puck MODE: apply the packed torques."""
SAFETY_ESTOP = 0
SAFETY_IDLE = 1
SAFETY_ACTIVE = 2
IDLE_REQUEST_FIRMWARE = 197
"""First safety firmware that lowers its MODE when the host asks."""


def _numbered(names: str, first: int = 0) -> dict[str, int]:
    return {name: number for number, name in enumerate(names.split(), start=first)}


_MONITOR = _numbered("VERS ROLE SN ID ERROR STAT ADDR VALUE LOCK SAVE LOAD")

_BOTH = _numbered(
    "VERS ROLE SN ID ERROR STAT ADDR VALUE MODE TEMP PTEMP OTEMP BAUD LOCK DIG0 DIG1 FET0 FET1 ANA0 ANA1 THERM "
    "VBUS IMOTOR VLOGIC ILOGIC SG GRPA GRPB GRPC CMD SAVE LOAD DEF FIND X0 X1 X2 X3 X4 X5 X6 X7"
)

_SAFETY = _numbered("ZERO PEN SAFE VL1 VL2 TL1 TL2 VOLTL1 VOLTL2 VOLTH1 VOLTH2 PWR MAXPWR IFAULT VNOM", first=42)

_MOTOR_FIXED = {"T": 42, "MT": 43, "MV": 45, "MCV": 46, "MOV": 47, "P": 48, "DP": 50, "E": 52, "OT": 54, "CT": 56}

_MOTOR_COLUMNS = (61, 63, 64, 65, 68, 114, 119, 125, 132, 142, 175)
"""First firmware version of each column below."""

_MOTOR_BY_VERSION: dict[str, tuple[int | None, ...]] = {
    "V": (44, 44, 44, 44, 44, 106, 44, 44, 44, 44, 44),
    "M": (96, 96, 96, 58, 58, 58, 58, 58, 58, 58, 58),
    "DS": (70, 70, 58, 60, 60, 60, 60, 60, 60, 60, 60),
    "MOFST": (58, 58, 59, 61, 61, 61, 61, 61, 61, 61, 61),
    "IOFST": (59, 59, 60, 62, 62, 62, 62, 62, 62, 62, 62),
    "UPSECS": (60, 60, 61, 63, 63, 63, 63, 63, 63, 63, 63),
    "OD": (61, 61, 62, 64, 64, 64, 64, 64, 64, 64, 64),
    "MDS": (62, 62, 63, 65, 65, 65, 65, 65, 65, 65, 65),
    "MECH": (63, 63, 64, 66, 66, 66, 66, 66, 66, 66, 66),
    "CTS": (65, 65, 66, 68, 68, 68, 68, 68, 68, 68, 68),
    "PIDX": (67, 67, 68, 70, 70, 70, 70, 70, 70, 70, 70),
    "HSG": (68, 68, 69, 71, 71, 71, 71, 71, 71, 71, 71),
    "LSG": (69, 69, 70, 72, 72, 72, 72, 72, 72, 72, 72),
    "IVEL": (71, 71, 71, 73, 73, 73, 73, 73, 73, 73, 73),
    "IOFF": (72, 72, 72, 74, 74, 74, 74, 74, 74, 74, 74),
    "MPE": (73, 73, 73, 76, 76, 76, 76, 76, 76, 76, 76),
    "EN": (74, 74, 74, 77, 77, 77, 77, 77, 94, 94, 94),
    "HOLD": (None, None, None, 94, 94, 94, 94, 94, 77, 77, 77),
    "TSTOP": (75, 75, 75, 78, 78, 78, 78, 78, 78, 78, 78),
    "KP": (76, 76, 76, 79, 79, 79, 79, 79, 79, 79, 79),
    "KD": (77, 77, 77, 80, 80, 80, 80, 80, 80, 80, 80),
    "KI": (78, 78, 78, 81, 81, 81, 81, 81, 81, 81, 81),
    "ACCEL": (79, 79, 79, 82, 82, 82, 82, 82, 82, 82, 82),
    "TENST": (80, 80, 80, 83, 83, 83, 83, 83, 83, 83, 83),
    "TENSO": (81, 81, 81, 84, 84, 84, 84, 84, 84, 84, 84),
    "JIDX": (82, 82, 82, 85, 85, 85, 85, 85, 85, 85, 85),
    "IPNM": (83, 83, 83, 86, 86, 86, 86, 86, 86, 86, 86),
    "HALLS": (84, 84, 86, 89, 87, 87, 87, 87, 87, 87, 87),
    "HALLH": (85, 85, 84, 87, 88, 88, 88, 88, 88, 88, 88),
    "POLES": (87, 87, 87, 90, 90, 90, 90, 90, 90, 90, 90),
    "IKP": (88, 88, 88, 91, 91, 91, 91, 91, 91, 91, 91),
    "IKI": (89, 89, 89, 92, 92, 92, 92, 92, 92, 92, 92),
    "IKCOR": (90, 90, 90, 93, 93, 93, 93, 93, 93, 93, 93),
    "TIE": (None, None, None, 95, 95, 95, 95, 95, 100, 100, 100),
    "JP": (None, None, None, None, None, None, None, 96, 96, 96, 96),
    "JOFST": (None, None, None, None, None, None, None, 98, 98, 98, 98),
    "ECMAX": (91, 91, 91, 96, 96, 96, 96, 100, 101, 101, 101),
    "ECMIN": (92, 92, 92, 97, 97, 97, 97, 101, 102, 102, 102),
    "LFLAGS": (93, 93, 93, 98, 98, 98, 98, 102, 103, 103, 103),
    "LCTC": (95, 94, 94, 99, 99, 99, 99, 103, 104, 104, 104),
    "LCVC": (94, 95, 95, 100, 100, 100, 100, 104, 105, 105, 105),
}

# Properties that came, or whose number changed meaning, between the columns: name, first, last version, number.
_MOTOR_RANGES = (
    ("VCMD", 114, 118, 44),
    ("PLOG", 114, 118, 101),
    ("PDATA", 114, 118, 102),
    ("A", 114, 118, 104),
    ("TACT", 142, None, 106),
    ("TACTID", 145, None, 107),
    ("ITOR", 168, 174, 108),
    ("IHIT", 175, None, 108),
)


@lru_cache(maxsize=64)
def property_numbers(firmware: int, kind: PuckKind) -> Mapping[str, int]:
    """All properties of a puck, name to number.

    `firmware` is the VERS that the puck reported; the boot monitor's numbers are the same in all versions. Raises
    InputError for firmware below 61 and for an unknown kind.
    """
    if kind == "monitor":
        return MappingProxyType(_MONITOR)
    if kind not in ("motor", "safety"):
        raise InputError(f"puck kind {kind!r} is unknown; expected 'motor', 'safety' or 'monitor'.")
    if firmware < OLDEST_FIRMWARE:
        raise InputError(
            f"{kind} puck firmware {firmware} is not supported; expected version {OLDEST_FIRMWARE} or later.",
            help="Older pucks number their properties differently; have the firmware updated.",
        )
    if kind == "safety":
        return MappingProxyType(_BOTH | _SAFETY)
    column = max(index for index, first in enumerate(_MOTOR_COLUMNS) if first <= firmware)
    by_version = {name: row[column] for name, row in _MOTOR_BY_VERSION.items()}
    numbers = _BOTH | _MOTOR_FIXED | {name: number for name, number in by_version.items() if number is not None}
    for name, first, last, number in _MOTOR_RANGES:
        if first <= firmware and (last is None or firmware <= last):
            numbers[name] = number
    return MappingProxyType(numbers)


def property_id(name: str, firmware: int, kind: PuckKind) -> int:
    """Number of the property `name`; InputError if that firmware has no such property."""
    numbers = property_numbers(firmware, kind)
    if name not in numbers:
        raise InputError(
            f"a {kind} puck with firmware {firmware} has no property {name!r}; expected one of "
            f"{', '.join(sorted(numbers))}."
        )
    return numbers[name]
