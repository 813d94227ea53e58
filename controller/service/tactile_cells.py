"""What the tactile process tells of single cells: their readings, for the state and the recording, and their faults.

A cell that dies, sticks, becomes noisy or implausible drops out of its finger's sum by itself; the operator hears of it
once, when that has lasted, and once more when it counts again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controller.pad_messages import CellState
from drivers.clock import nanoseconds
from drivers.takktile.calibration import PadCalibration
from drivers.takktile.compensation import COEFFICIENT_BYTES
from drivers.takktile.frames import Cell
from drivers.takktile.pads import CellReadings
from drivers.takktile.quality import BROKEN, CellQuality

LASTING_S = 1.0


def cell_states(
    pads: tuple[PadCalibration, PadCalibration],
    cells: tuple[Cell, ...],
    readings: CellReadings,
    coefficients: dict[Cell, bytes],
) -> tuple[CellState, ...]:
    """Every mapped cell, right before left; one that is not among the bridge's `cells` is dead."""
    raw, quality = readings.raw.tolist(), readings.quality.tolist()
    known = np.where(readings.quality & CellQuality.NO_ZERO, 0.0, readings.counts).tolist()
    zero, zero_temperature = np.nan_to_num(readings.zero_counts).tolist(), readings.zero_temperature.tolist()
    smooth = np.nan_to_num(readings.temperature).tolist()
    force_N = np.where(readings.quality & CellQuality.NO_ZERO, 0.0, readings.force_N).tolist()
    place_of = {cell: index for index, cell in enumerate(cells)}
    states = []
    for finger, pad in enumerate(pads):
        for cell in pad.cells:
            i = place_of.get(cell)
            if i is None:
                dead = (CellQuality.DEAD, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, bytes(COEFFICIENT_BYTES))
                states.append(CellState(finger, cell.row, cell.column, *dead))
                continue
            pressure, temperature = raw[i]
            signal = (known[i], zero[i], zero_temperature[i], smooth[i], force_N[i])
            words = (quality[i], pressure, temperature)
            states.append(CellState(finger, cell.row, cell.column, *words, *signal, coefficients[cell]))
    return tuple(states)


class CellFaults:
    """Tells `say` of cells that are broken, and of those that are no more."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._told: dict[Cell, CellQuality] = {}
        self._since: dict[Cell, tuple[CellQuality, int]] = {}

    def take(self, states: tuple[CellState, ...], sample_ns: int) -> None:
        """The cells of one frame."""
        changed: dict[CellQuality, list[str]] = {}
        for state in states:
            cell = Cell(state.row, state.column)
            fault = CellQuality(state.quality) & BROKEN
            seen, since_ns = self._since.get(cell, (fault, sample_ns))
            if fault != seen:
                since_ns = sample_ns
            self._since[cell] = fault, since_ns
            if fault != self._told.get(cell, CellQuality.GOOD) and sample_ns - since_ns >= nanoseconds(LASTING_S):
                self._told[cell] = fault
                changed.setdefault(fault, []).append(f"{cell.row}:{cell.column}")
        for fault, names in changed.items():
            self._say(f"tactile cell{'s' if names[1:] else ''} {', '.join(names)}: {_words(fault)}")


def _words(fault: CellQuality) -> str:
    if not fault:
        return "sound again; counted from the next zero on, or at once if there is one"
    return f"{', '.join(str(flag.name).lower() for flag in fault)}, so not counted"
