"""Coulomb friction with a memory of its direction, for feed-forward.

Friction keeps its sign when a joint comes to rest, and turns over within a small displacement after a reversal. A law
of the speed alone forgets the sign at rest: the integral then takes friction over, and works against the feed-forward
when motion begins again. Hence the direction z of Dahl's model (1968), over the commanded displacement x:

    dz/dx = (sgn v − z) / δ · sgn v
"""

from __future__ import annotations

from math import exp

DIRECTIONS = 7


class FrictionDirection:
    """Direction of friction per joint, −1 to 1, from the commanded motion."""

    def __init__(self, turnover_rad: float) -> None:
        self._inverse_turnover = 1.0 / turnover_rad
        self.values = [0.0] * DIRECTIONS

    def reset(self) -> None:
        """Nothing is known of the direction."""
        self.values = [0.0] * DIRECTIONS

    def step(self, velocity_rad_s: list[float], elapsed_s: float) -> list[float]:
        """The directions after moving at `velocity_rad_s` for `elapsed_s`; at rest they stay."""
        scale = -elapsed_s * self._inverse_turnover
        self.values = [
            z if v == 0.0 else (1.0 + (z - 1.0) * exp(scale * v) if v > 0.0 else -1.0 + (z + 1.0) * exp(-scale * v))
            for z, v in zip(self.values, velocity_rad_s, strict=True)
        ]
        return self.values
