"""One bridge in memory: what it is asked, in which order, and what is made of its answers."""

from __future__ import annotations

import pytest

from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import BusError, InputError, ProtocolError
from drivers.simulated.faults import Fault
from drivers.simulated.takktile import SimulatedCell, SimulatedTakktile
from drivers.simulated.takktile_fault_actions import Truncate
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge
from drivers.takktile.frames import Cell, Firmware, Request


def bridge_of(device: SimulatedTakktile) -> tuple[Bridge, VirtualClock]:
    clock = VirtualClock()
    return Bridge(MemoryTransport(device, clock), clock), clock


@pytest.mark.parametrize("firmware", Firmware)
def test_a_bridge_says_what_it_is_and_samples(firmware: Firmware) -> None:
    """Both firmwares: recognised by the scan's length, all cells read, frames at the asked pace."""
    device = SimulatedTakktile(lambda: (0.0, 0.0), firmware=firmware)
    bridge, clock = bridge_of(device)
    assert bridge.firmware is firmware
    assert bridge.cells == tuple(cell.cell for cell in device.cells)
    assert bridge.start(0.010) == pytest.approx(0.010, abs=1e-5)
    frames = [bridge.read(clock.now_ns() + nanoseconds(0.05)) for _ in range(20)]
    times = [frame.sample_ns for frame in frames if frame is not None]
    assert len(times) == 20
    assert seconds(times[-1] - times[0]) / 19 == pytest.approx(0.010, abs=1e-4)


def test_no_faster_than_a_conversion() -> None:
    """Reference 2: bridges wait less than the data sheet's 3 ms and then repeat old readings; this driver does not
    ask for that. 16 cells of 81 bit times at 1 MHz come on top."""
    bridge, _ = bridge_of(SimulatedTakktile(lambda: (0.0, 0.0)))
    assert bridge.start(0.0) == pytest.approx(0.003 + 16 * 81e-6, abs=1e-6)
    with pytest.raises(InputError, match=r"at most 0\.5 s"):
        bridge.start(1.0)


def test_what_was_left_sampling_is_stopped_and_drained() -> None:
    """A bridge that another program left running holds frames of long ago; none of them comes out."""
    device = SimulatedTakktile(lambda: (0.0, 0.0))
    device.request(Request.SAMPLING, 500, 0xFF, 1, 0)
    device.advance_to(nanoseconds(5.0))
    bridge, clock = bridge_of(device)
    clock.sleep_until_ns(nanoseconds(5.0))
    bridge.start(0.01)
    started_ns = clock.now_ns()
    frame = bridge.read(started_ns + nanoseconds(0.1))
    assert frame is not None
    assert seconds(frame.sample_ns - started_ns) == pytest.approx(0.01, abs=1e-4)
    assert device.requests[1] == (Request.SAMPLING, 0, 0)


def test_broken_frames_are_dropped_and_counted() -> None:
    """A transfer that is no whole frame yields no value, and the next one does."""
    device = SimulatedTakktile(lambda: (0.0, 0.0))
    bridge, clock = bridge_of(device)
    bridge.start(0.01)
    device.add_fault(Fault(action=Truncate(length=30), for_frames=3), clock.now_ns())
    assert bridge.read(clock.now_ns() + nanoseconds(0.1)) is not None
    assert bridge.bad_frames == 3
    device.add_fault(Fault(action=Truncate(length=30), for_frames=100), clock.now_ns())
    assert bridge.read(clock.now_ns() + nanoseconds(0.1)) is None


def test_a_bridge_that_goes_says_so() -> None:
    """Unplugged: BusError from every call, and closing still works."""
    device = SimulatedTakktile(lambda: (0.0, 0.0))
    bridge, clock = bridge_of(device)
    bridge.start(0.01)
    device.unplugged = True
    with pytest.raises(BusError, match="unplugged"):
        bridge.read(clock.now_ns() + nanoseconds(0.1))
    bridge.close()


def test_closing_stops_the_bridge() -> None:
    """The last thing it hears is the stop: left running it would stand still with old frames."""
    device = SimulatedTakktile(lambda: (0.0, 0.0))
    bridge, _ = bridge_of(device)
    bridge.start(0.01)
    bridge.close()
    assert device.requests[-1] == (Request.SAMPLING, 0, 0)
    assert device.next_frame_ns() is None


def test_never_the_boot_loader() -> None:
    """0xBB would take the bridge out of service (reference 3): it is no request of this driver."""
    assert 0xBB not in list(Request)


class _Answering(MemoryTransport):
    """Answers one request in its own way."""

    def __init__(self, request: Request, answer: bytes) -> None:
        super().__init__(SimulatedTakktile(lambda: (0.0, 0.0)), VirtualClock())
        self._special = request, answer

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        if request == self._special[0] and (request != Request.SAMPLING or index):
            return self._special[1]
        return super().request(request, value, index, length)


@pytest.mark.parametrize(
    ("request_", "answer", "words"),
    [
        (Request.SCAN, bytes(8), "no cell"),
        (Request.SCAN, bytes(5), "5 bytes"),
        (Request.CALIBRATION, b"\xff" * 8, "coefficients"),
        (Request.CALIBRATION, b"", "coefficients"),
        (Request.SAMPLING, b"\x00", "master"),
        (Request.SAMPLING, b"", "nothing"),
    ],
)
def test_wrong_answers_are_refused(request_: Request, answer: bytes, words: str) -> None:
    """Each with a reason; none becomes a map, a coefficient or a running bridge."""
    with pytest.raises(ProtocolError, match=words):
        Bridge(_Answering(request_, answer), VirtualClock()).start(0.01)


def test_a_sixth_column_keeps_its_place() -> None:
    """Where a flat index of five a row slips, cells by row and column do not (reference 3)."""
    forces = [0.0, 0.0]
    cells = [SimulatedCell(Cell(0, c), 0, share=0.1) for c in range(6)] + [SimulatedCell(Cell(1, 0), 1)]
    bridge, clock = bridge_of(SimulatedTakktile(lambda: forces, cells, noise_counts=0.0))
    bridge.start(0.01)
    before = bridge.read(clock.now_ns() + nanoseconds(0.1))
    forces[1] = 5.0
    after = bridge.read(clock.now_ns() + nanoseconds(0.1))
    assert before is not None
    assert after is not None
    fell = [cell for cell, a, b in zip(bridge.cells, before.cells, after.cells, strict=True) if b.pressure < a.pressure]
    assert fell == [Cell(1, 0)]
