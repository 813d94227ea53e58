"""Spools that tendon motors turn: an inertia each, against the gear's Coulomb friction and a tendon's tension.

What pulls at the other end is a subclass's. Positive angle = pulled in. Semi-implicit Euler; friction stops a spool, it
never drives it. Gear friction: dynamixel reference 3.3.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from drivers.errors import InputError


class Spools(ABC):
    """`count` spools at rest; implements `TendonPlant`. InputError for what no spool has."""

    def __init__(self, count: int, *, spool_radius_m: float, friction_Nm: float, inertia_kgm2: float) -> None:
        for value, name in ((inertia_kgm2, "inertia"), (spool_radius_m, "radius")):
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"spools with {name} {value}; expected a number above 0.")
        if not (math.isfinite(friction_Nm) and friction_Nm >= 0.0):
            raise InputError(f"spools with friction {friction_Nm} N·m; expected a number not below 0.")
        self._radius_m = spool_radius_m
        self._friction_Nm = friction_Nm
        self._inertia_kgm2 = inertia_kgm2
        self._angle_rad = [0.0] * count
        self._velocity_rad_s = [0.0] * count
        self._torque_Nm = [0.0] * count

    def shaft_angle_rad(self, motor: int) -> float:
        return self._angle_rad[motor]

    def shaft_velocity_rad_s(self, motor: int) -> float:
        return self._velocity_rad_s[motor]

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        self._torque_Nm[motor] = torque

    @abstractmethod
    def tension_N(self, motor: int) -> float:
        """True tension of a tendon, never negative."""

    def step(self, period_s: float) -> None:
        """Move all spools on by `period_s`, at most about 1 ms."""
        for motor in range(len(self._torque_Nm)):
            self._turn(motor, period_s)

    def _turn(self, motor: int, period_s: float) -> float:
        """Move one spool on; the tension that it was turned against, N."""
        tension_N = self.tension_N(motor)
        net_Nm = self._torque_Nm[motor] - self._radius_m * tension_N
        free_rad_s = self._velocity_rad_s[motor] + period_s * net_Nm / self._inertia_kgm2
        friction_rad_s = period_s * self._friction_Nm / self._inertia_kgm2
        braked_rad_s = math.copysign(max(0.0, abs(free_rad_s) - friction_rad_s), free_rad_s)
        self._velocity_rad_s[motor] = braked_rad_s
        self._angle_rad[motor] += period_s * braked_rad_s
        return tension_N
