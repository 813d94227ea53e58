"""`PythonCanBus` over a real python-can interface, with a clock that the test moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.clock import MonotonicClock, Readable
from drivers.errors import BusError
from drivers.simulated.seqpacket_can import SeqpacketHub
from drivers.wam.bus import SAFETY_FILTERS, PythonCanBus, open_can


class StepClock(MonotonicClock):
    """Stands still; a wait runs the hub up to the deadline and records it."""

    def __init__(self) -> None:
        self.time_ns = 0
        self.hub: SeqpacketHub | None = None
        self.waits: list[int] = []

    def now_ns(self) -> int:
        return self.time_ns

    def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
        self.waits.append(deadline_ns)
        self.time_ns = deadline_ns
        assert self.hub is not None
        self.hub.step(deadline_ns)
        return super().wait_readable(source, 0)


@pytest.fixture
def clock(tmp_path: Path) -> Iterator[StepClock]:
    clock = StepClock()
    clock.hub = SeqpacketHub(tmp_path / "can", [], clock)
    yield clock
    clock.hub.close()


def _frame(identifier: int) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False)


def test_receive_waits_on_the_clock_and_hears_only_its_filters(clock: StepClock, tmp_path: Path) -> None:
    """Protects the cycle's deadlines: time passes only in the clock's wait; what no filter wants is not seen."""
    assert clock.hub is not None
    bus = open_can("seqpacket", str(tmp_path / "can"), clock)
    other = open_can("seqpacket", str(tmp_path / "can"), clock)
    for identifier in (0x423, 0x005, 0x540, 0x546):
        other.send(_frame(identifier))
    clock.hub.step(0)
    assert bus.receive(0) is None
    assert clock.waits == []
    heard = []
    while (message := bus.receive(10**6)) is not None:
        heard.append(message.arbitration_id)
    assert heard == [0x423, 0x540, 0x546]
    assert clock.waits == [10**6]
    bus.close()
    other.close()
    bus.close()


def test_safety_filters_pass_the_safety_puck_only(clock: StepClock, tmp_path: Path) -> None:
    """Protects the guard's silent socket from filling with positions."""
    assert clock.hub is not None
    bus = open_can("seqpacket", str(tmp_path / "can"), clock, filters=SAFETY_FILTERS)
    other = open_can("seqpacket", str(tmp_path / "can"), clock)
    for identifier in (0x423, 0x426, 0x546):
        other.send(_frame(identifier))
    clock.hub.step(0)
    message = bus.receive(10**6)
    assert message is not None
    assert message.arbitration_id == 0x546
    bus.close()
    other.close()


def test_lost_bus_is_a_bus_error(clock: StepClock, tmp_path: Path) -> None:
    """Protects the caller from python-can's own errors, when sending, receiving and opening."""
    assert clock.hub is not None
    bus = open_can("seqpacket", str(tmp_path / "can"), clock)
    clock.hub.step(0)
    clock.hub.close()
    with pytest.raises(BusError, match="received"):
        bus.receive(0)
    with pytest.raises(BusError, match="sent"):
        bus.send(_frame(0x401))
    bus.close()
    for interface, channel in (("seqpacket", str(tmp_path / "none")), ("socketcan", "no-such-can"), ("nonsense", "x")):
        with pytest.raises(BusError, match="cannot be opened"):
            open_can(interface, channel, clock)


def test_a_bus_that_was_lost_can_be_had_anew(clock: StepClock, tmp_path: Path) -> None:
    """Protects a day's work from a plug: the same bus, filtered as before, once the adapter is back."""
    assert clock.hub is not None
    bus = open_can("seqpacket", str(tmp_path / "can"), clock)
    clock.hub.step(0)
    clock.hub.close()
    with pytest.raises(BusError, match="received"):
        bus.receive(0)
    with pytest.raises(BusError, match="cannot be opened"):
        bus.reopen()
    with pytest.raises(BusError):
        bus.send(_frame(0x404))
    clock.hub = SeqpacketHub(tmp_path / "can", [], clock)
    bus.reopen()
    other = open_can("seqpacket", str(tmp_path / "can"), clock)
    for identifier in (0x005, 0x423):
        other.send(_frame(identifier))
    clock.hub.step(0)
    message = bus.receive(10**6)
    assert message is not None
    assert message.arbitration_id == 0x423
    bus.send(_frame(0x404))
    bus.close()
    other.close()


def test_interface_without_descriptor_is_refused(clock: StepClock) -> None:
    """Protects against a bus that could only be polled."""
    with pytest.raises(BusError, match="file descriptor"):
        open_can("virtual", "stillgrasp-test", clock)


class Scripted(can.BusABC):
    """An interface that hands out prepared frames."""

    def __init__(self, frames: list[can.Message]) -> None:
        super().__init__(channel="scripted")
        self.channel_info = "scripted"
        self.frames = frames

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return (self.frames.pop(0), True) if self.frames else (None, True)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Transmit buffer full", 105)


def test_special_frames_are_counted_and_full_queue_is_an_error(clock: StepClock) -> None:
    """Protects the driver from error and remote frames, and torques from being queued behind a dead bus."""
    good = _frame(0x423)
    frames = [
        can.Message(arbitration_id=4, is_extended_id=False, is_error_frame=True),
        can.Message(arbitration_id=0x423, is_extended_id=False, is_remote_frame=True),
        can.Message(arbitration_id=0x423, is_extended_id=True),
        good,
    ]
    bus = PythonCanBus(Scripted(frames), clock)
    assert bus.receive(0) is good
    assert bus.dropped_frames == 3
    with pytest.raises(BusError, match="Transmit buffer full"):
        bus.send(good)
    bus.close()
