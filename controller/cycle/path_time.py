"""Time along a path, which the governor and a stop can slow down without a corner.

A path is planned once, jerk-limited, as a function of its own time τ. The cycle moves τ by speed · period; the speed
follows the wanted throttle with a limited slope. So position, velocity and acceleration stay continuous, the path is
never left, and a stop *along the path* is nothing but a throttle of 0.
"""

from __future__ import annotations

from typing import NamedTuple


class PathTime(NamedTuple):
    """τ in s, its speed dτ/dt and the speed's rate 1/s."""

    time_s: float
    speed: float
    speed_rate: float


class ThrottledTime:
    """Moves τ under a throttle in [0, 1]."""

    def __init__(self, period_s: float, throttle_time_s: float) -> None:
        self._period_s = period_s
        self._slope = period_s / throttle_time_s
        self._time_s = 0.0
        self._speed = 1.0

    @property
    def standing(self) -> bool:
        """Whether τ has come to rest."""
        return self._speed == 0.0

    @property
    def speed(self) -> float:
        """dτ/dt now."""
        return self._speed

    def start(self) -> None:
        """Begin a new path: τ = 0 at full speed (paths begin and end at rest, so this makes no jump)."""
        self._time_s = 0.0
        self._speed = 1.0

    def step(self, throttle: float) -> PathTime:
        """One period further towards `throttle`."""
        change = min(max(throttle - self._speed, -self._slope), self._slope)
        before = self._speed
        self._speed = min(max(before + change, 0.0), 1.0)
        self._time_s += 0.5 * (before + self._speed) * self._period_s
        return PathTime(self._time_s, self._speed, (self._speed - before) / self._period_s)
