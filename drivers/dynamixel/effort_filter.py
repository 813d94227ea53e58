"""A causal low-pass of first order for what a motor tells, by the samples' own times.

Between two samples the input is taken to go straight from one to the other, for which

    y₁ = e y₀ + x₁ − e x₀ − (x₁ − x₀) (1 − e) T / Δt,   e = exp(−Δt / T)

is exact, whatever the interval: a ramp is followed at a distance of T, be the bus fast or slow. Intervals much longer
than T pass through, and after a gap the filter starts anew: what went on in between is not known.

Effort and rate go through the same filter, so that what is worked out of both belongs to one time, T ago.
Source: dynamixel reference 3.3 (5…20 ms).
"""

from __future__ import annotations

import math

from drivers.errors import InputError

LARGEST_TIME_CONSTANT_S = 0.1
_GAP_TIME_CONSTANTS = 10.0


class EffortFilter:
    """Filters one motor's effort (A, or part of full output) and tendon rate (m/s).

    `time_constant_s` 0 lets all through. InputError for another that is not within 0…0.1 s.
    """

    __slots__ = ("_effort", "_filtered", "_last_ns", "_rate_m_s", "_time_constant_s")

    def __init__(self, time_constant_s: float) -> None:
        if not 0.0 <= time_constant_s <= LARGEST_TIME_CONSTANT_S:
            raise InputError(
                f"effort filter of {time_constant_s} s; expected 0 (off) to {LARGEST_TIME_CONSTANT_S:g} s.",
                help="5 to 20 ms are usual.",
            )
        self._time_constant_s = time_constant_s
        self._last_ns = 0
        self._effort = self._rate_m_s = 0.0
        self._filtered: tuple[float, float] | None = None

    def reset(self) -> None:
        """Forget all: the next sample is taken as it is."""
        self._filtered = None

    def step(self, sample_ns: int, effort: float, rate_m_s: float) -> tuple[float, float]:
        """Filtered effort and rate at this sample; one that is not newer than the last changes nothing."""
        time_constant_s = self._time_constant_s
        elapsed_s = (sample_ns - self._last_ns) * 1e-9
        if self._filtered is not None and elapsed_s <= 0.0:
            return self._filtered
        if self._filtered is None or elapsed_s > _GAP_TIME_CONSTANTS * time_constant_s:
            filtered = effort, rate_m_s
        else:
            kept = math.exp(-elapsed_s / time_constant_s)
            newest = 1.0 - (1.0 - kept) * time_constant_s / elapsed_s
            before = 1.0 - kept - newest
            filtered = (
                kept * self._filtered[0] + newest * effort + before * self._effort,
                kept * self._filtered[1] + newest * rate_m_s + before * self._rate_m_s,
            )
        self._last_ns, self._effort, self._rate_m_s = sample_ns, effort, rate_m_s
        self._filtered = filtered
        return filtered
