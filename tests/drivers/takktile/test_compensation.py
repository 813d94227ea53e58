"""The barometer's compensation, held against the data sheet's example and the reference's recomputed rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ProtocolError
from drivers.takktile.compensation import pressure_counts, pressure_kPa, raw_pressure, saturated, unpack_coefficients
from drivers.takktile.frames import Cell, RawCell, unpack_cell

CELL = Cell(0, 0)
SHEET, OTHER = "3ECEB3F9C51733C8", "42A8B5C0BB603A10"


@pytest.mark.parametrize(
    ("coefficients", "words", "counts", "kPa"),
    [
        (SHEET, "66807EC0", 733.213, 96.587),
        (OTHER, "65C07B40", 837.775, 103.231),
        (OTHER, "5A807B40", 922.534, 108.617),
        (OTHER, "65C08140", 820.695, 102.146),
    ],
)
def test_worked_examples(coefficients: str, words: str, counts: float, kPa: float) -> None:
    """Rows of reference 4, the first from the data sheet; the last is the one that a mirrored temperature spoils."""
    found = pressure_counts(unpack_coefficients(bytes.fromhex(coefficients), CELL), unpack_cell(bytes.fromhex(words)))
    assert found == pytest.approx(counts, abs=1e-3)
    assert pressure_kPa(found) == pytest.approx(kPa, abs=1e-3)


@pytest.mark.parametrize(
    ("data", "values"),
    [
        (SHEET, (2009.75, -2.375854, -0.920471, 0.000790119)),
        (OTHER, (2133.0, -2.3203125, -1.072265625, 0.000885963)),
    ],
)
def test_coefficients_are_the_references(data: str, values: tuple[float, ...]) -> None:
    """Binary points of reference 4, the fourteen left-justified bits of c12 with their sign."""
    c = unpack_coefficients(bytes.fromhex(data), CELL)
    assert (c.a0, c.b1, c.b2, c.c12) == pytest.approx(values, abs=1e-6)


@pytest.mark.parametrize("data", [bytes(8), b"\xff" * 8, bytes.fromhex(SHEET)[:7], bytes.fromhex(SHEET) * 2])
def test_what_no_barometer_holds_is_refused(data: bytes) -> None:
    """A floating or shorted bus and a short answer do not become a pressure."""
    with pytest.raises(ProtocolError, match="coefficients"):
        unpack_coefficients(data, CELL)


@given(st.sampled_from((SHEET, OTHER)), st.integers(0, 1023), st.integers(0, 1023))
def test_more_pressure_is_a_smaller_count_everywhere(data: str, pressure: int, temperature: int) -> None:
    """The sign trap of reference 4: over the whole range compensated pressure grows as the raw count falls."""
    c = unpack_coefficients(bytes.fromhex(data), CELL)
    here, below = (pressure_counts(c, RawCell(p, temperature)) for p in (pressure, pressure - 1))
    assert below > here
    assert raw_pressure(c, here, temperature) == pytest.approx(pressure, abs=1e-6)


def test_the_converters_ends_and_wraps_are_told() -> None:
    """2 and 1021 are at the end, a jump of more than 512 is a wrap; 3, 1020 and a jump of 512 are readings."""
    first = np.array([2, 3, 1020, 1021, 900, 900])
    assert saturated(first, None).tolist() == [True, False, False, True, False, False]
    assert saturated(first, np.array([2, 3, 1020, 1021, 387, 388])).tolist() == [True, False, False, True, True, False]
