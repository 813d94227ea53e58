"""Byte layouts of the TakkTile bridges, as pure functions: addresses, scans, coefficients' request, bulk frames.

There are two firmwares: TakktileUSB sends the cells that are alive, TakkFast always 80 places, of which the first 40
are its own. A cell is named by its row (0 to 7, one ATtiny each) and column; a flat index (row × 5 + column) slips
where a row has six columns, so none is used but on the wire. Source: TakkTile reference 2, 3.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import NamedTuple

from drivers.errors import InputError, ProtocolError

VENDOR_ID, PRODUCT_ID = 0x59E3, 0x74C7
BULK_ENDPOINT = 0x81
REQUEST_TYPE = 0xC0
"""Vendor request, device to host: every request of the bridge is one."""
ROWS = 8
TIMER_TICK_S = 8e-6
LONGEST_FRAME_BYTES = 720
DEVICE = "TakkTile bridge"

_CELL = struct.Struct(">HH")
_FAST_COLUMNS = 5
_FAST_CELLS = ROWS * _FAST_COLUMNS
_FAST_FRAME_BYTES = 2 * _FAST_CELLS * _CELL.size
_USB_COLUMNS = 6
_ALIVE, _ABSENT = 0xFF, 0x00
_ALL_COLUMNS = 6
_ALL_ROWS_ON, _ALL_ROWS_OFF = 0x0C, 0x0D


class Request(IntEnum):
    """bRequest. The boot loader's, 0xBB, is left out on purpose."""

    VERSION = 0x00  # wIndex 0: hardware, 1: firmware; text
    SCAN = 0x5C
    CALIBRATION = 0x6C
    ACKNOWLEDGED = 0xBA  # wIndex: address byte, wValue: stop flag; 1 if acknowledged
    SAMPLING = 0xC7  # wIndex: 0 stops; wValue: timer compare; 1 running, 0 stopped


class Firmware(Enum):
    """Which bridge it is; the length of its scan tells."""

    TAKKTILE_USB = "TakktileUSB"
    TAKK_FAST = "TakkFast"


class Cell(NamedTuple):
    """Where a cell sits: row of the bus, column in the row."""

    row: int
    column: int


class RawCell(NamedTuple):
    """One cell's reading, each 0 to 1023: both counts fall, with more force and with more heat."""

    pressure: int
    temperature: int


def address_byte(cell: Cell, *, enable: bool) -> int:
    """I²C address byte that takes the cell's barometer out of reset, or puts it back. Raises InputError."""
    if not (0 <= cell.row < ROWS and 0 <= cell.column <= _ALL_COLUMNS):
        raise InputError(f"{cell} is no cell; expected a row of 0 to 7 and a column of 0 to 5 (6: all of the row).")
    return cell.row << 4 | cell.column << 1 | (0 if enable else 1)


def address_byte_of_all(*, enable: bool) -> int:
    """Address byte that every row answers."""
    return _ALL_ROWS_ON if enable else _ALL_ROWS_OFF


def unpack_scan(data: bytes) -> tuple[Firmware, tuple[Cell, ...]]:
    """Firmware and the cells that are alive, in the order of frames: rows ascending, then columns.

    Raises ProtocolError for an answer that is neither 8 nor 40 bytes long, or names places that there are not.
    """
    if len(data) == ROWS:
        if any(bits >> _USB_COLUMNS for bits in data):
            raise ProtocolError(DEVICE, f"the scan {data.hex(' ')} names a seventh column; there are six.")
        alive = [Cell(row, c) for row, bits in enumerate(data) for c in range(_USB_COLUMNS) if bits >> c & 1]
        return Firmware.TAKKTILE_USB, tuple(alive)
    if len(data) == _FAST_CELLS:
        if any(value not in (_ALIVE, _ABSENT) for value in data):
            raise ProtocolError(DEVICE, f"the scan {data.hex(' ')} is not made of 00 and ff.")
        alive = [Cell(*divmod(index, _FAST_COLUMNS)) for index, value in enumerate(data) if value == _ALIVE]
        return Firmware.TAKK_FAST, tuple(alive)
    raise ProtocolError(DEVICE, f"a scan of {len(data)} bytes; expected {ROWS} or {_FAST_CELLS}.")


def pack_scan(firmware: Firmware, alive: Sequence[Cell]) -> bytes:
    """The counterpart of `unpack_scan`."""
    if firmware is Firmware.TAKKTILE_USB:
        return bytes(sum(1 << cell.column for cell in set(alive) if cell.row == row) for row in range(ROWS))
    flat = {_fast_index(cell) for cell in alive}
    return bytes(_ALIVE if index in flat else _ABSENT for index in range(_FAST_CELLS))


def calibration_request(firmware: Firmware, cell: Cell) -> tuple[int, int]:
    """wValue and wIndex that ask for a cell's coefficients."""
    return (cell.column, cell.row) if firmware is Firmware.TAKKTILE_USB else (0, _fast_index(cell))


def requested_cell(firmware: Firmware, value: int, index: int) -> Cell:
    """The cell that a calibration request is about."""
    return Cell(index, value) if firmware is Firmware.TAKKTILE_USB else Cell(*divmod(index & 0xFF, _FAST_COLUMNS))


def unpack_cell(data: bytes) -> RawCell:
    """Four bytes of a frame: the upper ten bits of two big-endian words, unsigned (TakkTile reference 3, 4)."""
    pressure, temperature = _CELL.unpack(data)
    return RawCell(pressure >> 6, temperature >> 6)


def pack_cell(cell: RawCell) -> bytes:
    """The counterpart of `unpack_cell`."""
    return _CELL.pack(cell.pressure << 6, cell.temperature << 6)


def frame_length(firmware: Firmware, alive: Sequence[Cell]) -> int:
    """Bytes of a whole bulk frame."""
    return _CELL.size * len(alive) if firmware is Firmware.TAKKTILE_USB else _FAST_FRAME_BYTES


def unpack_frame(firmware: Firmware, alive: Sequence[Cell], data: bytes) -> tuple[RawCell, ...]:
    """One reading of every cell of `alive`, in their order. Raises ProtocolError for a frame of another length.

    A second TakkFast board's half of the frame is passed over: neither scan nor coefficients of it can be asked for.
    """
    expected = frame_length(firmware, alive)
    if len(data) != expected:
        raise ProtocolError(DEVICE, f"a frame of {len(data)} bytes; expected {expected} for {len(alive)} cells.")
    places = range(len(alive)) if firmware is Firmware.TAKKTILE_USB else [_fast_index(cell) for cell in alive]
    size = _CELL.size
    return tuple(unpack_cell(data[size * place : size * (place + 1)]) for place in places)


def pack_frame(firmware: Firmware, alive: Sequence[Cell], readings: Sequence[RawCell]) -> bytes:
    """The counterpart of `unpack_frame`."""
    if firmware is Firmware.TAKKTILE_USB:
        return b"".join(pack_cell(reading) for reading in readings)
    frame = bytearray(_FAST_FRAME_BYTES)
    for cell, reading in zip(alive, readings, strict=True):
        start = _CELL.size * _fast_index(cell)
        frame[start : start + _CELL.size] = pack_cell(reading)
    return bytes(frame)


def _fast_index(cell: Cell) -> int:
    return cell.row * _FAST_COLUMNS + cell.column
