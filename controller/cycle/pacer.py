"""Pace by absolute deadlines: a missed period is skipped and counted, never caught up in a burst."""

from __future__ import annotations

from drivers.clock import Clock


class Pacer:
    """Deadlines at start + n · period."""

    def __init__(self, clock: Clock, period_ns: int) -> None:
        if period_ns <= 0:
            raise ValueError(f"a period of {period_ns} ns; expected more than 0.")
        self._clock = clock
        self.period_ns = period_ns
        self.deadline_ns = clock.now_ns() + period_ns
        self.missed = 0
        self.late_ns = 0

    def restart(self) -> None:
        """Begin anew one period from now, after something that was allowed to take long."""
        self.deadline_ns = self._clock.now_ns() + self.period_ns

    def wait(self) -> None:
        """Return at the deadline."""
        self._clock.sleep_until_ns(self.deadline_ns)

    def begin(self) -> int:
        """Call on waking: sets the next deadline, counts what was missed, returns the time now in ns."""
        now_ns = self._clock.now_ns()
        self.late_ns = now_ns - self.deadline_ns
        skipped = max(0, self.late_ns) // self.period_ns
        self.missed += skipped
        self.deadline_ns += (skipped + 1) * self.period_ns
        return now_ns
