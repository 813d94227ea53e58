"""Motor current ↔ tendon tension: one straight line, and the gear's friction on either side of it.

At the shaft, torque = K·current; the gear takes K·I0 of it, against the motion. So, for a spool of radius r,

    winding     tension = K (I − I0) / r        unwinding   tension = K (I + I0) / r
    holding     anywhere between the two: K·I / r ± K·I0 / r, about ±22 N for an XM430-W350

Current is positive when it tightens. K and I0 are uncertain by 20 % and 0.05 A without an own calibration.
Pure functions. Source: dynamixel reference 3.1 to 3.3.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from drivers.errors import InputError


class SpoolMotion(enum.Enum):
    """What the spool does, which decides on which side the gear's friction is."""

    WINDING = 1
    HOLDING = 0
    UNWINDING = -1


@dataclass(frozen=True, slots=True)
class TensionEstimate:
    """Tendon tension, N, and the band it lies in; all ≥ 0, a tendon only pulls."""

    tension_N: float
    low_N: float
    high_N: float

    @property
    def uncertainty_N(self) -> float:
        """The larger distance from the estimate to the band's ends, N."""
        return max(self.tension_N - self.low_N, self.high_N - self.tension_N)


@dataclass(frozen=True, slots=True)
class LoadLaw:
    """The current–tension law of one motor with its spool. Defaults: XM430-W350, T42 spool."""

    torque_constant_Nm_per_A: float = 1.79
    friction_current_A: float = 0.13
    spool_radius_m: float = 0.0105
    slope_uncertainty: float = 0.2
    """Relative, of K."""
    friction_uncertainty_A: float = 0.05
    """Of I0 while the spool turns."""
    still_rate_m_s: float = 0.0006
    """Tendon slower than this counts as holding: just above two velocity counts of an XM430."""

    def __post_init__(self) -> None:
        positive = (self.torque_constant_Nm_per_A, self.spool_radius_m, self.still_rate_m_s)
        not_negative = (self.friction_current_A, self.slope_uncertainty, self.friction_uncertainty_A)
        if not all(math.isfinite(x) and x > 0 for x in positive) or not all(
            math.isfinite(x) and x >= 0 for x in not_negative
        ):
            raise InputError(
                f"{self} is not a load law; expected torque constant, spool radius and still rate above 0, "
                "friction current and uncertainties not below 0, all finite."
            )

    @property
    def friction_tension_N(self) -> float:
        """Half the width of the holding band, N."""
        return self.torque_constant_Nm_per_A * self.friction_current_A / self.spool_radius_m

    def motion(self, rate_m_s: float) -> SpoolMotion:
        """What the spool does at this tendon rate (positive = pulling in), m/s."""
        if rate_m_s >= self.still_rate_m_s:
            return SpoolMotion.WINDING
        return SpoolMotion.UNWINDING if rate_m_s <= -self.still_rate_m_s else SpoolMotion.HOLDING

    def tension(self, current_A: float, motion: SpoolMotion) -> TensionEstimate:
        """Tension for a current (positive = tightening), A."""
        newton_per_A = self.torque_constant_Nm_per_A / self.spool_radius_m
        tension_N = max(0.0, newton_per_A * (current_A - motion.value * self.friction_current_A))
        turning = motion is not SpoolMotion.HOLDING
        band_A = self.friction_uncertainty_A if turning else self.friction_current_A
        half_N = newton_per_A * band_A + self.slope_uncertainty * tension_N
        return TensionEstimate(tension_N, max(0.0, tension_N - half_N), tension_N + half_N)

    def current_cap_A(self, tension_N: float) -> float:
        """Current at which a winding spool stalls at `tension_N`: the inverse of `tension` while winding, A."""
        if not (math.isfinite(tension_N) and tension_N >= 0.0):
            raise InputError(f"load cap {tension_N} N is not a tension; expected a finite number not below 0.")
        return tension_N * self.spool_radius_m / self.torque_constant_Nm_per_A + self.friction_current_A
