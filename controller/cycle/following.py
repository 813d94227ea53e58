"""Whether the spools are where the grasp winds them to: excursions in m, spool-side, right finger first.

A position loop brings its spool to its goal, but for a lead that its load and speed explain. A spool that is
elsewhere has an encoder that is stuck, a loop without gain, or somebody else's goal, and the object is not where the
motion table has it. The lead is known to a part only (the load is the table's, not the motor's), so that part is
allowed for, and what the way of the sample takes.
"""

from __future__ import annotations

from collections import deque

from controller.messages import Pair

ALLOWED_M = 4e-4
ALLOWED_OF_LEAD = 0.5
PAST_NS = 60_000_000
"""A measured spool may be anywhere that it was wanted within this time."""
SAMPLES = 2
"""Elsewhere in a row: one is a glitch."""


class FollowingWatch:
    """Watches both spools of a grasp that winds, holds or releases."""

    def __init__(self) -> None:
        self._wanted: deque[tuple[int, Pair, Pair]] = deque()
        self._astray = 0
        self._spool_m: Pair = (0.0, 0.0)

    @property
    def short_m(self) -> float:
        """By how much less the spools are wound than they are wanted now, on average."""
        if not self._wanted:
            return 0.0
        (_, wanted, _), spool = self._wanted[-1], self._spool_m
        return 0.5 * (wanted[0] - spool[0] + wanted[1] - spool[1])

    @property
    def astray(self) -> bool:
        """Whether a spool is elsewhere."""
        return self._astray >= SAMPLES

    def forget(self) -> None:
        """The motors are not told where to be any more."""
        self._wanted.clear()
        self._astray = 0

    def want(self, spool_m: Pair, lead_m: Pair, now_ns: int) -> None:
        """Where the spools shall be from now on, and how far their goals are ahead of that."""
        wanted = self._wanted
        wanted.append((now_ns, spool_m, lead_m))
        while wanted[0][0] < now_ns - PAST_NS:
            wanted.popleft()

    def take(self, spool_m: Pair) -> None:
        """Where a sample has them."""
        self._spool_m = spool_m
        self._astray = self._astray + 1 if any(self._is_astray(finger, spool_m[finger]) for finger in (0, 1)) else 0

    def _is_astray(self, finger: int, spool_m: float) -> bool:
        if not self._wanted or self._wanted[-1][0] - self._wanted[0][0] < PAST_NS // 2:
            return False  # not told for long enough
        places = [spools[finger] for _, spools, _ in self._wanted]
        allowed_m = ALLOWED_M + ALLOWED_OF_LEAD * max(abs(leads[finger]) for _, _, leads in self._wanted)
        return not min(places) - allowed_m <= spool_m <= max(places) + allowed_m
