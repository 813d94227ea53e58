"""A clock that keeps the cycle going while something long is under way: starting the arm again after a fault.

The start-up of the arm waits on its own (for pucks to wake, for power), up to seconds. With an `AttentiveClock` those
waits are cut at the cycle's deadlines, and all of the cycle but the arm's bus has its turn: the front gets its
heartbeat, the hand its set-point, and the operator can still let trapped fingers go. No thread, and none needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.clock import Clock, Readable


class AttentiveClock:
    """Another `Clock`, and while it is `attended` a call each time that a deadline has come."""

    def __init__(self, clock: Clock, meanwhile: Callable[[], None] = lambda: None) -> None:
        """`meanwhile` goes before each such call: on virtual time it lets the others catch up."""
        self._clock = clock
        self._meanwhile = meanwhile
        self._attend: Callable[[], None] | None = None
        self._due_ns: Callable[[], int] = lambda: 0

    @contextmanager
    def attended(self, attend: Callable[[], None], due_ns: Callable[[], int]) -> Iterator[None]:
        """Within, call `attend` during waits as soon as `due_ns()` has come; it moves that on."""
        outer = self._attend, self._due_ns

        def turn() -> None:
            self._meanwhile()
            attend()

        self._attend, self._due_ns = turn, due_ns
        try:
            yield
        finally:
            self._attend, self._due_ns = outer

    def now_ns(self) -> int:
        return self._clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        while self._attend is not None and self._due_ns() < deadline_ns:
            self._clock.sleep_until_ns(self._due_ns())
            self._attend()
        self._clock.sleep_until_ns(deadline_ns)

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        while self._attend is not None and self._due_ns() < deadline_ns:
            readable = self._clock.wait_readable(source, self._due_ns())
            # Answers may come so fast that no wait ever lasts until a deadline.
            if self._clock.now_ns() >= self._due_ns():
                self._attend()
            if readable:
                return True
        return self._clock.wait_readable(source, deadline_ns)
