"""Virtual time: the same parts in one process, in discrete-event order.

Each part has its own clock and is stepped when its next moment comes; ties are broken by a fixed rank. Within a step
a part may wait (on its bus, say): its own clock then runs ahead, and it is not stepped again before that moment. A
bus transaction is atomic at its start, and its result becomes visible when the wire would have delivered it. Nothing
asks the machine for the time, so a run gives the same bytes twice, however loaded the machine is.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import NamedTuple

from drivers.clock import VirtualClock


class Part(NamedTuple):
    """Something that is stepped: `step` does one turn at its clock's time and returns when it wants the next, ns."""

    name: str
    clock: VirtualClock
    step: Callable[[], int | None]


class VirtualTime:
    """Steps parts in the order of their moments; earlier added parts come first in a tie."""

    def __init__(self, start_ns: int = 0) -> None:
        self.now_ns = start_ns
        self._parts: list[Part] = []
        self._due: list[tuple[int, int]] = []

    def add(self, part: Part, first_ns: int | None = None) -> None:
        """Let a part take part from `first_ns` (default: now) on."""
        rank = len(self._parts)
        self._parts.append(part)
        heapq.heappush(self._due, (self.now_ns if first_ns is None else first_ns, rank))

    @property
    def part_names(self) -> list[str]:
        """Who is stepped, by rank."""
        return [part.name for part in self._parts]

    def run_until(self, deadline_ns: int, satisfied: Callable[[], bool] = lambda: False) -> bool:
        """Step parts until `satisfied` (True) or until the next moment lies after `deadline_ns` (False)."""
        while not satisfied():
            if not self._due or self._due[0][0] > deadline_ns:
                self.now_ns = max(self.now_ns, deadline_ns)
                return False
            due_ns, rank = heapq.heappop(self._due)
            part = self._parts[rank]
            self.now_ns = max(self.now_ns, due_ns)
            part.clock.advance_to_ns(due_ns)
            next_ns = part.step()
            if next_ns is not None:
                heapq.heappush(self._due, (max(next_ns, part.clock.now_ns(), due_ns + 1), rank))
        return True
