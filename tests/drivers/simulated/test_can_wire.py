"""The simulated wire against the worked lengths of the WAM reference 5.1, a slow encoder, and arbitration."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulated.can_wire import CanWire, Frame, frame_bits


def _bits_written_out(identifier: int, data: bytes) -> int:
    """Length by the text of the CAN specification: bits as characters, CRC by long division, a stuff bit after five."""
    bits = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    remainder = int(bits, 2) << 15
    while remainder.bit_length() > 15:
        remainder ^= 0b1100010110011001 << remainder.bit_length() - 16
    bits += f"{remainder:015b}"
    stuffed, run = "", ""
    for bit in bits:
        run = run + bit if run.endswith(bit) else bit
        stuffed += bit
        if len(run) == 5:
            run = "1" if bit == "0" else "0"
            stuffed += run
    return len(stuffed) + 1 + 2 + 7 + 3  # delimiter, acknowledgement, end of frame, gap


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
    assert bits == _bits_written_out(identifier, data)
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
