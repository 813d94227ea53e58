"""The time of a simulation that follows the machine's clock, but never runs on by more than 50 ms at once.

It stands still within a turn of the loop, so that all devices of a turn share one time. What a stalled process or a
slow physics loses beyond 50 ms is dropped and counted: better a pause than a burst that nobody could follow.
"""

from __future__ import annotations

from drivers.clock import Clock, MonotonicClock, Readable, nanoseconds

LONGEST_STEP_NS = nanoseconds(0.05)


class SteppedClock:
    """A `Clock` that its owner moves on once a turn."""

    def __init__(self, source: Clock | None = None, longest_step_ns: int = LONGEST_STEP_NS) -> None:
        self._source = source or MonotonicClock()
        self._longest_ns = longest_step_ns
        self._now_ns = self._source.now_ns()
        self._behind_ns = 0
        self.dropped_ns = 0
        """All that was dropped."""
        self.drops = 0

    def step(self) -> int:
        """Move on to the machine's time, less what was dropped; the time now, ns."""
        now_ns = self._source.now_ns() - self._behind_ns
        excess_ns = now_ns - self._now_ns - self._longest_ns
        if excess_ns > 0:
            self._behind_ns += excess_ns
            self.dropped_ns += excess_ns
            self.drops += 1
            now_ns -= excess_ns
        self._now_ns = now_ns
        return now_ns

    def resume(self) -> None:
        """Go on from the last step as if no time had passed since, and nothing been dropped."""
        self._behind_ns = self._source.now_ns() - self._now_ns

    def until_ns(self, deadline_ns: int) -> int:
        """Nanoseconds from the machine's present to `deadline_ns` of this time, at least 0."""
        return max(0, deadline_ns + self._behind_ns - self._source.now_ns())

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._source.sleep_until_ns(deadline_ns + self._behind_ns)
        self.step()

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        readable = self._source.wait_readable(source, deadline_ns + self._behind_ns)
        self.step()
        return readable
