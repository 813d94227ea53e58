"""What is known of one finger's pad: which cells it has, what each is worth in newtons, how it drifts with temperature.

Unit of a cell's signal: Pcomp counts above its zero. Source: TakkTile reference 5, 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite

from drivers.errors import InputError, ProtocolError
from drivers.takktile.frames import DEVICE, Cell

NOMINAL_N_PER_COUNT = 0.01
"""For an uncalibrated cell: 100 counts a newton, an order of magnitude only (TakkTile reference 5)."""


@dataclass(frozen=True)
class PadCalibration:
    """One finger: F = Σ gain · (counts above zero − thermal · change of the temperature count)."""

    cells: tuple[Cell, ...]
    gain_N_per_count: tuple[float, ...]
    thermal_counts: tuple[float, ...]
    """Pcomp counts per temperature count, of each cell."""
    coefficients: tuple[str, ...] = field(default=())
    """Each cell's own coefficients, in hex, with which it was calibrated; they name the chip. Empty: not calibrated."""

    def __post_init__(self) -> None:
        count = len(self.cells)
        numbers = (*self.gain_N_per_count, *self.thermal_counts)
        if count == 0 or len(set(self.cells)) != count:
            raise InputError(f"cells {self.cells} are no pad; expected at least one cell, none of them twice.")
        if len(self.gain_N_per_count) != count or len(self.thermal_counts) != count or not all(map(isfinite, numbers)):
            raise InputError(f"a pad of {count} cells needs as many finite gains and thermal coefficients.")
        if min(self.gain_N_per_count) < 0.0 or max(self.gain_N_per_count) <= 0.0:
            raise InputError(f"gains {self.gain_N_per_count} are not accepted; expected none below 0 and one above.")
        if self.coefficients and len(self.coefficients) != count:
            raise InputError(f"a pad of {count} cells has {len(self.coefficients)} sets of coefficients.")

    @property
    def calibrated(self) -> bool:
        """Whether newtons mean newtons."""
        return bool(self.coefficients)


def nominal(cells: Sequence[Cell]) -> PadCalibration:
    """A pad that was never calibrated."""
    return PadCalibration(tuple(cells), (NOMINAL_N_PER_COUNT,) * len(cells), (0.0,) * len(cells))


def check_cells(
    pads: Sequence[PadCalibration], alive: Sequence[Cell], coefficient_bytes: dict[Cell, bytes]
) -> tuple[Cell, ...]:
    """Hold the pads' map against the scan; the cells that are mapped and dead.

    Raises ProtocolError if a finger has no cell left, and InputError if a cell belongs to both fingers or is another
    chip than the one that was calibrated.
    """
    mapped = [cell for pad in pads for cell in pad.cells]
    if twice := sorted({cell for cell in mapped if mapped.count(cell) > 1}):
        raise InputError(f"cells {_places(twice)} belong to both fingers.", help="Correct the map under [tactile].")
    for pad, side in zip(pads, ("right", "left"), strict=True):
        present = [cell for cell in pad.cells if cell in alive]
        if not present:
            raise ProtocolError(
                DEVICE,
                f"none of the {side} pad's cells {_places(pad.cells)} is alive; alive are {_places(alive)}.",
                help="Check the strip's cable, and the map under [tactile].",
            )
        for cell, expected in zip(pad.cells, pad.coefficients, strict=False):
            if cell in present and coefficient_bytes[cell].hex() != expected.lower():
                raise InputError(
                    f"the {side} pad's cell {_places([cell])} is not the one that was calibrated.",
                    help="Run: stillgrasp calibrate tactile",
                )
    return tuple(cell for cell in mapped if cell not in alive)


def _places(cells: Sequence[Cell]) -> str:
    return ", ".join(f"{cell.row}:{cell.column}" for cell in cells)
