"""How strongly the motors' load rises while the fingers close freely, as a part of what the table expects.

On their way to the object the fingers bend against their own springs, of which the table knows the stiffness: a spring
scale that is always there. Slope measured / slope expected is 1 + κ: it holds the motor's torque constant and the
springs' stiffness alike, and the table's load is wrong by the same part. Constant gear friction does not enter a slope,
nor does the back-EMF at a constant rate. Mean of both fingers.

Source: hand-mechanics reference 4, dynamixel reference 3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEAST_LOAD_N = 6.0
"""Below, the load law's friction may take all of the measured load."""
LEAST_SPAN_N = 5.0
"""Of the load between the first and the last sample; on less the slope is not believed."""
BLOCKS = 12
"""Stretches of the way whose means are fitted: an effort that steps from tick to tick beats slowly against the samples,
so that one after the other errs the same way; whole stretches less so."""
LEAST_A_BLOCK = 4
MOST_ALIKE = 0.8
"""Correlation of one block's error with the next that is reckoned with at most: a beat that is slower than a block."""
SYSTEMATIC = 0.02
"""Standard deviation that no number of samples takes away [assumed: bearings, tendon guides]."""


class Scale(NamedTuple):
    """1 + κ and its standard deviation."""

    value: float
    deviation: float


class FreeClosingScale:
    """Takes the samples of free closing at a constant rate, then tells the scale."""

    def __init__(self, slope_N_per_m: tuple[float, float]) -> None:
        """`slope_N_per_m`: load per finger-side excursion that the table expects, right and left."""
        self._slopes = slope_N_per_m
        self._samples: tuple[list[tuple[float, float]], ...] = ([], [])

    def take(self, finger: int, excursion_m: float, load_N: float) -> None:
        """One sample of a finger (0 right, 1 left) that winds freely, finger-side."""
        if load_N > 0.0 and excursion_m * self._slopes[finger] > LEAST_LOAD_N:
            self._samples[finger].append((excursion_m, load_N))

    def scale(self, believed: float) -> Scale:
        """1 + κ, where law and springs themselves are believed to be good within the part `believed`."""
        fits = [
            (value / slope, variance / slope**2)
            for samples, slope in zip(self._samples, self._slopes, strict=True)
            if len(samples) >= BLOCKS * LEAST_A_BLOCK and (samples[-1][0] - samples[0][0]) * slope >= LEAST_SPAN_N
            for value, variance in [_fitted_slope(np.array(samples))]
        ]
        if not fits or believed == 0.0:
            return Scale(1.0, believed)
        weights = [1.0 / variance for _, variance in fits]
        seen = sum(weight * value for weight, (value, _) in zip(weights, fits, strict=True)) / sum(weights)
        # both motors wind at one rate, so their steps err alike: two fingers are no better known than one
        variance = len(fits) / sum(weights) + SYSTEMATIC**2
        part = believed**2 / (believed**2 + variance)
        return Scale(1.0 + part * (seen - 1.0), math.sqrt(part * variance))


def _fitted_slope(samples: NDArray[np.float64]) -> tuple[float, float]:
    """Slope of (n, 2) samples with its variance, from the means of blocks."""
    means = np.array([block.mean(axis=0) for block in np.array_split(samples, BLOCKS)])
    x, y = (means - means.mean(axis=0)).T
    squares = float(x @ x)
    slope = float(x @ y) / squares
    left = y - slope * x
    noise_N2 = max(float(left @ left), 1e-12)
    alike = min(max(float(left[1:] @ left[:-1]) / noise_N2, 0.0), MOST_ALIKE)
    return slope, noise_N2 * (1.0 + alike) / (1.0 - alike) / (BLOCKS - 2) / squares
