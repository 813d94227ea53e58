"""The cycle's view of the tactile pads: whether a finger's pad can be believed, and since when it touches.

Only made where pads are fitted. A pad that is silent, was never zeroed or has no cell left says nothing, and the
motors' load decides for that finger. The other way it tells the tactile process when the fingers are free, so that zero
and drift may be followed, and when to take a new zero.
"""

from __future__ import annotations

from typing import NamedTuple

from controller.pad_messages import PadOrder, PadState
from controller.service.links import LatestReader, LatestSender
from drivers.clock import nanoseconds

LARGEST_AGE_S = 0.1


class PadFinger(NamedTuple):
    """One finger's pad now."""

    touching: bool
    onset_ns: int


class PadWatch:
    """Both pads, over the links to the tactile process."""

    def __init__(self, states: LatestReader, orders: LatestSender) -> None:
        self._states = states
        self._orders = orders
        self._told: PadOrder | None = None
        self._tares = 0
        self._newest: tuple[bytes, int] | None = None
        self._state: PadState | None = None
        self._sample_ns = 0

    def step(self, *, free: bool, take_zero: bool, now_ns: int) -> None:
        """Take the newest state; tell what changed. `take_zero`: the fingers are free and a grasp is about to begin."""
        newest = self._states.newest()
        if newest is not None and newest is not self._newest:
            self._newest = newest
            self._state, self._sample_ns = PadState.unpack(newest[0]), newest[1]
        self._tares += take_zero
        order = PadOrder(free, self._tares)
        if order != self._told and self._orders.send(order.pack(), now_ns):
            self._told = order

    def finger(self, finger: int, now_ns: int) -> PadFinger | None:
        """One finger's pad (0 right, 1 left); None while nothing is known of it."""
        state = self._state
        if state is None or not state.valid_cells[finger] or now_ns - self._sample_ns > nanoseconds(LARGEST_AGE_S):
            return None
        return PadFinger(state.touching[finger], state.onset_ns[finger])
