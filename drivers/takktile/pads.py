"""From frames to force per finger: zero, temperature, slow drift, and cells that do not count.

Each cell's compensated pressure less its zero, less what its own temperature change explains, times its gain; summed
over the cells of a finger without clipping, because clipped noise would add up (TakkTile reference 6). The zero is the
mean of `tare_s` with the fingers free; outside contact it follows drift slowly. A dead or saturated cell is left out of
the sum, and the number of cells that count is told with it. Finger order: right, left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from drivers.clock import nanoseconds, seconds
from drivers.errors import InputError
from drivers.takktile.bridge import BridgeFrame
from drivers.takktile.calibration import PadCalibration
from drivers.takktile.compensation import Coefficients, saturated
from drivers.takktile.frames import Cell


@dataclass(frozen=True)
class PadSettings:
    """Times and limits of zero and drift (TakkTile reference 5)."""

    tare_s: float = 0.5
    tare_frames: int = 50
    tare_deviation_counts: float = 4.0
    """Of any cell while taring; more is a finger that is not free and still."""
    temperature_s: float = 17.0
    """Low pass of the temperature words, which are noisy."""
    drift_s: float = 30.0
    """In which the zero follows a change outside contact."""
    least_deviation_counts: float = 0.3
    """A cell that happened to be constant while taring is not free of noise: rounding alone gives 0.3 raw counts."""


@dataclass(frozen=True)
class PadSample:
    """Both fingers at one time; `total_N` is the paper's sum of contact forces."""

    sample_ns: int
    force_N: tuple[float, float]
    deviation_N: tuple[float, float]
    """Standard deviation of the noise of `force_N`."""
    valid_cells: tuple[int, int]

    @property
    def total_N(self) -> float:
        """Sum of the contact forces of both fingers."""
        return self.force_N[0] + self.force_N[1]


class Pads:
    """Both fingers' pads behind one bridge whose alive cells are `cells`, with their coefficients."""

    def __init__(
        self,
        pads: tuple[PadCalibration, PadCalibration],
        cells: Sequence[Cell],
        coefficients: dict[Cell, Coefficients],
        settings: PadSettings | None = None,
    ) -> None:
        self._settings = settings or PadSettings()
        self._cells = tuple(cells)
        self._coefficients = np.array([[getattr(coefficients[c], n) for n in ("a0", "b1", "b2", "c12")] for c in cells])
        self._gain = np.zeros((2, len(cells)))
        self._thermal = np.zeros(len(cells))
        for finger, pad in enumerate(pads):
            for cell, gain, thermal in zip(pad.cells, pad.gain_N_per_count, pad.thermal_counts, strict=True):
                if cell in cells:  # a dead one is in no frame
                    self._gain[finger, cells.index(cell)] = gain
                    self._thermal[cells.index(cell)] = thermal
        self._worn = self._gain > 0.0
        self._raw: NDArray[np.int64] | None = None
        self._temperature: NDArray[np.float64] | None = None
        self._last_ns = 0
        self._zero: NDArray[np.float64] | None = None
        self._zero_temperature: NDArray[np.float64] = np.zeros(len(cells))
        self._deviation: NDArray[np.float64] = np.zeros(len(cells))
        self._taring: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] | None = None
        self._tare_saturated = False
        self.counts: NDArray[np.float64] = np.zeros(len(cells))
        """Each cell's signal now, Pcomp counts above zero, in the bridge's order; before the tare absolute."""

    @property
    def tared(self) -> bool:
        """Whether there is a zero, without which nothing is known of force."""
        return self._zero is not None

    @property
    def taring(self) -> bool:
        """Whether a zero is being taken."""
        return self._taring is not None

    def tare(self) -> None:
        """Take a new zero over the next frames; the old one holds until it is complete. The fingers must be free."""
        self._taring, self._tare_saturated = [], False

    def stop_taring(self) -> None:
        """Give up the zero under way: the fingers are free no more. The old one goes on."""
        self._taring = None

    def take(self, frame: BridgeFrame, *, free: bool) -> PadSample | None:
        """One frame; None while there is no zero. `free`: the hand is open, so that zero and drift may be followed.

        Raises InputError if a tare came to its end and is not accepted; the old zero then holds.
        """
        raw = np.array(frame.cells, dtype=np.int64)
        pressure, temperature = raw[:, 0], raw[:, 1].astype(np.float64)
        lost = saturated(pressure, self._raw)
        self._raw = pressure
        elapsed_s = seconds(frame.sample_ns - self._last_ns)
        self._last_ns = frame.sample_ns
        if self._temperature is None:
            self._temperature = temperature
        else:
            weight = 1.0 - exp(-max(elapsed_s, 0.0) / self._settings.temperature_s)
            self._temperature = self._temperature + weight * (temperature - self._temperature)
        a0, b1, b2, c12 = self._coefficients.T
        counts = a0 + (b1 + c12 * temperature) * pressure + b2 * temperature
        if self._taring is not None:
            self._collect(frame.sample_ns, counts, lost)
        if self._zero is None:
            self.counts = counts
            return None
        self.counts = counts - self._zero - self._thermal * (self._temperature - self._zero_temperature)
        if free and self._taring is None:
            weight = 1.0 - exp(-max(elapsed_s, 0.0) / self._settings.drift_s)
            self._zero = self._zero + weight * np.where(lost, 0.0, self.counts)
        return self._sample(frame.sample_ns, ~lost)

    def _sample(self, sample_ns: int, valid: NDArray[np.bool_]) -> PadSample:
        gain = self._gain * valid
        force_N = gain @ self.counts
        deviation_N = np.sqrt(gain**2 @ self._deviation**2)
        cells = (self._worn & valid).sum(axis=1)
        return PadSample(
            sample_ns,
            (float(force_N[0]), float(force_N[1])),
            (float(deviation_N[0]), float(deviation_N[1])),
            (int(cells[0]), int(cells[1])),
        )

    def _collect(self, sample_ns: int, counts: NDArray[np.float64], lost: NDArray[np.bool_]) -> None:
        """One frame of the tare, and its end."""
        assert self._taring is not None
        assert self._temperature is not None
        self._taring.append((sample_ns, counts, self._temperature))
        self._tare_saturated |= bool((lost & self._worn.any(axis=0)).any())
        settings = self._settings
        long_enough = sample_ns - self._taring[0][0] >= nanoseconds(settings.tare_s)
        if not long_enough or len(self._taring) < settings.tare_frames:
            return
        rows = np.array([row for _, row, _ in self._taring])
        temperature = np.array([row for _, _, row in self._taring]).mean(axis=0)
        self._taring = None
        deviation = rows.std(axis=0, ddof=1)
        worst = float(deviation[self._worn.any(axis=0)].max())
        if self._tare_saturated or worst > settings.tare_deviation_counts:
            cell = self._cells[int(np.where(self._worn.any(axis=0), deviation, 0.0).argmax())]
            moves = f"cell {cell.row}:{cell.column} moves by {worst:.1f} counts"
            problem = "a cell is at its end" if self._tare_saturated else moves
            raise InputError(
                f"the pads cannot be zeroed: {problem}; expected at most {settings.tare_deviation_counts:g} counts.",
                help="Free the fingers and keep them still; leave a broken cell out of the map under [tactile].",
            )
        self._zero, self._zero_temperature = rows.mean(axis=0), temperature
        self._deviation = np.maximum(deviation, settings.least_deviation_counts)
