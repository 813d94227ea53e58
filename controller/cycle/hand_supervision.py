"""The hand's faults in the cycle: what is wrong with the tendon motors now, and what of it has not been told yet.

While something is, or may be, in the hand each worse one is a fault, also behind a fault of the arm: that the object
may have been dropped is not to be hidden by what came before. An empty hand stops nothing, so there they are warnings,
and closing is refused. A hot motor goes on, with a lower cap: always a warning. A hardware error under which the motors
go on pulling may be cleared with its cause still standing (it stays until they are rebooted, and that lets go); from
then on only worse ones are told.
"""

from __future__ import annotations

from controller.cycle.grasping import Grasping
from controller.cycle.orders import Orders
from controller.cycle.outcome import Outcome
from controller.cycle.safety import HAND_RANKS, SafetyMonitor
from controller.messages import EventKind, HandFault, HandState, Reason

WELL_CYCLES = 500
"""Without anything wrong, after which a warning may come again: the same loose plug is not told a hundred times."""
_LOST = (
    Reason.HAND_OVERHEATED,
    Reason.HAND_OVERLOADED,
    Reason.HAND_RESTARTED,
    Reason.HAND_TORQUE_LOST,
    Reason.HAND_POSITION_JUMP,
    Reason.HAND_NOT_FOLLOWING,
)
_BEARABLE = (Reason.HAND_HARDWARE, Reason.HAND_VOLTAGE)


class HandSupervision:
    """Watches the hand of one cycle."""

    def __init__(self, safety: SafetyMonitor, grasping: Grasping, orders: Orders) -> None:
        self._safety = safety
        self._grasping = grasping
        self._orders = orders
        self._failed = self._warned = self._known = 0
        """Ranks of the worst that was told as a fault since the last was cleared, as a warning, and of what was so when
        a fault was cleared."""
        self._was_astray = False
        self._well_cycles = 0

    def look(self, hand: HandState | None, age_s: float) -> None:
        """Judge the newest sample (None: there was none yet, and nothing to tell), which is so old."""
        orders, grasping = self._orders, self._grasping
        if hand is None:
            return
        astray = grasping.compensated and grasping.following.astray and orders.fault is Reason.NONE
        reason = self._safety.hand(age_s, hand.fault | HandFault.ASTRAY if astray else hand.fault)
        rank, is_hot = HAND_RANKS[reason], reason is Reason.HAND_HOT
        orders.hand_fault = Reason.NONE if is_hot else reason
        self._well_cycles = 0 if rank else self._well_cycles + 1
        if self._well_cycles >= WELL_CYCLES:
            self._warned = self._known = 0
        if orders.fault is Reason.NONE:
            self._failed, self._was_astray = self._known, False
        if grasping.compensated and not is_hot:
            grasping.lost |= reason in _LOST
            self._was_astray |= reason is Reason.HAND_NOT_FOLLOWING
            if rank > self._failed:
                self._failed = rank
                orders.fail_hand(reason)
        elif rank > max(self._failed, self._warned):
            self._warned = rank
            grasping.outcomes.append(Outcome(EventKind.WARNING, 0, reason))

    def clear(self) -> Reason:
        """What forbids to clear a fault while something is in the hand: NONE, if nothing does.

        A spool that was elsewhere has moved the object to where nobody knows it.
        """
        reason = self._orders.hand_fault
        if not self._grasping.compensated:
            return Reason.NONE
        if reason is not Reason.NONE and reason not in _BEARABLE:
            return reason
        if self._was_astray:
            return Reason.HAND_NOT_FOLLOWING
        self._known = HAND_RANKS[reason]
        return Reason.NONE
