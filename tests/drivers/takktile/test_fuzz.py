"""Any bytes at all from the bridge: an error or nothing comes of them, never a crash and never a force."""

from __future__ import annotations

import contextlib

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import DeviceError
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge
from drivers.takktile.calibration import nominal
from drivers.takktile.frames import Cell, Firmware, frame_length
from drivers.takktile.pads import Pads


class Fuzzed(MemoryTransport):
    """Answers with what it is given, in turn; when that is used up, as a bridge does."""

    def __init__(self, answers: list[bytes], frames: list[bytes]) -> None:
        self.clock = VirtualClock()
        super().__init__(SimulatedTakktile(lambda: (0.0, 0.0)), self.clock)
        self.answers, self.frames = answers, frames

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        true = super().request(request, value, index, length)
        return self.answers.pop()[:length] if self.answers else true

    def read_frame(self, deadline_ns: int) -> bytes | None:
        self.clock.sleep_until_ns(min(self.clock.now_ns() + 8_000_000, deadline_ns))
        return self.frames.pop() if self.frames else None


@settings(max_examples=100, deadline=None)
@given(answers=st.lists(st.binary(max_size=64), min_size=1, max_size=24))
def test_a_bridge_of_any_answers_is_refused_or_understood(answers: list[bytes]) -> None:
    """Version, scan and coefficients of any bytes: an error of ours, or cells that there can be."""
    transport = Fuzzed(answers, [])
    with contextlib.suppress(DeviceError):
        bridge = Bridge(transport, transport.clock)
        assert set(bridge.cells) <= {Cell(row, column) for row in range(8) for column in range(6)}
        assert all(c.b1 + c.c12 * 1023 < 0.0 < c.a0 for c in bridge.coefficients.values())


@settings(max_examples=60, deadline=None)
@given(frames=st.lists(st.binary(max_size=340), min_size=1, max_size=30), firmware=st.sampled_from(Firmware))
def test_frames_of_any_length_are_none(frames: list[bytes], firmware: Firmware) -> None:
    """What has not exactly the length of a frame yields nothing, is counted, and ends in time."""
    transport = Fuzzed([], [])
    transport._device.firmware = firmware
    bridge = Bridge(transport, transport.clock)
    length = frame_length(firmware, bridge.cells)
    transport.frames = [frame for frame in frames if len(frame) != length]
    wrong = len(transport.frames)
    assert bridge.read(transport.clock.now_ns() + nanoseconds(1.0)) is None
    assert bridge.bad_frames == wrong


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_frames_of_any_bytes_are_no_force(data: st.DataObject) -> None:
    """Of the right length, after a true zero: without a checksum only plausibility can tell, and it does."""
    transport = Fuzzed([], [])
    bridge = Bridge(transport, transport.clock)
    right, left = bridge.cells[:8], bridge.cells[8:]
    pads = Pads((nominal(right), nominal(left)), bridge.cells, bridge.coefficients)
    pads.tare()
    bridge.start(0.01)
    while pads.taring:
        frame = MemoryTransport.read_frame(transport, transport.clock.now_ns() + nanoseconds(0.1))
        assert frame is not None
        transport.frames.append(frame)
        reading = bridge.read(transport.clock.now_ns() + nanoseconds(0.1))
        assert reading is not None
        pads.take(reading, free=True)
    assert pads.tared
    for seed in data.draw(st.lists(st.binary(min_size=64, max_size=64), min_size=1, max_size=10)):
        mixed = bytes(byte ^ 0x5A ^ (37 * n & 0xFF) for n, byte in enumerate(seed))  # no seed is a row of equal words
        transport.frames.append(mixed)
        reading = bridge.read(transport.clock.now_ns() + nanoseconds(0.1))
        assert reading is not None
        sample = pads.take(reading, free=False)
        words = [cell.temperature for cell in reading.cells]
        near = sum(abs(word - 498) <= 34 for word in words)
        assert sample.valid_cells == (0, 0) or near >= 8
