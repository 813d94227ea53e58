"""The tactile part on virtual time, with the real driver and a simulated bridge whose forces a test sets."""

from __future__ import annotations

from typing import Any

import pytest

from controller.pad_messages import PadOrder, PadState
from controller.service.links import LatestReader, LatestSender, VirtualLink
from controller.service.tactile import TactilePart
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import BusError, NoReplyError
from drivers.simulated.takktile import SimulatedCell, SimulatedTakktile, two_fingers
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge
from drivers.takktile.calibration import nominal
from drivers.takktile.touch import TouchSettings


class Rig:
    """A part with its bridge and the other ends of its links."""

    def __init__(self, **device: Any) -> None:
        self.force_N = [0.0, 0.0]
        self.said: list[str] = []
        self.clock = VirtualClock()
        self.device = SimulatedTakktile(lambda: self.force_N, **device)
        orders = VirtualLink(self.clock, self.clock)
        states = [VirtualLink(self.clock, self.clock, capacity=1000) for _ in range(2)]
        self.orders = LatestSender(orders)
        self.states = [LatestReader(link) for link in states]
        maps = [[cell.cell for cell in two_fingers() if cell.finger == finger] for finger in (0, 1)]
        self.part = TactilePart(
            self.clock,
            Bridge(MemoryTransport(self.device, self.clock), self.clock),
            (nominal(maps[0]), nominal(maps[1])),
            LatestReader(orders),
            [LatestSender(link) for link in states],
            period_s=0.008,
            touch=TouchSettings(),
            say=self.said.append,
        )
        self.part.start()

    def order(self, free: bool, tare: int) -> None:
        self.orders.send(PadOrder(free, tare).pack(), self.clock.now_ns())

    def run(self, duration_s: float) -> PadState | None:
        """The newest state after a time."""
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        while self.clock.now_ns() < end_ns:
            self.part.step()
        told = [reader.newest() for reader in self.states]
        assert told[0] == told[1]
        return None if told[0] is None else PadState.unpack(told[0][0])

    def ready(self) -> Rig:
        """With a zero, about to close."""
        self.order(True, 1)
        self.run(0.7)
        self.order(False, 1)
        return self


def test_nothing_is_told_before_a_zero_was_ordered() -> None:
    """The hand may hold something when the daemon starts: no zero is taken by itself."""
    rig = Rig()
    assert rig.run(1.0) is None
    state = rig.ready().run(0.1)
    assert state is not None
    assert state.valid_cells == (8, 8)
    assert state.touching == (False, False)


def test_contact_is_told_per_finger_and_dated() -> None:
    """The left finger alone, pressed from a known time on; both readers, cycle and front, hear the same."""
    rig = Rig().ready()
    rig.run(0.3)
    began_ns = rig.clock.now_ns()
    while rig.force_N[1] < 1.0:
        rig.force_N[1] = seconds(rig.clock.now_ns() - began_ns) * 2.0
        state = rig.run(0.004)
    assert state is not None
    assert state.touching == (False, True)
    assert seconds(state.onset_ns[1] - began_ns) == pytest.approx(0.0, abs=0.05)
    rig.force_N[1] = 0.0
    state = rig.run(0.1)
    assert state is not None
    assert not state.touching[1]


def test_a_zero_under_load_is_told_and_not_taken() -> None:
    """Somebody leans on a finger that was said to be free: one line for the operator, the old zero holds."""
    rig = Rig().ready()
    rig.order(True, 2)
    rig.run(0.2)
    rig.force_N[0] = 3.0
    state = rig.run(0.6)
    assert any("cannot be zeroed" in line for line in rig.said)
    assert state is not None
    assert state.touching == (True, False)


def test_a_zero_that_comes_too_late_is_given_up() -> None:
    """The fingers near the object before the half second is over: no zero of a touched pad, and nothing is told."""
    rig = Rig()
    rig.order(True, 1)
    rig.run(0.2)
    rig.order(False, 1)
    assert rig.run(1.0) is None


def test_a_saturated_pad_has_not_let_go() -> None:
    """Pressed beyond the converters' range its cells drop out of the sum; contact stays."""
    cells = [SimulatedCell(cell.cell, cell.finger, counts_per_N=1000.0) for cell in two_fingers()]
    rig = Rig(cells=cells).ready()
    rig.force_N[0] = 2.0
    rig.run(0.1)
    rig.force_N[0] = 50.0
    state = rig.run(0.1)
    assert state is not None
    assert state.valid_cells[0] == 0
    assert state.touching[0]


def test_a_silent_bridge_and_an_unplugged_one_end_the_part() -> None:
    """Half a second without a whole frame, or no bridge: an error that says so, not a last value for ever."""
    rig = Rig().ready()
    rig.device.inject_short_frames(10**9)
    with pytest.raises(NoReplyError, match="no frame"):
        rig.run(1.0)
    rig.device.unplugged = True
    with pytest.raises(BusError):
        rig.run(1.0)
    rig.part.stop()


def test_dead_cells_and_missing_calibration_are_told_once() -> None:
    """The operator hears at the start what the numbers are worth."""
    rig = Rig(cells=two_fingers()[1:])
    assert any("0:0 are dead" in line for line in rig.said)
    assert any("not calibrated" in line for line in rig.said)
