"""How strongly the motors' load rises while the fingers close freely, as a part of what the table expects.

On their way to the object the fingers bend against their own springs, of which the table knows the stiffness: a spring
scale that is always there. Slope measured / slope expected is 1 + κ: it holds the motor's torque constant and the
springs' stiffness alike, and the table's load is wrong by the same part. Constant gear friction does not enter a slope,
nor does the back-EMF at a constant rate. Mean of both fingers.

Source: hand-mechanics reference 4, dynamixel reference 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

LEAST_LOAD_N = 6.0
"""Below, the load law's friction may take all of the measured load."""
LEAST_SPAN_N = 5.0
"""Of the load between the first and the last sample; on less the slope is not believed."""
SYSTEMATIC = 0.02
"""Standard deviation that no number of samples takes away [assumed: bearings, tendon guides]."""


class Scale(NamedTuple):
    """1 + κ and its standard deviation."""

    value: float
    deviation: float


@dataclass
class _Line:
    """Sums of a regression of load on excursion."""

    count: int = 0
    mean_x: float = 0.0
    mean_y: float = 0.0
    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    lowest: float = math.inf
    highest: float = -math.inf

    def take(self, x: float, y: float) -> None:
        self.count += 1
        dx, dy = x - self.mean_x, y - self.mean_y
        self.mean_x += dx / self.count
        self.mean_y += dy / self.count
        self.xx += dx * (x - self.mean_x)
        self.xy += dx * (y - self.mean_y)
        self.yy += dy * (y - self.mean_y)
        self.lowest, self.highest = min(self.lowest, x), max(self.highest, x)


class FreeClosingScale:
    """Takes the samples of free closing at a constant rate, then tells the scale."""

    def __init__(self, slope_N_per_m: tuple[float, float]) -> None:
        """`slope_N_per_m`: load per finger-side excursion that the table expects, right and left."""
        self._slopes = slope_N_per_m
        self._lines = (_Line(), _Line())

    def take(self, finger: int, excursion_m: float, load_N: float) -> None:
        """One sample of a finger (0 right, 1 left) that winds freely, finger-side."""
        if load_N > 0.0 and excursion_m * self._slopes[finger] > LEAST_LOAD_N:
            self._lines[finger].take(excursion_m, load_N)

    def scale(self, believed: float) -> Scale:
        """1 + κ, where the motors' law itself is believed to be good within the part `believed`."""
        sum_weight, sum_value = 0.0, 0.0
        for line, slope in zip(self._lines, self._slopes, strict=True):
            if line.count < 10 or (line.highest - line.lowest) * slope < LEAST_SPAN_N:
                continue
            measured = line.xy / line.xx
            residual_N2 = max(line.yy - measured * line.xy, 0.0) / (line.count - 2)
            weight = 1.0 / max(residual_N2 / line.xx / slope**2, 1e-12)
            sum_weight += weight
            sum_value += weight * measured / slope
        if sum_weight == 0.0:
            return Scale(1.0, believed)
        seen, variance = sum_value / sum_weight, 1.0 / sum_weight + SYSTEMATIC**2
        if believed == 0.0:
            return Scale(1.0, 0.0)
        part = believed**2 / (believed**2 + variance)
        return Scale(1.0 + part * (seen - 1.0), math.sqrt(part * variance))
