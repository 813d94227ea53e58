"""Puts the tactile pads together from the configuration."""

from __future__ import annotations

from pathlib import Path

from calibration.tactile_file import SIDES, TactileFile, read_tactile_file
from controller.config import Tactile
from drivers.clock import Clock
from drivers.errors import InputError
from drivers.takktile.calibration import PadCalibration, nominal
from drivers.takktile.frames import Cell
from drivers.takktile.transport import BridgeTransport
from drivers.takktile.usb import UsbTransport


def configured_cells(tactile: Tactile, side: str) -> tuple[Cell, ...]:
    """The cells of one side's map."""
    cells: tuple[tuple[int, int], ...] = getattr(tactile, f"{side}_cells")
    return tuple(Cell(*cell) for cell in cells)


def open_bridge(tactile: Tactile, clock: Clock) -> BridgeTransport:
    """What carries the configured bridge. Raises DeviceError and InputError."""
    if tactile.interface == "usb":
        return UsbTransport(tactile.channel, clock)
    from drivers.simulated.takktile_lines import SocketTransport

    return SocketTransport(tactile.channel, clock)


def configured_pads(tactile: Tactile) -> tuple[PadCalibration, PadCalibration]:
    """Both pads, right and left, calibrated where the own file says so. Raises InputError if it is for another map."""
    file = None if tactile.own_file is None else Path(tactile.own_file)
    known = TactileFile() if file is None else read_tactile_file(file)
    pads = []
    for side in SIDES:
        cells, pad = configured_cells(tactile, side), known.pad(side)
        if pad is not None and set(pad.cells) != set(cells):
            raise InputError(
                f"{file}: {side}_cells are not the cells of tactile.{side}_cells.",
                help="Run: stillgrasp calibrate tactile",
            )
        pads.append(pad or nominal(cells))
    return pads[0], pads[1]
