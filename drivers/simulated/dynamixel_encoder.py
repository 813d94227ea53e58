"""A simulated motor's encoder: the shaft's angle in whole ticks (floor), and what can be wrong with it.

The motor's own loop is closed over it, so a wrong encoder turns the shaft.
"""

from __future__ import annotations

import math
import random


class Encoder:
    """One encoder; `ticks` is what it tells since the last `measure`, all turns counted."""

    def __init__(self, tick_rad: float, seed: str) -> None:
        self.ticks = 0
        self.jump_ticks = 0
        """It is off by this much from now on."""
        self.stuck = False
        """It goes on telling what it told."""
        self.noise_ticks = 0.0
        """Standard deviation of what is added at each measurement."""
        self._tick_rad = tick_rad
        self._random = random.Random(f"encoder {seed}")

    def measure(self, angle_rad: float) -> None:
        """The shaft stands here now."""
        if self.stuck:
            return
        self.ticks = math.floor(angle_rad / self._tick_rad) + self.jump_ticks
        if self.noise_ticks:
            self.ticks += round(self._random.gauss(0.0, self.noise_ticks))
