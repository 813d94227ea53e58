"""Tendons that pull on springs: the smallest plant for simulated motors that run without the world.

Each spool turns an inertia against the gear's Coulomb friction and, beyond its slack, a spring: tension = stiffness ×
(r·angle − slack), never negative. Positive angle = pulled in. Semi-implicit Euler; friction stops a spool, it never
drives it.

Gear friction: dynamixel reference 3.3 (0.13 A × 1.79 N·m/A). The spool's inertia is an assumption: a rotor of
1e-7 kg·m² behind the gear of 353.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import InputError

GEAR_FRICTION_NM = 0.13 * 1.79
SPOOL_INERTIA_KGM2 = 1e-7 * 353.5**2


class SpringTendons:
    """One spring tendon per entry of `stiffness_N_per_m`; implements `TendonPlant`."""

    def __init__(
        self,
        stiffness_N_per_m: Sequence[float] = (3000.0, 3000.0),
        slack_m: Sequence[float] = (0.0, 0.0),
        *,
        spool_radius_m: float = 0.0105,
        friction_Nm: float = GEAR_FRICTION_NM,
        inertia_kgm2: float = SPOOL_INERTIA_KGM2,
    ) -> None:
        numbers = (*stiffness_N_per_m, *slack_m, spool_radius_m, friction_Nm, inertia_kgm2)
        if len(stiffness_N_per_m) != len(slack_m) or not all(map(math.isfinite, numbers)):
            raise InputError("spring tendons need as many slacks as stiffnesses, and only finite numbers.")
        if min(*stiffness_N_per_m, friction_Nm) < 0.0 or min(spool_radius_m, inertia_kgm2) <= 0.0:
            raise InputError("spring tendons need a radius and an inertia above 0, no stiffness and friction below.")
        self._stiffness_N_per_m = tuple(stiffness_N_per_m)
        self._slack_m = tuple(slack_m)
        self._radius_m = spool_radius_m
        self._friction_Nm = friction_Nm
        self._inertia_kgm2 = inertia_kgm2
        count = len(self._stiffness_N_per_m)
        self._angle_rad = [0.0] * count
        self._velocity_rad_s = [0.0] * count
        self._torque_Nm = [0.0] * count

    def shaft_angle_rad(self, motor: int) -> float:
        return self._angle_rad[motor]

    def shaft_velocity_rad_s(self, motor: int) -> float:
        return self._velocity_rad_s[motor]

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        self._torque_Nm[motor] = torque

    def tension_N(self, motor: int) -> float:
        """True tension of a tendon."""
        stretch_m = self._radius_m * self._angle_rad[motor] - self._slack_m[motor]
        return max(0.0, self._stiffness_N_per_m[motor] * stretch_m)

    def step(self, period_s: float) -> None:
        """Move all spools on by `period_s`, at most about 1 ms."""
        friction_rad_s = period_s * self._friction_Nm / self._inertia_kgm2
        for motor, torque_Nm in enumerate(self._torque_Nm):
            net_Nm = torque_Nm - self._radius_m * self.tension_N(motor)
            free_rad_s = self._velocity_rad_s[motor] + period_s * net_Nm / self._inertia_kgm2
            braked_rad_s = math.copysign(max(0.0, abs(free_rad_s) - friction_rad_s), free_rad_s)
            self._velocity_rad_s[motor] = braked_rad_s
            self._angle_rad[motor] += period_s * braked_rad_s
