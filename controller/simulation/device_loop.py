"""One select loop in front of simulated devices: their sockets, and the physics behind them on time.

A turn waits for bytes, a due answer or the next physics deadline, and lets the buses carry what has come. The physics
is moved up to the present when bytes come to a silent bus and whenever nothing is under way, but not while answers
travel: they were sampled already, and would come late on a slow machine.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence
from typing import Protocol

from controller.simulation.stepped_clock import SteppedClock
from drivers.clock import nanoseconds

PHYSICS_DEADLINE_NS = nanoseconds(0.0005)
LONGEST_LAG_NS = nanoseconds(0.002)
"""A bus that is never silent does not stop the physics."""
DELIVERY_NS = nanoseconds(0.0002)
"""What ends on a wire within this time of each other is delivered together, half of it early: to wake for each frame of
a CAN bus at half load would cost half a processor."""
_SAYING_PERIOD_NS = nanoseconds(10.0)


class HasFileno(Protocol):
    """Something else to wait for."""

    def fileno(self) -> int: ...


class Bus(Protocol):
    """A hub or a pty server."""

    def next_due_ns(self) -> int | None: ...

    def step(self, now_ns: int | None = None) -> None: ...


class DeviceLoop:
    """`advance` moves the physics up to a time; `descriptors` names what the buses wait for now."""

    def __init__(
        self,
        clock: SteppedClock,
        advance: Callable[[int], None],
        buses: Sequence[Bus],
        descriptors: Callable[[], Sequence[int]],
        say: Callable[[str], None],
    ) -> None:
        self._clock = clock
        self._advance = advance
        self._buses = tuple(buses)
        self._descriptors = descriptors
        self._say = say
        self._said_ns = -_SAYING_PERIOD_NS
        self._told_drops = 0
        self._advanced_ns = clock.now_ns()

    def turn(self, others: Sequence[HasFileno] = ()) -> list[HasFileno]:
        """One turn; which of `others` are readable."""
        clock = self._clock
        due_ns, silent = clock.now_ns() + PHYSICS_DEADLINE_NS, True
        for bus in self._buses:
            bus_due_ns = bus.next_due_ns()
            if bus_due_ns is not None and bus_due_ns < clock.now_ns() + PHYSICS_DEADLINE_NS:  # later: a planned fault
                silent = False
                due_ns = min(due_ns, max(bus_due_ns, clock.now_ns() + DELIVERY_NS))
        waited: list[int | HasFileno] = [*self._descriptors(), *others]
        readable = select.select(waited, [], [], clock.until_ns(due_ns) * 1e-9)[0]
        now_ns = clock.step()
        if silent or now_ns - self._advanced_ns > LONGEST_LAG_NS:
            self._advance(now_ns)
            self._advanced_ns = now_ns
        for bus in self._buses:
            bus.step(now_ns)
            early_ns = now_ns + DELIVERY_NS // 2
            while (next_ns := bus.next_due_ns()) is not None and next_ns <= early_ns:
                bus.step(max(next_ns, now_ns))
        if clock.drops != self._told_drops and now_ns - self._said_ns > _SAYING_PERIOD_NS:
            self._told_drops, self._said_ns = clock.drops, now_ns
            times = f"{clock.drops} times" if clock.drops > 1 else "once"
            self._say(f"the simulation was {times} too slow for the clock; it dropped {clock.dropped_ns * 1e-9:.2f} s")
        return [source for source in others if source in readable]
