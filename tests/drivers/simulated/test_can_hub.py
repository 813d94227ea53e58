"""The simulated wire against the worked lengths of the WAM reference 5.1, arbitration, and the hub on virtual time."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import CanWire, Frame, TimedFrame, frame_bits


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


@pytest.mark.parametrize(
    ("identifier", "data", "bits"),
    [
        (0x404, "30", 58),
        (0x423, "000000", 78),
        (0x443, "3F701F", 76),
        (0x463, "008FE0", 76),
        (0x483, "3F7088", 74),
        (0x4A3, "000000", 77),
        (0x4C3, "000000", 77),
        (0x4E3, "000000", 77),
        (0x401, "AA000031FF48C292", 116),
        (0x402, "AA00E7FA20000000", 120),
    ],
)
def test_frame_lengths_of_the_reference(identifier: int, data: str, bits: int) -> None:
    """Protects the wire times: 829 bit times for the reference's cycle, stuff bits and CRC included."""
    assert frame_bits(identifier, bytes.fromhex(data)) == bits


@given(identifier=st.integers(0, 0x7FF), data=st.binary(max_size=8))
def test_frame_length_is_within_the_standard_bounds(identifier: int, data: bytes) -> None:
    """Law: 47 + 8 n bits and at most a stuff bit for every four of the rest."""
    bits = frame_bits(identifier, data)
    assert 47 + 8 * len(data) <= bits <= 47 + 8 * len(data) + (33 + 8 * len(data)) // 4


def test_lowest_identifier_wins_among_those_that_wait() -> None:
    """Protects arbitration: a frame in progress finishes, then priority counts, not order of arrival."""
    wire = CanWire()
    for ready_ns, identifier in ((0, 0x7FF), (10, 0x423), (20, 0x401), (10_000_000, 0x001)):
        wire.offer(ready_ns, Frame(identifier, b""), None)
    frames = [wire.take() for _ in range(4)]
    assert [carried.frame.identifier for carried in frames] == [0x7FF, 0x401, 0x423, 0x001]
    assert frames[1].start_ns == frames[0].end_ns
    assert frames[3].start_ns == 10_000_000


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
