"""From frames to force per finger: zero, temperature, slow drift, and cells that do not count.

Each cell's compensated pressure less its zero, less what its own temperature change explains, times its gain; summed
over the cells of a finger without clipping, because clipped noise would add up (TakkTile reference 6). The zero is the
mean of `tare_s` with the fingers free; outside contact it follows drift slowly. A cell that cannot be believed
(`quality.py`) is left out of the sum, and the number of cells that count is told with it. Finger order: right, left.
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
from drivers.takktile.compensation import Coefficients
from drivers.takktile.frames import Cell
from drivers.takktile.quality import BROKEN, CellQuality, Flags, QualityWatch

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class PadSettings:
    """Times and limits of zero and drift (TakkTile reference 5)."""

    tare_s: float = 0.5
    tare_frames: int = 50
    tare_deviation_counts: float = 4.0
    """Of any cell while taring; more is a finger that is not free and still."""
    drift_s: float = 30.0
    """In which the zero follows a change outside contact."""
    least_deviation_counts: float = 0.3
    """A cell that happened to be constant while taring is not free of noise: rounding alone gives 0.3 raw counts."""


@dataclass(frozen=True)
class PadSample:
    """Both fingers at one time; `total_N` is the paper's sum of contact forces. With no valid cell nothing is known."""

    sample_ns: int
    force_N: tuple[float, float]
    deviation_N: tuple[float, float]
    """Standard deviation of the noise of `force_N`."""
    valid_cells: tuple[int, int]
    saturated: tuple[bool, bool]
    """Whether a cell is pressed beyond its range, so that there is more force than `force_N`."""

    @property
    def total_N(self) -> float:
        """Sum of the contact forces of both fingers."""
        return self.force_N[0] + self.force_N[1]


@dataclass(frozen=True)
class CellReadings:
    """All cells of the bridge, in its order, in the newest frame; arrays (n,)."""

    raw: NDArray[np.int64]
    """(n, 2): raw counts of pressure and temperature."""
    quality: Flags
    counts: Vector
    """Signal, Pcomp counts above zero."""
    zero_counts: Vector
    """Pcomp counts; NaN without a zero."""
    zero_temperature: Vector
    temperature: Vector
    """Low-passed counts, those that the signal is corrected with."""
    force_N: Vector
    """The cell's part of its finger's sum, as if it counted."""


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
        self.cells = tuple(cells)
        """In the order of the bridge's frames, and of all arrays here."""
        count = len(self.cells)
        self._coefficients = np.array([[getattr(coefficients[c], n) for n in ("a0", "b1", "b2", "c12")] for c in cells])
        self._gain = np.zeros((2, count))
        self._thermal = np.zeros(count)
        for finger, pad in enumerate(pads):
            for cell, gain, thermal in zip(pad.cells, pad.gain_N_per_count, pad.thermal_counts, strict=True):
                if cell in cells:  # a dead one is in no frame
                    self._gain[finger, cells.index(cell)] = gain
                    self._thermal[cells.index(cell)] = thermal
        self._worn = self._gain > 0.0
        self._watch = QualityWatch(count)
        self._raw: NDArray[np.int64] = np.zeros((count, 2), dtype=np.int64)
        self._quality: Flags = np.full(count, CellQuality.NO_ZERO, dtype=np.int64)
        self._last_ns = 0
        self._zero: Vector = np.full(count, np.nan)
        self._zero_temperature: Vector = np.zeros(count)
        self._deviation: Vector = np.zeros(count)
        self._taring: list[tuple[int, Vector, Vector]] | None = None
        self._tare_flags: Flags = np.zeros(count, dtype=np.int64)
        self.counts: Vector = np.zeros(count)
        """Each cell's signal now, Pcomp counts above zero; of one without a zero absolute."""

    @property
    def tared(self) -> bool:
        """Whether a cell has a zero, without which nothing is known of force."""
        return bool(np.isfinite(self._zero).any())

    @property
    def taring(self) -> bool:
        """Whether a zero is being taken."""
        return self._taring is not None

    def tare(self) -> None:
        """Take a new zero over the next frames; the old one holds until it is complete. The fingers must be free."""
        self._taring = []
        self._tare_flags[:] = 0
        self._watch.restart()

    def stop_taring(self) -> None:
        """Give up the zero under way: the fingers are free no more. The old one goes on."""
        self._taring = None

    def adopt_zeros(self, known: Pads, same: Sequence[Cell]) -> None:
        """Go on with the zeros that the cells `same` had in `known`: the bridge was away, not the pads."""
        for cell in same:
            here, there = self.cells.index(cell), known.cells.index(cell)
            self._zero[here], self._deviation[here] = known._zero[there], known._deviation[there]
            self._zero_temperature[here] = known._zero_temperature[there]

    def take(self, frame: BridgeFrame, *, free: bool) -> PadSample:
        """One frame. `free`: the hand is open, so that zero and drift may be followed.

        Raises InputError if a tare came to its end and is not accepted; the old zero then holds.
        """
        self._raw = raw = np.array(frame.cells, dtype=np.int64)
        pressure, temperature = raw[:, 0], raw[:, 1]
        a0, b1, b2, c12 = self._coefficients.T
        counts: Vector = a0 + (b1 + c12 * temperature) * pressure + b2 * temperature
        elapsed_s = max(seconds(frame.sample_ns - self._last_ns), 0.0)
        self._last_ns = frame.sample_ns
        flags = self._watch.take(frame.sample_ns, raw, counts)
        try:
            if self._taring is not None:
                self._collect(frame.sample_ns, counts, flags)
        finally:
            zeroed = np.isfinite(self._zero)
            flags[~zeroed] |= CellQuality.NO_ZERO
            self._quality = flags
            zero = self._zero + self._thermal * (self._watch.temperature - self._zero_temperature)
            self.counts = counts - np.where(np.isnan(zero), 0.0, zero)
        if free and self._taring is None:
            weight = 1.0 - exp(-elapsed_s / self._settings.drift_s)
            self._zero = self._zero + weight * np.where(flags == CellQuality.GOOD, self.counts, 0.0)
        return self._sample(frame.sample_ns)

    def readings(self) -> CellReadings:
        """Every cell's part in the newest sample."""
        return CellReadings(
            self._raw,
            self._quality,
            self.counts,
            self._zero,
            self._zero_temperature,
            self._watch.temperature,
            self._gain.sum(axis=0) * self.counts,
        )

    def _sample(self, sample_ns: int) -> PadSample:
        valid = self._quality == CellQuality.GOOD
        gain = self._gain * valid
        force_N = gain @ self.counts
        deviation_N = np.sqrt(gain**2 @ self._deviation**2)
        cells = (self._worn & valid).sum(axis=1)
        beyond: NDArray[np.bool_] = self._worn @ ((self._quality & CellQuality.SATURATED) > 0)
        return PadSample(
            sample_ns,
            (float(force_N[0]), float(force_N[1])),
            (float(deviation_N[0]), float(deviation_N[1])),
            (int(cells[0]), int(cells[1])),
            (bool(beyond[0]), bool(beyond[1])),
        )

    def _collect(self, sample_ns: int, counts: Vector, flags: Flags) -> None:
        """One frame of the tare, and its end. Broken cells get no zero; one that moves, or is pressed, refuses it."""
        assert self._taring is not None
        self._taring.append((sample_ns, counts, self._watch.temperature))
        self._tare_flags |= flags
        settings = self._settings
        long_enough = sample_ns - self._taring[0][0] >= nanoseconds(settings.tare_s)
        if not long_enough or len(self._taring) < settings.tare_frames:
            return
        rows = np.array([row for _, row, _ in self._taring])
        temperature: Vector = np.array([row for _, _, row in self._taring]).mean(axis=0)
        self._taring = None
        deviation: Vector = rows.std(axis=0, ddof=1)
        sound = (self._tare_flags & BROKEN) == 0
        judged: NDArray[np.bool_] = self._worn.any(axis=0) & sound
        pressed: NDArray[np.bool_] = judged & ((self._tare_flags & CellQuality.SATURATED) > 0)
        moving: NDArray[np.bool_] = judged & (deviation > settings.tare_deviation_counts)
        if pressed.any() or moving.any():
            worst = int((pressed if pressed.any() else np.where(judged, deviation, 0.0)).argmax())
            cell, limit = self.cells[worst], settings.tare_deviation_counts
            moves = f"moves by {deviation[worst]:.1f} counts; expected at most {limit:g}"
            problem = "is at the end of its range" if pressed.any() else moves
            raise InputError(
                f"the pads cannot be zeroed: cell {cell.row}:{cell.column} {problem}.",
                help="Free the fingers and keep them still; leave a broken cell out of the map under [tactile].",
            )
        self._zero, self._zero_temperature = np.where(sound, rows.mean(axis=0), np.nan), temperature
        self._deviation = np.maximum(deviation, settings.least_deviation_counts)
