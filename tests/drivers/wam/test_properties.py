"""Property numbers: every cell of the tables of the WAM reference 3.1, transcribed here as text, and their laws."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.wam.properties import PuckKind, property_bytes, property_id, property_numbers

KINDS: tuple[PuckKind, ...] = ("motor", "safety", "monitor")

MONITOR = "VERS 0, ROLE 1, SN 2, ID 3, ERROR 4, STAT 5, ADDR 6, VALUE 7, LOCK 8, SAVE 9, LOAD 10"

BOTH_FROM_61 = (
    "VERS 0, ROLE 1, SN 2, ID 3, ERROR 4, STAT 5, ADDR 6, VALUE 7, MODE 8, TEMP 9, PTEMP 10, OTEMP 11, BAUD 12, "
    "LOCK 13, DIG0 14, DIG1 15, FET0 16, FET1 17, ANA0 18, ANA1 19, THERM 20, VBUS 21, IMOTOR 22, VLOGIC 23, "
    "ILOGIC 24, SG 25, GRPA 26, GRPB 27, GRPC 28, CMD 29, SAVE 30, LOAD 31, DEF 32, FIND 33, X0 34, X1 35, "
    "X2 36, X3 37, X4 38, X5 39, X6 40, X7 41"
)

SAFETY_FROM_61 = (
    "ZERO 42, PEN 43, SAFE 44, VL1 45, VL2 46, TL1 47, TL2 48, VOLTL1 49, VOLTL2 50, VOLTH1 51, VOLTH2 52, PWR 53, "
    "MAXPWR 54, IFAULT 55, VNOM 56"
)

MOTOR_FROM_61 = "T 42, MT 43, MV 45, MCV 46, MOV 47, P 48, DP 50, E 52, OT 54, CT 56"

MOTOR_BY_VERSION = """
property 61–62 63 64 65–67 68–113 114–118 119–124 125–131 132–141 142–174 ≥175
V 44 44 44 44 44 106 44 44 44 44 44
M 96 96 96 58 58 58 58 58 58 58 58
DS 70 70 58 60 60 60 60 60 60 60 60
MOFST 58 58 59 61 61 61 61 61 61 61 61
IOFST 59 59 60 62 62 62 62 62 62 62 62
UPSECS 60 60 61 63 63 63 63 63 63 63 63
OD 61 61 62 64 64 64 64 64 64 64 64
MDS 62 62 63 65 65 65 65 65 65 65 65
MECH 63 63 64 66 66 66 66 66 66 66 66
CTS 65 65 66 68 68 68 68 68 68 68 68
PIDX 67 67 68 70 70 70 70 70 70 70 70
HSG 68 68 69 71 71 71 71 71 71 71 71
LSG 69 69 70 72 72 72 72 72 72 72 72
IVEL 71 71 71 73 73 73 73 73 73 73 73
IOFF 72 72 72 74 74 74 74 74 74 74 74
MPE 73 73 73 76 76 76 76 76 76 76 76
EN 74 74 74 77 77 77 77 77 94 94 94
HOLD – – – 94 94 94 94 94 77 77 77
TSTOP 75 75 75 78 78 78 78 78 78 78 78
KP 76 76 76 79 79 79 79 79 79 79 79
KD 77 77 77 80 80 80 80 80 80 80 80
KI 78 78 78 81 81 81 81 81 81 81 81
ACCEL 79 79 79 82 82 82 82 82 82 82 82
TENST 80 80 80 83 83 83 83 83 83 83 83
TENSO 81 81 81 84 84 84 84 84 84 84 84
JIDX 82 82 82 85 85 85 85 85 85 85 85
IPNM 83 83 83 86 86 86 86 86 86 86 86
HALLS 84 84 86 89 87 87 87 87 87 87 87
HALLH 85 85 84 87 88 88 88 88 88 88 88
POLES 87 87 87 90 90 90 90 90 90 90 90
IKP 88 88 88 91 91 91 91 91 91 91 91
IKI 89 89 89 92 92 92 92 92 92 92 92
IKCOR 90 90 90 93 93 93 93 93 93 93 93
TIE – – – 95 95 95 95 95 100 100 100
JP – – – – – – – 96 96 96 96
JOFST – – – – – – – 98 98 98 98
ECMAX 91 91 91 96 96 96 96 100 101 101 101
ECMIN 92 92 92 97 97 97 97 101 102 102 102
LFLAGS 93 93 93 98 98 98 98 102 103 103 103
LCTC 95 94 94 99 99 99 99 103 104 104 104
LCVC 94 95 95 100 100 100 100 104 105 105 105
"""

BELOW_61 = """
property 32 33–35 36–43 44 45–46 47–49 50 51–60
T 10 10 10 10 10 10 9 9
P 26 26 26 26 26 26 26 26
MT 16 16 16 16 16 16 16 16
V 12 12 12 12 12 12 10 10
E 13 13 13 13 13 14 14 14
B 14 14 14 14 14 13 11 11
CTS 30 30 30 30 30 30 30 30
MECH 28 28 28 28 28 28 28 28
PIDX 54 54 54 54 54 54 54 54
GRPA 51 51 51 51 51 51 51 51
GRPB 52 52 52 52 52 52 52 52
GRPC 53 53 53 53 53 53 53 53
IPNM – 57 108 108 108 108 108 108
JIDX – 55 107 107 107 107 107 107
POLES – – – 112 112 112 112 112
MOFST 20 20 20 20 20 20 20 20
IOFST 21 21 21 21 21 21 21 21
TEMP 39 39 39 39 39 39 39 39
THERM 46 46 46 46 46 46 46 46
VBUS 47 47 47 47 47 47 47 47
SAVE 87 89 87 87 87 87 87 87
LOAD 88 90 88 88 88 88 88 88
DEF 89 91 89 89 89 89 89 89
FIND – – – – 117 117 117 117
ECMAX – – – 113 113 113 113 113
ECMIN – – – 114 114 114 114 114
LOCK 41 41 41 41 41 41 41 41
ZERO 55 56 55 55 55 55 55 55
PEN 85 87 85 85 85 85 85 85
SAFE 86 88 86 86 86 86 86 86
VL1 90 92 90 90 90 90 90 90
VL2 91 93 91 91 91 91 91 91
TL1 92 94 92 92 92 92 92 92
TL2 93 95 93 93 93 93 93 93
VOLTL1 94 96 94 94 94 94 94 94
VOLTL2 95 97 95 95 95 95 95 95
VOLTH1 96 98 96 96 96 96 96 96
VOLTH2 97 99 97 97 97 97 97 97
MAXPWR 98 100 98 98 98 98 98 98
PWR 99 101 99 99 99 99 99 99
IFAULT 100 102 100 100 100 100 100 100
VNOM 104 106 104 104 104 104 104 104
"""

LAST = 255
"""Stands for the end of an open range of versions."""


def _pairs(text: str) -> list[tuple[str, int]]:
    return [(name, int(number)) for name, number in (pair.split() for pair in text.split(", "))]


def _cells(table: str) -> list[tuple[str, int, int, str]]:
    """Name, first and last version of a column, and what the table has there."""
    head, *rows = [line.split() for line in table.strip().splitlines()]
    ranges = []
    for column in head[1:]:
        first, _, last = column.removeprefix("≥").partition("–")
        ranges.append((int(first), int(last or (LAST if column.startswith("≥") else first))))
    return [(row[0], first, last, cell) for row in rows for (first, last), cell in zip(ranges, row[1:], strict=True)]


def _check(name: str, firmware: int, kind: PuckKind, cell: str) -> None:
    if cell == "–":
        with pytest.raises(InputError, match=name):
            property_id(name, firmware, kind)
    else:
        assert property_id(name, firmware, kind) == int(cell), (name, firmware, kind)


def test_every_cell_from_version_61_on() -> None:
    """Protects against writing one property in the place of another, at both ends of every column's versions."""
    cells = _cells(MOTOR_BY_VERSION)
    assert len(cells) == 41 * 11
    for name, first, last, cell in cells:
        _check(name, first, "motor", cell)
        _check(name, last, "motor", cell)


def test_every_cell_below_version_61() -> None:
    """Protects old arms: one table for motor and safety pucks, at both ends of every column's versions."""
    cells = _cells(BELOW_61)
    assert len(cells) == (27 + 15) * 8
    for name, first, last, cell in cells:
        for kind in KINDS[:2]:
            _check(name, first, kind, cell)
            _check(name, last, kind, cell)


@pytest.mark.parametrize("firmware", [61, 62, 118, 141, 197, 200, LAST])
def test_fixed_numbers(firmware: int) -> None:
    """Protects what never moves from 61 on: the common part, the safety puck's and the motor puck's fixed one."""
    for name, number in _pairs(BOTH_FROM_61) + _pairs(SAFETY_FROM_61):
        assert property_id(name, firmware, "safety") == number
    for name, number in _pairs(BOTH_FROM_61) + _pairs(MOTOR_FROM_61):
        assert property_id(name, firmware, "motor") == number
    assert dict(_pairs(MONITOR)) == dict(property_numbers(firmware, "monitor"))


@pytest.mark.parametrize(
    ("name", "number", "first", "last"),
    [
        ("VCMD", 44, 114, 118),
        ("PLOG", 101, 114, 118),
        ("PDATA", 102, 114, 118),
        ("A", 104, 114, 118),
        ("TACT", 106, 142, LAST),
        ("TACTID", 107, 145, LAST),
        ("ITOR", 108, 168, 174),
        ("IHIT", 108, 175, LAST),
    ],
)
def test_properties_of_some_versions_only(name: str, number: int, first: int, last: int) -> None:
    """Protects the note below the table: these exist in their versions and not one before or behind."""
    for firmware in (first, last):
        assert property_id(name, firmware, "motor") == number
    for firmware in {first - 1, last + 1} - {LAST + 1}:
        with pytest.raises(InputError, match=name):
            property_id(name, firmware, "motor")


@given(st.integers(32, LAST), st.sampled_from(KINDS))
def test_a_number_never_names_two_properties(firmware: int, kind: PuckKind) -> None:
    """Law: in one firmware and kind numbers are unique, within a byte's seven bits, and start-up's names are there."""
    numbers = property_numbers(firmware, kind)
    assert len(set(numbers.values())) == len(numbers)
    assert all(0 <= number <= 127 for number in numbers.values())
    assert {"VERS", "ROLE", "STAT"} <= numbers.keys()
    assert [numbers[name] for name in ("VERS", "ROLE", "STAT")] == [0, 1, 5]


@given(st.integers(61, LAST))
def test_wide_properties_have_a_second_number(firmware: int) -> None:
    """Law: the number behind a 32-bit motor property is nobody's, because it takes two (reference 3.1)."""
    numbers = property_numbers(firmware, "motor")
    for name, number in numbers.items():
        if property_bytes(name, firmware) == 4:
            assert number + 1 not in numbers.values(), name


@pytest.mark.parametrize(
    ("name", "firmware", "width"),
    [("P", 200, 4), ("CTS", 200, 4), ("MECH", 60, 4), ("PEN", 197, 4), ("IPNM", 200, 2), ("E", 60, 2), ("E", 61, 4)],
)
def test_widths(name: str, firmware: int, width: int) -> None:
    """Protects the reply's length in a simulated puck: rows of reference 2.3 and the 32-bit list of 3.1."""
    assert property_bytes(name, firmware) == width


@pytest.mark.parametrize("kind", ["motor", "safety"])
def test_unknown_firmware_and_kind_are_refused(kind: PuckKind) -> None:
    """Protects arms of which nobody knows the numbers: no guess is sent to them."""
    with pytest.raises(InputError, match="31 is not supported"):
        property_id("P", 31, kind)
    with pytest.raises(InputError, match="unknown"):
        property_id("P", 200, "hand")  # type: ignore[arg-type]  # a caller without a type checker
    with pytest.raises(InputError, match="'ZERO'"):
        property_id("ZERO", 200, "motor")
