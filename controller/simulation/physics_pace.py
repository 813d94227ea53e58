"""How far the physics of `run --simulate` goes: with the machine's time, but never far ahead of who controls the arm.

On a machine that does not keep time the cycle may have to wait for its processor for tens of milliseconds. A real arm
goes on moving under its last torques then; but that a laptop is busy is no reason for a simulated arm to fall. So while
it is active the physics waits for the next torques, and what passed meanwhile is passed over: for the arm, the hand and
the object a late cycle is a cycle in time. Devices answer all the same. Nobody is waited for longer than
`PATIENCE_NS`: a controller that has died shall be seen to have died.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.clock import nanoseconds

PATIENCE_NS = nanoseconds(0.3)
LONGEST_STEP_NS = nanoseconds(0.01)
"""At once: to catch up with more would keep the devices from answering for as long again."""


class Physics(Protocol):
    """What is moved on."""

    @property
    def time_ns(self) -> int: ...

    def advance_to(self, now_ns: int) -> None: ...

    def pass_over(self, duration_ns: int) -> None: ...


class PhysicsPace:
    """Moves the physics on. `torque_ns` tells when the newest torques of an active arm came, None while it is not."""

    def __init__(self, physics: Physics, torque_ns: Callable[[], int | None], reach_ns: int) -> None:
        """`reach_ns`: how far the physics may go under the same torques."""
        self._physics = physics
        self._torque_ns = torque_ns
        self._reach_ns = reach_ns
        self._newest_ns: int | None = None
        self._left_ns = 0

    def advance_to(self, now_ns: int) -> None:
        """Move the physics on to `now_ns`, part of it by passing it over."""
        physics, newest_ns = self._physics, self._torque_ns()
        if newest_ns != self._newest_ns:
            self._newest_ns, self._left_ns = newest_ns, self._reach_ns
        waits = newest_ns is not None and now_ns - newest_ns < PATIENCE_NS
        wanted_ns = now_ns - physics.time_ns
        going_ns = min(wanted_ns, LONGEST_STEP_NS, self._left_ns if waits else wanted_ns)
        if going_ns < wanted_ns:
            physics.pass_over(wanted_ns - going_ns)
        before_ns = physics.time_ns
        physics.advance_to(now_ns)
        self._left_ns -= physics.time_ns - before_ns
