"""Property numbers of WAM pucks, as data per firmware version, and the values that have names.

A number means different things in the boot monitor, in a motor puck and in the safety puck, and moves between firmware
versions; so ask `property_id` with the version that the puck reported, and ask for that version again after waking.
Below version 61 one table served both kinds of puck; older than 32 nothing is known. Source: WAM reference 3.1
(numbers) and 3.2 (meaning); below 61 the reference leaves out numbers 0 to 8, which have never changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

from drivers.errors import InputError

PuckKind = Literal["motor", "safety", "monitor"]

OLDEST_FIRMWARE = 32
SEPARATE_TABLES_FIRMWARE = 61
"""First firmware in which motor and safety pucks number their properties apart."""

STATUS_MONITOR = 0
"""STAT of a puck in its boot monitor."""
STATUS_ERROR = 1
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
PENDANT_FIRMWARE = 197
"""First safety firmware that tells the pendant's state (PEN)."""
ABSOLUTE_ENCODER_FIRMWARE = 118
"""First motor firmware whose MECH is used for zeroing (WAM reference 4.4)."""

ROLE_KIND = 0x1F
"""Bits of ROLE that say what a puck is; the values are below."""
ROLE_MOTOR = 0
ROLE_GIMBALS = 1
ROLE_SAFETY = 2
ROLE_HAND = 5
ROLE_FORCE_SENSOR = 6
ROLE_ABSOLUTE_ENCODER = 0x0100
"""Bit of ROLE: a magnetic encoder that knows the motor's angle within one turn."""


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


_OLD_COLUMNS = (32, 33, 36, 44, 45, 47, 50, 51)
"""First firmware version of each column below; the last reaches to version 60."""

_OLD_FIXED = _numbered("VERS ROLE SN ID ERROR STAT ADDR VALUE MODE")

_OLD_BY_VERSION: dict[str, tuple[int | None, ...]] = {
    "T": (10, 10, 10, 10, 10, 10, 9, 9),
    "P": (26, 26, 26, 26, 26, 26, 26, 26),
    "MT": (16, 16, 16, 16, 16, 16, 16, 16),
    "V": (12, 12, 12, 12, 12, 12, 10, 10),
    "E": (13, 13, 13, 13, 13, 14, 14, 14),
    "B": (14, 14, 14, 14, 14, 13, 11, 11),
    "CTS": (30, 30, 30, 30, 30, 30, 30, 30),
    "MECH": (28, 28, 28, 28, 28, 28, 28, 28),
    "PIDX": (54, 54, 54, 54, 54, 54, 54, 54),
    "GRPA": (51, 51, 51, 51, 51, 51, 51, 51),
    "GRPB": (52, 52, 52, 52, 52, 52, 52, 52),
    "GRPC": (53, 53, 53, 53, 53, 53, 53, 53),
    "IPNM": (None, 57, 108, 108, 108, 108, 108, 108),
    "JIDX": (None, 55, 107, 107, 107, 107, 107, 107),
    "POLES": (None, None, None, 112, 112, 112, 112, 112),
    "MOFST": (20, 20, 20, 20, 20, 20, 20, 20),
    "IOFST": (21, 21, 21, 21, 21, 21, 21, 21),
    "TEMP": (39, 39, 39, 39, 39, 39, 39, 39),
    "THERM": (46, 46, 46, 46, 46, 46, 46, 46),
    "VBUS": (47, 47, 47, 47, 47, 47, 47, 47),
    "SAVE": (87, 89, 87, 87, 87, 87, 87, 87),
    "LOAD": (88, 90, 88, 88, 88, 88, 88, 88),
    "DEF": (89, 91, 89, 89, 89, 89, 89, 89),
    "FIND": (None, None, None, None, 117, 117, 117, 117),
    "ECMAX": (None, None, None, 113, 113, 113, 113, 113),
    "ECMIN": (None, None, None, 114, 114, 114, 114, 114),
    "LOCK": (41, 41, 41, 41, 41, 41, 41, 41),
    "ZERO": (55, 56, 55, 55, 55, 55, 55, 55),
    "PEN": (85, 87, 85, 85, 85, 85, 85, 85),
    "SAFE": (86, 88, 86, 86, 86, 86, 86, 86),
    "VL1": (90, 92, 90, 90, 90, 90, 90, 90),
    "VL2": (91, 93, 91, 91, 91, 91, 91, 91),
    "TL1": (92, 94, 92, 92, 92, 92, 92, 92),
    "TL2": (93, 95, 93, 93, 93, 93, 93, 93),
    "VOLTL1": (94, 96, 94, 94, 94, 94, 94, 94),
    "VOLTL2": (95, 97, 95, 95, 95, 95, 95, 95),
    "VOLTH1": (96, 98, 96, 96, 96, 96, 96, 96),
    "VOLTH2": (97, 99, 97, 97, 97, 97, 97, 97),
    "MAXPWR": (98, 100, 98, 98, 98, 98, 98, 98),
    "PWR": (99, 101, 99, 99, 99, 99, 99, 99),
    "IFAULT": (100, 102, 100, 100, 100, 100, 100, 100),
    "VNOM": (104, 106, 104, 104, 104, 104, 104, 104),
}

_WIDE = frozenset({"P", "DP", "E", "OT", "CT", "MECH", "CTS", "JP", "JOFST", "PEN"})
"""Properties of 32 bits."""


@lru_cache(maxsize=64)
def property_numbers(firmware: int, kind: PuckKind) -> Mapping[str, int]:
    """All properties of a puck, name to number.

    `firmware` is the VERS that the puck reported; the boot monitor's numbers are the same in all versions. Raises
    InputError for firmware below 32 and for an unknown kind.
    """
    if kind == "monitor":
        return MappingProxyType(_MONITOR)
    if kind not in ("motor", "safety"):
        raise InputError(f"puck kind {kind!r} is unknown; expected 'motor', 'safety' or 'monitor'.")
    if firmware < OLDEST_FIRMWARE:
        raise InputError(
            f"{kind} puck firmware {firmware} is not supported; expected version {OLDEST_FIRMWARE} or later.",
            help="Nobody has published how older pucks number their properties; have the firmware updated.",
        )
    if firmware < SEPARATE_TABLES_FIRMWARE:
        return MappingProxyType(_OLD_FIXED | _column(_OLD_BY_VERSION, _OLD_COLUMNS, firmware))
    if kind == "safety":
        return MappingProxyType(_BOTH | _SAFETY)
    numbers = _BOTH | _MOTOR_FIXED | _column(_MOTOR_BY_VERSION, _MOTOR_COLUMNS, firmware)
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


def property_bytes(name: str, firmware: int) -> int:
    """Width of a property in bytes, 2 or 4. A reply may still come in either: no source ties its length to this."""
    old_error = name == "E" and firmware < SEPARATE_TABLES_FIRMWARE  # one number in those tables, so 16 bits
    return 4 if name in _WIDE and not old_error else 2


def _column(table: Mapping[str, tuple[int | None, ...]], columns: tuple[int, ...], firmware: int) -> dict[str, int]:
    """The numbers of the last column that begins at or before `firmware`."""
    column = max(index for index, first in enumerate(columns) if first <= firmware)
    return {name: number for name, row in table.items() if (number := row[column]) is not None}
