"""One TakkTile bridge: which firmware it is, which cells are alive, their coefficients, and sampling on and off.

A bridge that is left sampling stands still until somebody drains it, and then gives frames of long ago: `start` stops
and drains it first, and whoever started it stops it, also after an error. Source: TakkTile reference 3, 7.
"""

from __future__ import annotations

import contextlib
from typing import NamedTuple

from drivers.clock import Clock, nanoseconds
from drivers.errors import DeviceError, InputError, ProtocolError
from drivers.takktile.compensation import COEFFICIENT_BYTES, Coefficients, unpack_coefficients
from drivers.takktile.frames import (
    DEVICE,
    TIMER_TICK_S,
    Cell,
    RawCell,
    Request,
    calibration_request,
    unpack_frame,
    unpack_scan,
)
from drivers.takktile.transport import BridgeTransport

CONVERSION_S = 0.003
"""From conversion to read-out: the data sheet's longest. Bridges allow less, and then repeat the one before."""
CELL_READ_S = 81e-6
"""81 bit times at 1 MHz (TakkTile reference 3)."""
_LONGEST_SCAN_BYTES = 40
_LONGEST_TEXT_BYTES = 64
_DRAIN_S = 0.02
_LARGEST_DRAIN_FRAMES = 16
_RUNNING, _STOPPED = b"\x01", b"\x00"


class BridgeFrame(NamedTuple):
    """One reading of all cells, in the bridge's order, and the monotonic time at which it came."""

    sample_ns: int
    cells: tuple[RawCell, ...]


class Bridge:
    """The bridge at the end of `transport`; constructing it asks what it is. Raises DeviceError."""

    def __init__(self, transport: BridgeTransport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self._request(Request.SAMPLING, 0, 0, 1)
        self.version = self._request(Request.VERSION, 0, 1, _LONGEST_TEXT_BYTES).decode("ascii", "replace")
        self.firmware, self.cells = unpack_scan(self._request(Request.SCAN, 0, 0, _LONGEST_SCAN_BYTES))
        """Firmware and the cells that are alive, in the order of frames."""
        if not self.cells:
            raise ProtocolError(DEVICE, "finds no cell.", help="Check the strips' cable.")
        self.coefficient_bytes: dict[Cell, bytes] = {cell: self._coefficients(cell) for cell in self.cells}
        """As each cell holds them: they name the chip."""
        self.coefficients: dict[Cell, Coefficients] = {
            cell: unpack_coefficients(data, cell) for cell, data in self.coefficient_bytes.items()
        }
        self.bad_frames = 0
        """Bulk transfers that were no whole frame, and were dropped."""

    def start(self, period_s: float) -> float:
        """Sample about every `period_s`, or as fast as conversions take; the period that it will be, s.

        Raises InputError for a period that the bridge's timer does not hold, and DeviceError.
        """
        reading_s = CELL_READ_S * len(self.cells)
        ticks = round(max(period_s - reading_s, CONVERSION_S) / TIMER_TICK_S)
        if ticks > 0xFFFF:
            raise InputError(f"a period of {period_s} s is not accepted; expected at most 0.5 s.")
        self.stop()
        answer = self._request(Request.SAMPLING, ticks, 0xFF, 1)
        if answer != _RUNNING:
            raise ProtocolError(
                DEVICE,
                f"does not sample: it answers {answer.hex() or 'nothing'} to the start; expected 01.",
                help="Of two TakkFast boards in a chain, plug USB into the master.",
            )
        return ticks * TIMER_TICK_S + reading_s

    def read(self, deadline_ns: int) -> BridgeFrame | None:
        """The next whole frame; None at `deadline_ns`. Raises BusError."""
        while (data := self._transport.read_frame(deadline_ns)) is not None:
            try:
                return BridgeFrame(self._clock.now_ns(), unpack_frame(self.firmware, self.cells, data))
            except ProtocolError:
                self.bad_frames += 1
        return None

    def stop(self) -> None:
        """Stop sampling and throw away what was not read. Raises DeviceError."""
        answer = self._request(Request.SAMPLING, 0, 0, 1)
        if answer != _STOPPED:
            raise ProtocolError(DEVICE, f"answers {answer.hex() or 'nothing'} to the stop; expected 00.")
        for _ in range(_LARGEST_DRAIN_FRAMES):
            if self._transport.read_frame(self._clock.now_ns() + nanoseconds(_DRAIN_S)) is None:
                return

    def close(self) -> None:
        """Stop sampling as well as that still goes, and let go of the bridge."""
        with contextlib.suppress(DeviceError):
            self.stop()
        self._transport.close()

    def _coefficients(self, cell: Cell) -> bytes:
        value, index = calibration_request(self.firmware, cell)
        return self._request(Request.CALIBRATION, value, index, COEFFICIENT_BYTES)

    def _request(self, request: Request, value: int, index: int, length: int) -> bytes:
        return self._transport.request(request, value, index, length)
