"""Opening the hand while no grasp is under way: the hand process pays out, the command waits for open fingers.

A hand that gets no nearer to open for `PATIENCE_S` is not going to: a motor that let go, a finger that is stuck.
"""

from __future__ import annotations

import math

from controller.cycle.outcome import Outcome
from controller.messages import EventKind, HandState, Reason

OPEN_M = 1e-3
"""Of tendon that may still be wound in: what gear friction keeps of the finger springs' pull."""
PATIENCE_S = 2.0
_NEARER_M = 1e-4


class HandOpening:
    """Whether the hand shall open, and the command that waits for it; what it came to goes into `outcomes`."""

    def __init__(self, outcomes: list[Outcome]) -> None:
        self.wanted = False
        self._outcomes = outcomes
        self._token = 0
        self._nearest_m = math.inf
        self._nearer_ns: int | None = None

    def begin(self, token: int = 0) -> None:
        """Open from now on; without a token nobody waits for it."""
        self._finish(Reason.SUPERSEDED)
        self.wanted, self._token = True, token
        self._nearest_m, self._nearer_ns = math.inf, None

    def end(self) -> None:
        """Do not open any more."""
        self._finish(Reason.SUPERSEDED)
        self.wanted = False

    def step(self, hand: HandState | None, now_ns: int) -> None:
        """One period: is the hand open, or does it come nearer to it?"""
        if not self._token:
            return
        wound_m = math.inf if hand is None else max(hand.excursion_m)
        if self._nearer_ns is None or wound_m < self._nearest_m - _NEARER_M:
            self._nearest_m, self._nearer_ns = wound_m, now_ns
        if wound_m <= OPEN_M:
            self._finish(Reason.NONE)
        elif (now_ns - self._nearer_ns) * 1e-9 > PATIENCE_S:
            self._finish(Reason.HAND_NOT_OPEN)

    def _finish(self, reason: Reason) -> None:
        if self._token:
            kind = EventKind.COMPLETED if reason is Reason.NONE else EventKind.FAILED
            self._outcomes.append(Outcome(kind, self._token, reason))
        self._token = 0
