"""The hub on virtual time: arrivals, broadcast, priorities, and the reference's whole cycle."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import can
import pytest

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import Frame, TimedFrame, frame_bits


def _frame(identifier: int, data: str = "") -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data))


def _length_ns(identifier: int) -> int:
    return frame_bits(identifier, b"") * 1000


class Echo:
    """A device that answers the frames of one identifier after a while, and counts what it hears."""

    def __init__(self, asked: int, answer: int, delay_ns: int) -> None:
        self.asked, self.answer, self.delay_ns = asked, answer, delay_ns
        self.heard: list[tuple[int, int]] = []

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        if frame.identifier != self.answer:
            self.heard.append((frame.identifier, now_ns))
        return [(now_ns + self.delay_ns, Frame(self.answer, b""))] if frame.identifier == self.asked else []

    def tick(self, now_ns: int) -> list[TimedFrame]:
        return []


def test_reply_arrives_when_the_wire_has_delivered_it() -> None:
    """Protects virtual time: receive moves the client to the arrival, or to the deadline when nothing arrives."""
    device = Echo(0x005, 0x426, delay_ns=1_000)
    hub = MemoryCanHub([device])
    clock = VirtualClock(5_000)
    bus = MemoryCanBus(hub, clock)
    bus.send(_frame(0x005))
    asked_ns = 5_000 + _length_ns(0x005)
    assert device.heard == [(0x005, asked_ns)]
    arrival_ns = asked_ns + 1_000 + _length_ns(0x426)
    assert bus.receive(arrival_ns - 1) is None
    assert clock.now_ns() == arrival_ns - 1
    message = bus.receive(arrival_ns + 50_000)
    assert message is not None
    assert message.arbitration_id == 0x426
    assert clock.now_ns() == arrival_ns
    assert bus.receive(0) is None
    assert clock.now_ns() == arrival_ns


def test_everybody_hears_all_but_its_own() -> None:
    """Protects the broadcast: two clients hear each other and the device in the wire's order; polls find the past."""
    hub = MemoryCanHub([Echo(0x005, 0x426, delay_ns=0)])
    clocks = [VirtualClock(), VirtualClock()]
    first, second = (MemoryCanBus(hub, clock) for clock in clocks)
    first.send(_frame(0x005))
    second.send(_frame(0x006))
    for clock in clocks:
        clock.advance_to_ns(10**6)
    for bus, expected in ((first, [0x006, 0x426]), (second, [0x005, 0x426])):
        heard = []
        while (message := bus.receive(0)) is not None:
            heard.append(message.arbitration_id)
        assert heard == expected


def test_urgent_frame_overtakes_replies_that_wait() -> None:
    """Protects priorities on virtual time: a torque frame goes before replies that have not started."""
    device = Echo(0x404, 0x4E3, delay_ns=100_000)
    hub = MemoryCanHub([device])
    clock = VirtualClock()
    bus = MemoryCanBus(hub, clock)
    bus.send(_frame(0x404))
    clock.advance_to_ns(100_000)
    bus.send(_frame(0x401))
    assert device.heard[-1] == (0x401, 100_000 + _length_ns(0x401))


def test_what_is_no_standard_data_frame_is_refused() -> None:
    """Protects the wire model from frames that this bus does not carry, and a closed bus from use."""
    bus = MemoryCanBus(MemoryCanHub([]), VirtualClock())
    with pytest.raises(BusError):
        bus.send(can.Message(arbitration_id=1, is_extended_id=True))
    bus.close()
    bus.close()
    with pytest.raises(BusError):
        bus.send(_frame(1))
    with pytest.raises(BusError):
        bus.receive(0)


def test_the_references_cycle_takes_829_bits(talk: Callable[..., Any]) -> None:
    """Protects bus load and reply times: every frame of the table in 5.1, back to back but for the pucks' 17 µs."""
    arm = talk()
    hub, clock = MemoryCanHub([arm.wam]), VirtualClock()
    host, listener = MemoryCanBus(hub, clock), MemoryCanBus(hub, VirtualClock())
    for text in ("404#30", "401#AA000031FF48C292", "402#AA00E7FA20000000"):
        identifier, data = text.split("#")
        host.send(_frame(int(identifier, 16), data))
        clock.advance_to_ns(602_000 + 8_000)
    hub.step(2_000_000)
    bits = [58, 78, 76, 76, 74, 77, 77, 77, 116, 120]
    expected_ns = [sum(bits[: place + 1]) * 1000 + 17_000 * (place > 0) for place in range(10)]
    assert [arrival_ns for arrival_ns, _ in listener.inbox] == expected_ns
    assert sum(bits) == 829


def test_a_full_transmit_queue_refuses_as_socketcan_does() -> None:
    """Protects against torques that pile up behind a busy wire: the eleventh frame that waits is ENOBUFS."""
    hub, clock = MemoryCanHub([]), VirtualClock()
    for _ in range(30):  # three milliseconds of a more urgent host
        MemoryCanBus(hub, VirtualClock()).send(_frame(0x001, "0000000000000000"))
    host = MemoryCanBus(hub, clock)
    for _ in range(10):
        host.send(_frame(0x401, "AA00000000000000"))
    with pytest.raises(BusError) as refused:
        host.send(_frame(0x401, "AA00000000000000"))
    assert isinstance(refused.value.__cause__, can.CanOperationError)
    assert refused.value.__cause__.error_code == errno.ENOBUFS
    clock.advance_to_ns(4_000_000)
    host.send(_frame(0x401, "AA00000000000000"))
