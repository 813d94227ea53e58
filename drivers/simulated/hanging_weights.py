"""Weights on cords: the plant in which a spool winds against a constant tension, to calibrate a load law on.

Each spool (`spools.py`) pulls a cord of some stiffness, at the end of which a mass hangs freely: wound evenly, tension
is mass × g; a mass that is put on carelessly bounces. Stiffness and damping of the cord are assumptions (30 cm of
braided line; a bounce dies within a second or two).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import InputError
from drivers.simulated.spools import Spools

GRAVITY_M_S2 = 9.80665
CORD_N_PER_M = 2.0e4
DAMPING_RATIO = 0.03
LARGEST_MASS_KG = 50.0


class HangingWeights(Spools):
    """One cord per entry of `mass_kg`; 0 = nothing hangs there."""

    def __init__(
        self,
        mass_kg: Sequence[float],
        *,
        friction_Nm: float,
        inertia_kgm2: float,
        spool_radius_m: float = 0.0105,
        cord_N_per_m: float = CORD_N_PER_M,
    ) -> None:
        if not (math.isfinite(cord_N_per_m) and cord_N_per_m > 0.0):
            raise InputError(f"hanging weights with stiffness {cord_N_per_m}; expected a number above 0.")
        count = len(mass_kg)
        super().__init__(count, spool_radius_m=spool_radius_m, friction_Nm=friction_Nm, inertia_kgm2=inertia_kgm2)
        self._stiffness_N_per_m = cord_N_per_m
        self._mass_kg = [0.0] * count
        self._height_m = [0.0] * count
        self._rise_m_s = [0.0] * count
        for motor, mass in enumerate(mass_kg):
            self.hang(motor, mass)

    def hang(self, motor: int, mass_kg: float, drop_m: float = 0.0) -> None:
        """Hang another mass on this cord, at rest; let go `drop_m` above where it hangs still, it bounces."""
        if not 0.0 <= mass_kg <= LARGEST_MASS_KG:
            raise InputError(f"a mass of {mass_kg} kg cannot hang there; expected 0 to {LARGEST_MASS_KG:g} kg.")
        self._mass_kg[motor] = mass_kg
        stretch_m = mass_kg * GRAVITY_M_S2 / self._stiffness_N_per_m
        self._height_m[motor] = self._radius_m * self._angle_rad[motor] - stretch_m + drop_m
        self._rise_m_s[motor] = 0.0

    def tension_N(self, motor: int) -> float:
        """True tension of a cord; it only pulls."""
        mass_kg = self._mass_kg[motor]
        if mass_kg == 0.0:
            return 0.0
        stretch_m = self._radius_m * self._angle_rad[motor] - self._height_m[motor]
        stretching_m_s = self._radius_m * self._velocity_rad_s[motor] - self._rise_m_s[motor]
        damping_N_s_per_m = 2.0 * DAMPING_RATIO * math.sqrt(self._stiffness_N_per_m * mass_kg)
        pulled_N = self._stiffness_N_per_m * stretch_m + damping_N_s_per_m * stretching_m_s
        return max(0.0, pulled_N) if stretch_m > 0.0 else 0.0

    def step(self, period_s: float) -> None:
        """Move all on by `period_s`, at most about 1 ms: the masses rise and fall by what their cords pull with."""
        for motor, mass_kg in enumerate(self._mass_kg):
            tension_N = self._turn(motor, period_s)
            if mass_kg:
                self._rise_m_s[motor] += period_s * (tension_N / mass_kg - GRAVITY_M_S2)
                self._height_m[motor] += period_s * self._rise_m_s[motor]
