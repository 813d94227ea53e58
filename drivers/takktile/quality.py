"""Which cells of a frame can be believed, and what is wrong with the others.

A cell may die, stick, become noisy, reach its converter's end or tell a temperature that it cannot have. None of that
is seen by a checksum, for frames have none; it is seen by what cells do. A frame in which most cells are implausible is
none of their doing: then no cell of it counts. Raw counts unless said otherwise. Source: TakkTile reference 2 to 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from math import exp

import numpy as np
from numpy.typing import NDArray

from drivers.clock import nanoseconds, seconds
from drivers.takktile.compensation import LARGEST_PRESSURE, SMALLEST_PRESSURE, at_end, saturated

Flags = NDArray[np.int64]
_OPPOSED_OF_WHITE = 2.0 / 3.0
"""Mean of −sign(d d') min(|d|, |d'|)² of white noise of variance 1; d and d' are differences that follow each other."""


class CellQuality(IntFlag):
    """Why a cell does not count; none of them: it does."""

    GOOD = 0
    DEAD = 1
    """It is not there: in no scan, or both of its words stand at one end of their range."""
    SATURATED = 2
    """Pressed, or wrapped, beyond its converter's range."""
    STUCK = 4
    """Neither word has moved for a time in which noise alone moves them."""
    NOISY = 8
    IMPLAUSIBLE = 16
    """Its temperature is none that rubber can have reached."""
    NO_ZERO = 32
    """No zero was taken, or not of this cell."""


BROKEN = CellQuality.DEAD | CellQuality.STUCK | CellQuality.NOISY | CellQuality.IMPLAUSIBLE
"""What is a fault of the cell, and not of what presses it."""


@dataclass(frozen=True)
class QualitySettings:
    """Times and limits."""

    temperature_s: float = 17.0
    """Low pass of the temperature words, which are noisy (TakkTile reference 5)."""
    largest_temperature_step: float = 30.0
    """Off the low-passed temperature, 5.6 °C: rubber lags behind, and does not follow faster."""
    warmest_count: int = 70
    coldest_count: int = 850
    """105 °C and −40 °C, the barometer's range."""
    stuck_s: float = 4.0
    stuck_frames: int = 100
    """Both, of one reading: a bridge that does not wait for its cells repeats readings (TakkTile reference 2), and a
    quiet cell gives one twice, but not for as long."""
    noisy_counts: float = 4.0
    """Standard deviation, Pcomp counts."""
    noise_s: float = 0.5
    noise_frames: int = 50
    """Judged over both, at least."""
    implausible_share: float = 0.5
    """Of the cells of one frame; with more, the frame is none."""


class QualityWatch:
    """All cells of one bridge, frame by frame."""

    def __init__(self, count: int, settings: QualitySettings | None = None) -> None:
        self._settings = settings or QualitySettings()
        self.temperature: NDArray[np.float64] = np.full(count, np.nan)
        """Low-passed temperature counts (n,); NaN for a cell that has told none."""
        self._pressure: NDArray[np.int64] | None = None
        self._words: NDArray[np.int64] | None = None
        self._changed_ns = np.zeros(count, dtype=np.int64)
        self._same_frames = np.zeros(count, dtype=np.int64)
        self._counts: NDArray[np.float64] | None = None
        self._difference: NDArray[np.float64] | None = None
        self._variance: NDArray[np.float64] = np.zeros(count)
        self._noisy: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        self._lost: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        self._last_ns = 0

    def restart(self) -> None:
        """Take the next temperatures as they are: the fingers rest, and what came before may be of long ago."""
        self.temperature = np.full_like(self.temperature, np.nan)

    def take(self, sample_ns: int, raw: NDArray[np.int64], counts: NDArray[np.float64]) -> Flags:
        """Raw words (n, 2) and compensated counts (n,) of one frame; a `CellQuality` for each cell (n,)."""
        settings = self._settings
        pressure, temperature = raw[:, 0], raw[:, 1]
        elapsed_s = max(seconds(sample_ns - self._last_ns), 0.0)
        self._last_ns = sample_ns
        dead = at_end(pressure) & ((temperature <= SMALLEST_PRESSURE) | (temperature >= LARGEST_PRESSURE))
        beyond = saturated(pressure, self._pressure) & ~dead
        self._pressure = pressure
        implausible = self._temperatures(temperature, dead, elapsed_s)
        alive = ~dead
        if (implausible & alive).sum() > settings.implausible_share * alive.sum():
            implausible[:] = True
        stuck = self._stuck(sample_ns, raw)
        noisy = self._noise(counts, dead | beyond | implausible, elapsed_s)
        flags: Flags = np.zeros(len(raw), dtype=np.int64)
        for mask, flag in (
            (dead, CellQuality.DEAD),
            (beyond, CellQuality.SATURATED),
            (stuck & ~dead & ~beyond, CellQuality.STUCK),
            (noisy, CellQuality.NOISY),
            (implausible & ~dead, CellQuality.IMPLAUSIBLE),
        ):
            flags[mask] |= flag
        return flags

    def _temperatures(
        self, temperature: NDArray[np.int64], dead: NDArray[np.bool_], elapsed_s: float
    ) -> NDArray[np.bool_]:
        """Which are implausible; the others move the low pass."""
        settings = self._settings
        out = (temperature < settings.warmest_count) | (temperature > settings.coldest_count)
        new = np.isnan(self.temperature) & ~out & ~dead
        known = np.where(new, temperature, self.temperature)
        far = np.abs(temperature - known) > settings.largest_temperature_step
        weight = 1.0 - exp(-elapsed_s / settings.temperature_s)
        moved = known + weight * (temperature - known)
        implausible: NDArray[np.bool_] = out | far | np.isnan(known)
        self.temperature = np.where(implausible, known, moved)
        return implausible

    def _stuck(self, sample_ns: int, raw: NDArray[np.int64]) -> NDArray[np.bool_]:
        if self._words is None:
            self._changed_ns[:] = sample_ns
        else:
            changed = (raw != self._words).any(axis=1)
            self._changed_ns[changed] = sample_ns
            self._same_frames += 1
            self._same_frames[changed] = 0
        self._words = raw
        settings = self._settings
        stuck: NDArray[np.bool_] = sample_ns - self._changed_ns > nanoseconds(settings.stuck_s)
        return stuck & (self._same_frames >= settings.stuck_frames)

    def _noise(self, counts: NDArray[np.float64], lost: NDArray[np.bool_], elapsed_s: float) -> NDArray[np.bool_]:
        """Which are noisy, with hysteresis. Of noise, differences that follow each other tend to opposite signs; those
        of a ramp have one sign, and a step is a single difference, of which the smaller of two neighbours knows
        nothing: load is not taken for noise."""
        difference = np.zeros_like(counts) if self._counts is None else counts - self._counts
        before = np.zeros_like(counts) if self._difference is None else self._difference
        difference[lost | self._lost] = 0.0
        self._lost = lost
        weight = min(1.0 - exp(-elapsed_s / self._settings.noise_s), 1.0 / self._settings.noise_frames)
        opposed = -np.sign(difference * before) * np.minimum(np.abs(difference), np.abs(before)) ** 2
        limit = self._settings.noisy_counts**2
        opposed = np.clip(opposed / _OPPOSED_OF_WHITE, -16.0 * limit, 16.0 * limit)  # so that its end shows soon
        self._variance += weight * (opposed - self._variance)
        self._counts, self._difference = counts, difference
        self._noisy = (self._variance > limit) | (self._noisy & (self._variance > 0.25 * limit))
        return self._noisy
