"""What the tactile process tells of single cells: their readings, for the state and the recording, and their faults.

A cell that dies, sticks, becomes noisy or implausible drops out of its finger's sum by itself; the operator hears of it
once, when that has lasted, and once more when it counts again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from controller.pad_messages import CellState
from drivers.clock import nanoseconds
from drivers.takktile.calibration import PadCalibration
from drivers.takktile.compensation import COEFFICIENT_BYTES
from drivers.takktile.frames import Cell
from drivers.takktile.pads import CellReadings
from drivers.takktile.quality import BROKEN, CellQuality

LASTING_S = 1.0
_BROKEN = int(BROKEN)


def cell_states(
    pads: tuple[PadCalibration, PadCalibration],
    cells: tuple[Cell, ...],
    readings: CellReadings,
    coefficients: dict[Cell, bytes],
) -> tuple[CellState, ...]:
    """Every mapped cell, right before left; one that is not among the bridge's `cells` is dead."""
    raw, quality = readings.raw.tolist(), readings.quality.tolist()
    unknown = (readings.quality & CellQuality.NO_ZERO) > 0
    known = np.where(unknown, 0.0, readings.counts).tolist()
    zero, zero_temperature = _known(readings.zero_counts), _known(readings.zero_temperature)
    smooth = _known(readings.temperature)
    force_N = np.where(unknown, 0.0, readings.force_N).tolist()
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


def _known(values: NDArray[np.float64]) -> list[float]:
    """With 0 for what is not known: JSON has no NaN."""
    known: list[float] = np.where(np.isnan(values), 0.0, values).tolist()
    return known


class CellFaults:
    """Tells `say` of cells that are broken, and of those that are no more."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._told: dict[Cell, int] = {}
        self._seen: list[int] = []
        self._since_ns = 0
        self._is_told = True

    def take(self, states: tuple[CellState, ...], sample_ns: int) -> None:
        """The cells of one frame: what is so of all of them, once it has lasted."""
        faults = [state.quality & _BROKEN for state in states]
        if faults != self._seen:
            self._seen, self._since_ns, self._is_told = faults, sample_ns, False
        if self._is_told or sample_ns - self._since_ns < nanoseconds(LASTING_S):
            return
        self._is_told = True
        changed: dict[int, list[str]] = {}
        for state, fault in zip(states, faults, strict=True):
            cell = Cell(state.row, state.column)
            if fault != self._told.get(cell, 0):
                self._told[cell] = fault
                changed.setdefault(fault, []).append(f"{cell.row}:{cell.column}")
        for fault, names in changed.items():
            self._say(f"tactile cell{'s' if names[1:] else ''} {', '.join(names)}: {_words(CellQuality(fault))}")


def _words(fault: CellQuality) -> str:
    if not fault:
        return "sound again; counted from the next zero on, or at once if there is one"
    return f"{', '.join(str(flag.name).lower() for flag in fault)}, so not counted"
