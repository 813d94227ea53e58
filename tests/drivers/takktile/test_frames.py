"""Addresses, scans and bulk frames, held against the reference's numbers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError, ProtocolError
from drivers.takktile.frames import (
    Cell,
    Firmware,
    RawCell,
    address_byte,
    address_byte_of_all,
    calibration_request,
    frame_length,
    pack_frame,
    pack_scan,
    requested_cell,
    unpack_cell,
    unpack_frame,
    unpack_scan,
)

CELLS = st.lists(st.builds(Cell, st.integers(0, 7), st.integers(0, 4)), min_size=1, max_size=16, unique=True)
READINGS = st.lists(st.builds(RawCell, st.integers(0, 1023), st.integers(0, 1023)), min_size=16, max_size=16)


def test_addresses_are_the_references() -> None:
    """Rows 0, 1 and 2 lie at 7-bit addresses 0x00, 0x08 and 0x10 and up; column 6 is a whole row (reference 2)."""
    for row, base in enumerate((0x00, 0x08, 0x10)):
        for column in range(5):
            assert address_byte(Cell(row, column), enable=True) == (base + column) << 1
            assert address_byte(Cell(row, column), enable=False) == (base + column) << 1 | 1
    assert address_byte(Cell(0, 6), enable=True) == address_byte_of_all(enable=True) == 0x0C
    assert address_byte(Cell(0, 6), enable=False) == address_byte_of_all(enable=False) == 0x0D
    with pytest.raises(InputError, match="column of 0 to 5"):
        address_byte(Cell(8, 0), enable=True)


@pytest.mark.parametrize(
    ("words", "cell"),
    [
        ("66807EC0", RawCell(410, 507)),
        ("65C07B40", RawCell(407, 493)),
        ("5A807B40", RawCell(362, 493)),
        ("65C08140", RawCell(407, 517)),
        ("FFC0FFC0", RawCell(1023, 1023)),
    ],
)
def test_words_are_unsigned_upper_ten_bits(words: str, cell: RawCell) -> None:
    """The reference's raw words (4); 517 and 1023 show that nothing is mirrored as two's complement."""
    assert unpack_cell(bytes.fromhex(words)) == cell


def test_a_scan_tells_the_firmware_and_the_order_of_cells() -> None:
    """Eight bytes are TakktileUSB's, a bit a column; forty are TakkFast's, flat by five (reference 3)."""
    assert unpack_scan(bytes([0b100001, 0, 0b10, 0, 0, 0, 0, 0])) == (
        Firmware.TAKKTILE_USB,
        (Cell(0, 0), Cell(0, 5), Cell(2, 1)),
    )
    flat = bytearray(40)
    flat[0] = flat[13] = 0xFF
    assert unpack_scan(bytes(flat)) == (Firmware.TAKK_FAST, (Cell(0, 0), Cell(2, 3)))


@pytest.mark.parametrize("answer", [b"", bytes(7), bytes(39), b"\x40" + bytes(7), b"\x01" + bytes(39)])
def test_what_is_no_scan_is_refused(answer: bytes) -> None:
    """Another length, a seventh column, a byte that is neither 00 nor ff: no map of cells comes of it."""
    with pytest.raises(ProtocolError):
        unpack_scan(answer)


@given(CELLS, READINGS, st.sampled_from(Firmware))
def test_frames_and_scans_come_back(cells: list[Cell], readings: list[RawCell], firmware: Firmware) -> None:
    """Whatever cells are alive, each gets its own reading back, in the scan's order; frames have the stated length."""
    found, alive = unpack_scan(pack_scan(firmware, cells))
    assert (found, list(alive)) == (firmware, sorted(cells))
    frame = pack_frame(firmware, alive, readings[: len(alive)])
    assert len(frame) == frame_length(firmware, alive) == (4 * len(alive) if firmware is Firmware.TAKKTILE_USB else 320)
    assert list(unpack_frame(firmware, alive, frame)) == readings[: len(alive)]
    for cell in alive:
        assert requested_cell(firmware, *calibration_request(firmware, cell)) == cell


@given(st.binary(max_size=400), st.sampled_from(Firmware))
def test_no_bytes_but_a_whole_frame_give_a_value(data: bytes, firmware: Firmware) -> None:
    """Short, long and empty transfers are refused; none crashes."""
    alive = (Cell(0, 0), Cell(3, 2))
    if len(data) == frame_length(firmware, alive):
        assert len(unpack_frame(firmware, alive, data)) == 2
    else:
        with pytest.raises(ProtocolError, match="expected"):
            unpack_frame(firmware, alive, data)
