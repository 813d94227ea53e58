"""What a cell's raw words mean: the barometer's own coefficients applied, in counts of compensated pressure.

Unit: Pcomp counts, 65/1023 kPa each, growing with force (the raw pressure count falls). Everything is unsigned: to read
ten bits as two's complement mirrors cold cells and strong vacuum. Source: TakkTile reference 4 (MPL115A2).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ProtocolError
from drivers.takktile.frames import DEVICE, Cell, RawCell

COEFFICIENT_BYTES = 8
KPA_PER_COUNT = 65.0 / 1023.0
LOWEST_KPA = 50.0
COUNTS_PER_KELVIN = -5.35
"""Of the temperature word: warmer is less. Its zero differs from chip to chip, so only changes mean something."""
SMALLEST_PRESSURE, LARGEST_PRESSURE = 2, 1021
"""At or beyond these the converter is at its end."""
LARGEST_JUMP = 512
"""Raw counts from one frame to the next; more is a wrap beyond the rated range."""
_WORDS = struct.Struct(">hhhh")


@dataclass(frozen=True)
class Coefficients:
    """Of one cell: Pcomp = a0 + (b1 + c12 · T) · P + b2 · T."""

    a0: float
    b1: float
    b2: float
    c12: float


def unpack_coefficients(data: bytes, cell: Cell) -> Coefficients:
    """Eight bytes from register 0x04. Raises ProtocolError for what no barometer holds."""
    if len(data) != COEFFICIENT_BYTES:
        raise ProtocolError(DEVICE, f"{cell} has {len(data)} bytes of coefficients; expected {COEFFICIENT_BYTES}.")
    a0, b1, b2, c12 = _WORDS.unpack(data)
    coefficients = Coefficients(a0 / 2**3, b1 / 2**13, b2 / 2**14, (c12 >> 2) / 2**22)
    # More pressure is a smaller count whatever the temperature: a bus that floats or is shorted reads otherwise.
    if not (coefficients.a0 > 0.0 and coefficients.b1 + coefficients.c12 * 1023 < 0.0):
        raise ProtocolError(
            DEVICE, f"{cell} gives {data.hex(' ')} for coefficients, which no barometer has.", help="Check its wiring."
        )
    return coefficients


def pressure_counts(coefficients: Coefficients, raw: RawCell) -> float:
    """Compensated pressure, Pcomp counts."""
    c = coefficients
    return c.a0 + (c.b1 + c.c12 * raw.temperature) * raw.pressure + c.b2 * raw.temperature


def raw_pressure(coefficients: Coefficients, counts: float, temperature: float) -> float:
    """The inverse: the raw pressure count, not rounded, at a raw temperature count."""
    c = coefficients
    return (counts - c.a0 - c.b2 * temperature) / (c.b1 + c.c12 * temperature)


def pressure_kPa(counts: float) -> float:
    """Absolute pressure of compensated counts."""
    return counts * KPA_PER_COUNT + LOWEST_KPA


def at_end(pressure: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which raw pressures (n,) are at the converter's end."""
    ends: NDArray[np.bool_] = (pressure <= SMALLEST_PRESSURE) | (pressure >= LARGEST_PRESSURE)
    return ends


def saturated(pressure: NDArray[np.int64], previous: NDArray[np.int64] | None) -> NDArray[np.bool_]:
    """Which raw pressures (n,) are at the converter's end, or jumped since `previous` as only a wrap does."""
    if previous is None:
        return at_end(pressure)
    jumped: NDArray[np.bool_] = np.abs(pressure - previous) > LARGEST_JUMP
    return at_end(pressure) | jumped
