"""The one notion of time: monotonic or virtual, in integer nanoseconds, and everything that waits on it.

A part (cycle, hand, front, a device) holds a `Clock` and waits only through it. On the `MonotonicClock` a wait
is a `select` or a sleep. On a `VirtualClock` a wait moves this part's own time forward to the moment the awaited
data would have arrived, and returns at once; the discrete-event loop of `controller/simulation/virtual_time.py`
then continues that part no earlier than that moment. Nothing else may ask for the time.
"""

from __future__ import annotations

import select
import time
from typing import Protocol

NANOSECONDS = 1_000_000_000


def seconds(time_ns: int) -> float:
    """Nanoseconds as seconds."""
    return time_ns * 1e-9


def nanoseconds(duration_s: float) -> int:
    """Seconds as whole nanoseconds."""
    return round(duration_s * 1e9)


class Readable(Protocol):
    """What a clock can wait for. Real transports have a file descriptor, virtual ones an arrival time."""

    def fileno(self) -> int:
        """File descriptor to select on; −1 for a virtual transport."""
        ...

    def next_arrival_ns(self) -> int | None:
        """Virtual time at which the next bytes arrive (may be past); None if none are on their way."""
        ...


class Clock(Protocol):
    """Time and waiting for one part."""

    def now_ns(self) -> int:
        """Time now, ns; never goes back; its zero means nothing."""
        ...

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, at once if it is past."""
        ...

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        """Wait until `source` has data (True) or `deadline_ns` has come (False)."""
        ...


class MonotonicClock:
    """The machine's CLOCK_MONOTONIC."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        remaining_s = max(0.0, (deadline_ns - time.monotonic_ns()) * 1e-9)
        readable, _, _ = select.select([source], [], [], remaining_s)
        return bool(readable)


class VirtualClock:
    """One part's own time in a simulation; moves only when the part waits or the event loop says so."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def advance_to_ns(self, time_ns: int) -> None:
        """Move forward to `time_ns`; a part that is already further ahead stays there."""
        self._now_ns = max(self._now_ns, time_ns)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.advance_to_ns(deadline_ns)

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        arrival_ns = source.next_arrival_ns()
        if arrival_ns is None or arrival_ns > deadline_ns:
            self.advance_to_ns(deadline_ns)
            return False
        self.advance_to_ns(arrival_ns)
        return True
