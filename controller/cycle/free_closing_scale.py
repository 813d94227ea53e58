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
so that one after the other errs the same way; whole stretches do not."""
LEAST_A_BLOCK = 4
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
        sum_weight, sum_value = 0.0, 0.0
        for samples, slope in zip(self._samples, self._slopes, strict=True):
            if len(samples) >= BLOCKS * LEAST_A_BLOCK and (samples[-1][0] - samples[0][0]) * slope >= LEAST_SPAN_N:
                value, variance = _fitted_slope(np.array(samples))
                sum_weight += slope**2 / variance
                sum_value += slope * value / variance
        if sum_weight == 0.0 or believed == 0.0:
            return Scale(1.0, believed)
        variance = 1.0 / sum_weight + SYSTEMATIC**2
        part = believed**2 / (believed**2 + variance)
        return Scale(1.0 + part * (sum_value / sum_weight - 1.0), math.sqrt(part * variance))


def _fitted_slope(samples: NDArray[np.float64]) -> tuple[float, float]:
    """Slope of (n, 2) samples with its variance, from the means of blocks."""
    means = np.array([block.mean(axis=0) for block in np.array_split(samples, BLOCKS)])
    x, y = (means - means.mean(axis=0)).T
    squares = float(x @ x)
    slope = float(x @ y) / squares
    left = y - slope * x
    return slope, max(float(left @ left) / (BLOCKS - 2) / squares, 1e-9)
