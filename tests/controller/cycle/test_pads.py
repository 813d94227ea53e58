"""The cycle's view of the pads: what it believes, and what it tells the tactile process."""

from __future__ import annotations

import pytest

from controller.cycle.pads import LARGEST_AGE_S, PadFinger, PadWatch
from controller.pad_messages import PadOrder, PadState
from controller.service.links import LatestReader, LatestSender, VirtualLink
from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import ProtocolError

STATE = PadState((0.5, 0.0), (0.03, 0.03), (123, 0), (True, False), (8, 8))


class Rig:
    """A watch with the other ends of its links."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        states, orders = VirtualLink(self.clock, self.clock), VirtualLink(self.clock, self.clock)
        self.states, self.orders = LatestSender(states), LatestReader(orders)
        self.watch = PadWatch(LatestReader(states), LatestSender(orders))

    def step(self, state: PadState | None = None, *, free: bool = False, take_zero: bool = False) -> list[PadOrder]:
        now_ns = self.clock.now_ns()
        if state is not None:
            self.states.send(state.pack(), now_ns)
        self.watch.step(free=free, take_zero=take_zero, now_ns=now_ns)
        return [PadOrder.unpack(payload) for payload, _ in self.orders.new_values()]


def test_each_finger_says_whether_and_since_when() -> None:
    """Per finger: the right one touches since its onset, the left one not."""
    rig = Rig()
    rig.step(STATE)
    assert rig.watch.finger(0, 0) == PadFinger(True, 123)
    assert rig.watch.finger(1, 0) == PadFinger(False, 0)


def test_what_cannot_be_believed_says_nothing() -> None:
    """No state yet, a finger without cells, a state that is too old: the motors' load then decides for that finger."""
    rig = Rig()
    rig.step()
    assert rig.watch.finger(0, 0) is None
    rig.step(PadState((0.5, 0.0), (0.03, 0.03), (123, 0), (True, False), (0, 8)))
    assert rig.watch.finger(0, 0) is None
    assert rig.watch.finger(1, 0) is not None
    assert rig.watch.finger(1, nanoseconds(LARGEST_AGE_S) + 1) is None


def test_orders_go_out_when_something_changes() -> None:
    """Not every period: whether the fingers are free, and each new zero."""
    rig = Rig()
    assert rig.step(free=False) == [PadOrder(False, 0)]
    assert rig.step(free=False) == []
    assert rig.step(free=True, take_zero=True) == [PadOrder(True, 1)]
    assert rig.step(free=True) == []
    assert rig.step(free=False) == [PadOrder(False, 1)]


@pytest.mark.parametrize("message", [STATE, PadOrder(True, 7)])
def test_messages_come_back(message: PadState | PadOrder) -> None:
    """As they were; of another length they are refused."""
    assert type(message).unpack(message.pack()) == message
    with pytest.raises(ProtocolError, match="expected"):
        type(message).unpack(message.pack()[:-1])
