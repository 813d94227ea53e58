"""The tactile part on virtual time, with the real driver and a simulated bridge whose forces a test sets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from controller.pad_messages import NOTHING_KNOWN, PadReport, PadState
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import BusError
from drivers.simulated.faults import Fault
from drivers.simulated.takktile import TYPICAL_COEFFICIENTS, SimulatedCell, SimulatedTakktile, two_fingers
from drivers.simulated.takktile_fault_actions import Dead, MoreCells, Silence, Truncate, Unplug
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.frames import Request
from drivers.takktile.quality import CellQuality
from tests.controller.service.tactile_rig import PartRig, nominal_pads


class Rig(PartRig):
    """A part whose fingers' forces a test sets."""

    def __init__(self, calibrated: bool = False, **device: Any) -> None:
        self.force_N = [0.0, 0.0]
        right, left = nominal_pads()
        if calibrated:
            chips = (TYPICAL_COEFFICIENTS.hex(),) * 8
            right, left = replace(right, coefficients=chips), replace(left, coefficients=chips)
        super().__init__(SimulatedTakktile(lambda: self.force_N, **device), (right, left))

    def run(self, duration_s: float) -> PadState:
        """The newest state after a time: both readers, cycle and front, hear the same."""
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        while self.clock.now_ns() < end_ns:
            self.part.step()
        cycle, front = self.states.newest(), self.reports.newest()
        assert cycle is not None
        assert front is not None
        self.report = PadReport.unpack(front[0])
        assert PadState.unpack(cycle[0]) == self.report.state
        return self.report.state

    def ready(self) -> Rig:
        """With a zero, about to close."""
        self.order(True, 1)
        self.run(0.7)
        self.order(False, 1)
        return self


def test_nothing_is_told_before_a_zero_was_ordered() -> None:
    """The hand may hold something when the daemon starts: no zero is taken by itself."""
    rig = Rig()
    assert rig.run(1.0).valid_cells == (0, 0)
    state = rig.ready().run(0.1)
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
    assert state.touching == (False, True)
    assert seconds(state.onset_ns[1] - began_ns) == pytest.approx(0.0, abs=0.05)
    rig.force_N[1] = 0.0
    state = rig.run(0.1)
    assert not state.touching[1]


def test_a_zero_under_load_is_told_and_not_taken() -> None:
    """Somebody leans on a finger that was said to be free: one line for the operator, the old zero holds."""
    rig = Rig().ready()
    rig.order(True, 2)
    rig.run(0.2)
    rig.force_N[0] = 3.0
    state = rig.run(0.6)
    assert any("cannot be zeroed" in line for line in rig.said)
    assert state.touching == (True, False)


def test_a_zero_that_comes_too_late_is_given_up() -> None:
    """The fingers near the object before the half second is over: no zero of a touched pad, and nothing is told."""
    rig = Rig()
    rig.order(True, 1)
    rig.run(0.2)
    rig.order(False, 1)
    assert rig.run(1.0).valid_cells == (0, 0)


def test_a_saturated_pad_has_not_let_go() -> None:
    """Pressed beyond the converters' range its cells drop out of the sum; contact stays."""
    cells = [SimulatedCell(cell.cell, cell.finger, counts_per_N=1000.0) for cell in two_fingers()]
    rig = Rig(cells=cells).ready()
    rig.force_N[0] = 2.0
    rig.run(0.1)
    rig.force_N[0] = 50.0
    state = rig.run(0.1)
    assert state.valid_cells[0] == 0
    assert state.touching[0]


def test_a_bridge_that_goes_is_looked_for_and_taken_back() -> None:
    """Unplugged for two seconds in the middle of a grasp: told once, nothing known meanwhile; back, its zero holds and
    the force that is there is told."""
    rig = Rig().ready()
    rig.force_N[:] = (2.0, 2.0)
    assert rig.run(0.1).touching == (True, True)
    rig.device.add_fault(Fault(action=Unplug(), for_s=2.0), rig.clock.now_ns())
    assert rig.run(1.0) == NOTHING_KNOWN
    assert not rig.report.present
    state = rig.run(2.0)
    assert rig.report.present
    assert state.touching == (True, True)
    assert state.force_N == pytest.approx((2.0, 2.0), abs=0.15)
    lost = [line for line in rig.said if "are lost" in line]
    assert len(lost) == 1
    assert "unplugged" in lost[0]
    assert rig.said[-1] == "the tactile bridge is back"


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (Silence(), "no whole frame within 0.5 s, at all"),
        (Truncate(length=9), "of another length than 16 cells have"),
        (MoreCells(), "of another length than 16 cells have"),
    ],
)
def test_a_bridge_without_whole_frames_is_lost(action: Any, words: str) -> None:
    """Half a second without one: not a last value for ever, and the reason says which kind of nothing it was."""
    rig = Rig().ready()
    rig.device.add_fault(Fault(action=action, for_s=2.0), rig.clock.now_ns())
    assert rig.run(1.0) == NOTHING_KNOWN
    assert words in next(line for line in rig.said if "are lost" in line)
    assert rig.run(3.0).valid_cells == (8, 8)


def test_another_strip_is_not_taken_for_the_old_one() -> None:
    """Plugged in again with another chip in the place of a calibrated one: refused, told once, and nothing is known."""
    rig = Rig(calibrated=True).ready()
    rig.device.unplugged = True
    rig.run(1.0)
    other = replace(rig.device.cells[3], coefficients=bytes.fromhex("3ECEB3F9C51733C8"))
    rig.device = SimulatedTakktile(lambda: rig.force_N, (*rig.device.cells[:3], other, *rig.device.cells[4:]))
    assert rig.run(3.0) == NOTHING_KNOWN
    assert sum("not the one that was calibrated" in line for line in rig.said) == 1


def test_a_cell_that_dies_while_the_bridge_is_away_is_left_out() -> None:
    """The others go on with their zeros; its own place says why it does not count."""
    rig = Rig().ready()
    rig.device.add_fault(Fault(action=Unplug(), for_s=1.0), rig.clock.now_ns())
    rig.device.add_fault(Fault(action=Dead(cells=((0, 2),))), rig.clock.now_ns())
    assert rig.run(3.0).valid_cells == (7, 8)
    dead = [(cell.row, cell.column) for cell in rig.report.cells if cell.quality == CellQuality.DEAD]
    assert dead == [(0, 2)]
    assert any("0:2 are dead" in line for line in rig.said)


def test_a_start_without_a_bridge_is_refused() -> None:
    """Who configured pads wants them: at the start a bridge that is not there is an error, not a wait."""
    rig = Rig()
    rig.part.stop()
    rig.device.unplugged = True
    with pytest.raises(BusError, match="unplugged"):
        rig.part.start()


def test_dead_cells_and_missing_calibration_are_told_once() -> None:
    """The operator hears at the start what the numbers are worth."""
    rig = Rig(cells=two_fingers()[1:])
    assert any("0:0 are dead" in line for line in rig.said)
    assert any("not calibrated" in line for line in rig.said)


def test_what_was_half_opened_is_closed() -> None:
    """A bridge that is back but answers nonsense: each attempt lets go of it, and the next begins anew."""
    opened: list[_Closing] = []
    rig = Rig().ready()
    rig.device.unplugged = True
    rig.run(0.1)
    rig.device.unplugged = False
    rig.new_transport = lambda: _Closing(rig.device, rig.clock, opened)
    rig.run(2.0)
    assert len(opened) >= 3
    assert all(transport.closed == 1 for transport in opened)


class _Closing(MemoryTransport):
    """Answers nothing to a scan; notes itself among the opened, and how often it was closed."""

    def __init__(self, device: SimulatedTakktile, clock: VirtualClock, opened: list[_Closing]) -> None:
        super().__init__(device, clock)
        self.closed = 0
        opened.append(self)

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        return b"" if request == Request.SCAN else super().request(request, value, index, length)

    def close(self) -> None:
        self.closed += 1
