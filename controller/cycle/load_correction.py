"""What the motors' load says about the excursion index: a Kalman filter of four constants of one grasp.

    index   x = e + a + s·ΔT(x)             e  excursion index: spool less tendon stretch, less contact
    load    ΔT measured = (1 + κ) ΔT(x) + o + noise             ΔT(x)  the table's load rise since contact

    a  m      contact was somewhere else than it was found
    s  m/N    the tendon stretches more or less than its hand file says
    κ         the motor's torque, or the hand's springs, are stronger or weaker than believed
    o  N      error of the load that was taken for contact's

All four stay what they are while a grasp lasts, so their errors are never averaged away, and the estimate may stand
still when the motors do. How far each may lie off beforehand is what weighs load against excursion. Pure; no clock.
Source: design 4 "Index at run time"; dynamixel reference 3.3; the filter is the textbook's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import InputError

_OUTLIER = 4.0
"""Standard deviations beyond which a sample counts no more than one there."""


@dataclass(frozen=True)
class LoadTrust:
    """Standard deviations of the four constants before anything is measured, and of one sample's noise."""

    contact_m: float
    stretch_m_per_N: float
    scale: float
    onset_N: float
    noise_N: float
    scale_per_stretch_N_per_m: float = 0.0
    """By how much κ is another where s is: free closing, which shows the scale, stretches the tendons too."""

    def __post_init__(self) -> None:
        values = (self.contact_m, self.stretch_m_per_N, self.scale, self.onset_N, abs(self.scale_per_stretch_N_per_m))
        if not all(math.isfinite(value) and value >= 0.0 for value in values) or not 0.0 < self.noise_N < math.inf:
            raise InputError(f"{self} is not a trust; expected finite deviations not below 0, of the noise above 0.")


class LoadCorrection:
    """The four constants of one grasp, as they become known."""

    def __init__(self, trust: LoadTrust, scale: float = 1.0) -> None:
        """`scale`: 1 + κ as free closing showed it."""
        self._noise_N2 = trust.noise_N**2
        self._values = np.array([0.0, 0.0, scale - 1.0, 0.0])
        spread = np.diag([trust.contact_m, trust.stretch_m_per_N, trust.scale, trust.onset_N])
        spread[2, 1] = trust.scale_per_stretch_N_per_m * trust.stretch_m_per_N
        self._covariance: NDArray[np.float64] = spread @ spread.T

    @property
    def contact_m(self) -> float:
        """a."""
        return float(self._values[0])

    @property
    def stretch_m_per_N(self) -> float:
        """s."""
        return float(self._values[1])

    def deviation_m(self, rise_N: float) -> float:
        """Standard deviation of the index at a load rise."""
        row = np.array([1.0, rise_N])
        return math.sqrt(float(row @ self._covariance[:2, :2] @ row))

    def take(self, measured_rise_N: float, table_rise_N: float, slope_N_per_m: float) -> None:
        """One sample of a winding motor: the load's rise since contact, and the table's with its slope where the index,
        as it is corrected now, was then."""
        scale = 1.0 + self._values[2]
        row = np.array([scale * slope_N_per_m, scale * slope_N_per_m * table_rise_N, table_rise_N, 1.0])
        gain = self._covariance @ row
        variance_N2 = float(row @ gain) + self._noise_N2
        surprise_N = measured_rise_N - scale * table_rise_N - float(self._values[3])
        limit_N = _OUTLIER * math.sqrt(variance_N2)
        self._values = self._values + gain * (min(max(surprise_N, -limit_N), limit_N) / variance_N2)
        self._covariance = self._covariance - np.outer(gain, gain) / variance_N2


class SmoothConstant:
    """Follows a value that changes in steps, with continuous rate: critically damped, at `bandwidth_rad_s`."""

    def __init__(self, period_s: float, bandwidth_rad_s: float) -> None:
        self._period_s = period_s
        self._bandwidth_rad_s = bandwidth_rad_s
        self.value = 0.0
        self.rate = 0.0
        self.acceleration = 0.0

    def step(self, target: float) -> None:
        """One period towards the target."""
        w = self._bandwidth_rad_s
        self.acceleration = w * w * (target - self.value) - 2.0 * w * self.rate
        self.rate += self._period_s * self.acceleration
        self.value += self._period_s * self.rate
