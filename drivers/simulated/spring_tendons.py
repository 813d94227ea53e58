"""Tendons that pull on springs: the smallest plant for simulated motors that run without the world.

Beyond its slack, tension = stiffness × (r·angle − slack), never negative; the spools themselves: `spools.py`. Gear
friction: dynamixel reference 3.3 (0.13 A × 1.79 N·m/A). The spool's inertia is an assumption: a rotor of 1e-7 kg·m²
behind the gear of 353.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import InputError
from drivers.simulated.spools import Spools

GEAR_FRICTION_NM = 0.13 * 1.79
SPOOL_INERTIA_KGM2 = 1e-7 * 353.5**2


class SpringTendons(Spools):
    """One spring tendon per entry of `stiffness_N_per_m`."""

    def __init__(
        self,
        stiffness_N_per_m: Sequence[float] = (3000.0, 3000.0),
        slack_m: Sequence[float] = (0.0, 0.0),
        *,
        spool_radius_m: float = 0.0105,
        friction_Nm: float = GEAR_FRICTION_NM,
        inertia_kgm2: float = SPOOL_INERTIA_KGM2,
    ) -> None:
        if len(stiffness_N_per_m) != len(slack_m) or not all(map(math.isfinite, (*stiffness_N_per_m, *slack_m))):
            raise InputError("spring tendons need as many slacks as stiffnesses, and only finite numbers.")
        if min(stiffness_N_per_m, default=0.0) < 0.0:
            raise InputError(f"spring tendons with stiffnesses {tuple(stiffness_N_per_m)} N/m; expected none below 0.")
        count = len(stiffness_N_per_m)
        super().__init__(count, spool_radius_m=spool_radius_m, friction_Nm=friction_Nm, inertia_kgm2=inertia_kgm2)
        self._stiffness_N_per_m = tuple(stiffness_N_per_m)
        self._slack_m = tuple(slack_m)

    def tension_N(self, motor: int) -> float:
        """True tension of a tendon."""
        stretch_m = self._radius_m * self._angle_rad[motor] - self._slack_m[motor]
        return max(0.0, self._stiffness_N_per_m[motor] * stretch_m)
